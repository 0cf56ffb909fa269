"""Thread limits around small solves."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock, local
from typing import Any

import numpy as np
from threadpoolctl import OpenBLASController, ThreadpoolController, threadpool_limits


@cache
def _blas() -> ThreadpoolController:
    """Controllers of the loaded BLAS libraries, cached because the search for them takes milliseconds."""
    return ThreadpoolController().select(user_api="blas")


def _torch() -> Any:
    """The module torch if it is imported already, else None; it is not imported here."""
    torch = sys.modules.get("torch")
    return torch if hasattr(torch, "set_num_threads") else None  # another thread may still be importing it


class _Limits:
    """Thread limits, shared by all Python threads that solve at the same time.

    The limit of BLAS holds for the whole process: the first thread to enter sets it, the last one to leave restores it.
    threadpoolctl lets only one controlling thread change OpenBLAS's limit, so each change releases this control. The
    limit of torch holds for one thread; a thread that starts during a solve inherits it.
    """

    def __init__(self) -> None:
        self.lock = Lock()
        self.inside = 0
        self.torch_threads = 1
        self.blas: threadpool_limits | None = None
        self.own = local()

    def enter(self) -> int | None:
        """Limits BLAS and torch to one thread; returns the number of torch threads for `leave` to restore."""
        torch = _torch()
        with self.lock:
            depth, threads = getattr(self.own, "depth", 0), torch.get_num_threads() if torch else None
            if self.blas is None:
                OpenBLASController.clear_controlling_thread(force=True)
                self.blas = _blas().limit(limits=1)
                OpenBLASController.clear_controlling_thread(force=True)
                self.torch_threads = threads or self.torch_threads
            elif threads == 1 and not depth:
                threads = self.torch_threads
            self.inside, self.own.depth = self.inside + 1, depth + 1
            if torch:
                torch.set_num_threads(1)
            return threads

    def leave(self, threads: int | None) -> None:
        """Restores the limit of torch, and that of BLAS if no other thread is inside."""
        with self.lock:
            if threads:
                _torch().set_num_threads(threads)
            self.inside, self.own.depth = self.inside - 1, self.own.depth - 1
            if self.blas is not None and not self.inside:
                OpenBLASController.clear_controlling_thread(force=True)
                self.blas.restore_original_limits()
                OpenBLASController.clear_controlling_thread(force=True)
                self.blas = None


_limits = _Limits()


@contextmanager
def one_thread() -> Iterator[None]:
    """Limits linear algebra to one thread in a `with` block; safe in any number of Python threads.

    On matrices of a few hundred rows several threads are up to a hundred times slower than one. numpy does not warn of
    overflow and undefined quotients, from which solvers recover.
    """
    threads = _limits.enter()
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        _limits.leave(threads)
