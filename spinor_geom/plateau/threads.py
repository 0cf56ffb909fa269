"""Thread limits around small solves."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock, local

import torch
from threadpoolctl import OpenBLASController, ThreadpoolController, threadpool_limits


@cache
def _blas() -> ThreadpoolController:
    """The loaded libraries: looking for them takes milliseconds, once a process."""
    return ThreadpoolController().select(user_api="blas")


class _Limits:
    """What Python threads that solve at the same time share.

    BLAS has one setting for the process: the first thread inside limits it, the last one that leaves restores it.
    threadpoolctl takes OpenBLAS's from one thread only, so that these have to release it. torch has one for each
    thread; a thread that starts during a solve inherits the solve's.
    """

    def __init__(self) -> None:
        self.lock = Lock()
        self.inside = 0
        self.torch_threads = 1
        self.blas: threadpool_limits | None = None
        self.own = local()

    def enter(self) -> int:
        """Sets one thread, and returns the number of torch's that the calling thread is to have again."""
        with self.lock:
            depth, threads = getattr(self.own, "depth", 0), torch.get_num_threads()
            if self.blas is None:
                OpenBLASController.clear_controlling_thread(force=True)
                self.blas = _blas().limit(limits=1)
                OpenBLASController.clear_controlling_thread(force=True)
                self.torch_threads = threads
            elif threads == 1 and not depth:
                threads = self.torch_threads
            self.inside, self.own.depth = self.inside + 1, depth + 1
            torch.set_num_threads(1)
            return threads

    def leave(self, threads: int) -> None:
        """Restores torch's threads, and those of BLAS where nobody else is inside."""
        with self.lock:
            torch.set_num_threads(threads)
            self.inside, self.own.depth = self.inside - 1, self.own.depth - 1
            if self.blas is not None and not self.inside:
                OpenBLASController.clear_controlling_thread(force=True)
                self.blas.restore_original_limits()
                OpenBLASController.clear_controlling_thread(force=True)
                self.blas = None


_limits = _Limits()


@contextmanager
def one_thread() -> Iterator[None]:
    """Runs linear algebra on one thread inside, and restores the caller's setting after, in any number of threads.

    On matrices of a few hundred rows several threads are up to a hundred times slower than one.
    """
    threads = _limits.enter()
    try:
        yield
    finally:
        _limits.leave(threads)
