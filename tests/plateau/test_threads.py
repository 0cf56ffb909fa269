"""Thread limits in several Python threads: one thread inside, the caller's setting after."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import pytest
import torch
from threadpoolctl import threadpool_info, threadpool_limits

from spinor_geom.plateau.threads import one_thread


def threads_of_blas() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def _two_threads() -> Iterator[None]:
    """Two threads before, independently of the environment, so that a limit has an effect."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    with threadpool_limits(2, user_api="blas"):
        if threads_of_blas() != {2}:
            pytest.skip("BLAS has one thread on this machine")
        yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("first_out", [0, 1])
def test_the_limit_stays_at_one_thread_until_both_blocks_end(first_out: int) -> None:
    inside, left = [threading.Event(), threading.Event()], threading.Event()
    seen: dict[str, object] = {}

    def run(number: int) -> None:
        if number == 1:
            inside[0].wait()
        with one_thread():
            inside[number].set()
            inside[1 - number].wait()
            if number != first_out:
                left.wait()
                seen["other inside"] = threads_of_blas(), torch.get_num_threads()
        if number == first_out:
            seen["after the first"] = torch.get_num_threads()
            left.set()

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(run, range(2)))
    assert seen == {"other inside": ({1}, 1), "after the first": 2}
    assert threads_of_blas() == {2}


def test_an_error_inside_restores_the_setting() -> None:
    with suppress(ZeroDivisionError), one_thread():
        raise ZeroDivisionError
    assert threads_of_blas() == {2}
    assert torch.get_num_threads() == 2
