"""A time limit holds inside its block only, and the earlier of two nested limits holds."""

import math

import pytest

from spinor_geom.deadline import is_out_of_time, require_time, time_limit
from spinor_geom.errors import OutOfTimeError


def test_without_a_limit_there_is_always_time():
    assert not is_out_of_time()
    require_time()
    with time_limit(math.inf):
        assert not is_out_of_time()


def test_the_earlier_of_nested_limits_counts_and_ends_with_its_block():
    with time_limit(1e3):
        with time_limit(-1.0):
            assert is_out_of_time()
            with time_limit(1e3):
                assert is_out_of_time()
            with pytest.raises(OutOfTimeError, match="time_limit"):
                require_time()
        assert not is_out_of_time()


def test_an_error_ends_the_limit_too():
    with pytest.raises(ZeroDivisionError), time_limit(-1.0):
        raise ZeroDivisionError
    assert not is_out_of_time()
