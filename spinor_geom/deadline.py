"""A time limit that long computations check between their steps."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import perf_counter

from spinor_geom.errors import OutOfTimeError

_DEADLINE: ContextVar[float] = ContextVar("deadline", default=math.inf)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Sets a time limit for the computations in the context. Of nested limits, the earliest applies."""
    token = _DEADLINE.set(min(_DEADLINE.get(), perf_counter() + seconds))
    try:
        yield
    finally:
        _DEADLINE.reset(token)


def seconds_left() -> float:
    """Seconds until the time limit, or inf if there is none."""
    return _DEADLINE.get() - perf_counter()


def is_out_of_time() -> bool:
    """Whether there is a time limit that has expired."""
    return seconds_left() < 0


def require_time(seconds: float = 0.0) -> None:
    """Raises an OutOfTimeError if fewer seconds are left: before a step of that length which cannot be interrupted."""
    if seconds_left() < seconds:
        raise OutOfTimeError
