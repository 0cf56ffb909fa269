"""Thread limits around small solves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import torch
from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    # looking for the loaded libraries takes milliseconds: once a process
    return ThreadpoolController()


@contextmanager
def one_thread() -> Iterator[None]:
    """Runs linear algebra on one thread inside, and restores the caller's setting after.

    On matrices of a few hundred rows several threads are up to a hundred times slower than one.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with _controller().limit(limits=1):
            yield
    finally:
        torch.set_num_threads(before)
