"""A budget of seconds that long computations look at between their steps."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import perf_counter

from spinor_geom.errors import OutOfTimeError

_DEADLINE: ContextVar[float] = ContextVar("deadline", default=math.inf)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Computations inside stop after so many seconds, or a step later; of nested limits the earlier end counts."""
    token = _DEADLINE.set(min(_DEADLINE.get(), perf_counter() + seconds))
    try:
        yield
    finally:
        _DEADLINE.reset(token)


def is_out_of_time() -> bool:
    """Whether the time that the innermost `time_limit` allows is over; never outside of one."""
    return perf_counter() > _DEADLINE.get()


def require_time() -> None:
    """Stops what has nothing to show yet by an OutOfTimeError, once the time is over."""
    if is_out_of_time():
        raise OutOfTimeError
