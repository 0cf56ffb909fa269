"""Thread limits around small solves."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock, local
from typing import Any

import numpy as np
from threadpoolctl import LibController, OpenBLASController, ThreadpoolController


@cache
def _blas() -> ThreadpoolController:
    """Controllers of the loaded BLAS libraries, cached because the search for them takes milliseconds."""
    return ThreadpoolController().select(user_api="blas")


def _torch() -> Any:
    """The module torch if it is imported already, else None. It is not imported here."""
    torch = sys.modules.get("torch")
    return torch if hasattr(torch, "set_num_threads") else None  # another thread may still be importing it


class _Limits:
    """Thread limits, shared by all Python threads that solve at the same time.

    The limit of BLAS holds for the whole process: the first thread to enter sets it, the last one to leave restores it.
    threadpoolctl lets only one controlling thread change OpenBLAS's limit, so each change releases this control. The
    limit of torch holds for one thread. A thread that starts during a solve inherits it.
    """

    def __init__(self) -> None:
        self.lock = Lock()
        self.inside = 0
        self.torch_threads = 1
        self.blas: list[tuple[LibController, int]] = []  # limited libraries, and their former numbers of threads
        self.own = local()

    def enter(self) -> int | None:
        """Limits BLAS and torch to one thread, and returns the number of torch threads for `leave` to restore."""
        torch = _torch()
        with self.lock:
            depth, threads = getattr(self.own, "depth", 0), torch.get_num_threads() if torch else None
            if not self.inside:
                counts = [(library, library.get_num_threads()) for library in _blas().lib_controllers]
                self.blas = [(library, count) for library, count in counts if count != 1]
                _set_threads([(library, 1) for library, _ in self.blas])
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
            if not self.inside:
                _set_threads(self.blas)


def _set_threads(numbers: list[tuple[LibController, int]]) -> None:
    """Sets the numbers of threads of BLAS libraries."""
    if numbers:
        OpenBLASController.clear_controlling_thread(force=True)
        for library, count in numbers:
            library.set_num_threads(count)
        OpenBLASController.clear_controlling_thread(force=True)


_limits = _Limits()


@contextmanager
def one_thread() -> Iterator[None]:
    """Limits linear algebra to one thread in a `with` block, safe in any number of Python threads.

    On matrices of a few hundred rows several threads are up to a hundred times slower than one. numpy does not warn of
    overflow and undefined quotients, from which solvers recover.
    """
    threads = _limits.enter()
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        _limits.leave(threads)
