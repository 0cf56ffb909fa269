"""Thread limits around small solves."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from threading import Lock, local

import torch
from threadpoolctl import ThreadpoolController

_controller = cache(ThreadpoolController)  # looking for the loaded libraries takes milliseconds: once a process


class _Limits:
    """What Python threads that solve at the same time share.

    BLAS has one setting for the process: the thread that limits it puts it back, and no other, which would put back the
    limit. torch has one for each thread; a thread that starts during a solve takes the solve's.
    """

    def __init__(self) -> None:
        self.lock = Lock()
        self.inside = 0
        self.torch_threads = 1
        self.is_blas_limited = False
        self.own = local()

    def enter(self) -> ExitStack:
        """Sets one thread; what is returned puts everything back."""
        with self.lock, ExitStack() as back:
            depth, threads = getattr(self.own, "depth", 0), torch.get_num_threads()
            if not self.inside:
                self.torch_threads = threads
            elif threads == 1 and not depth:
                threads = self.torch_threads
            self.inside, self.own.depth = self.inside + 1, depth + 1
            back.callback(self._leave, threads)
            torch.set_num_threads(1)
            if not self.is_blas_limited:
                self.is_blas_limited = True
                back.callback(setattr, self, "is_blas_limited", False)
                back.enter_context(_controller().limit(limits=1))
            return back.pop_all()

    def _leave(self, threads: int) -> None:
        torch.set_num_threads(threads)
        self.own.depth -= 1
        self.inside -= 1


_limits = _Limits()


@contextmanager
def one_thread() -> Iterator[None]:
    """Runs linear algebra on one thread inside, and restores the caller's setting after, in any number of threads.

    On matrices of a few hundred rows several threads are up to a hundred times slower than one.
    """
    back = _limits.enter()
    try:
        yield
    finally:
        with _limits.lock:
            back.close()
