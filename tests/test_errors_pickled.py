"""Errors that are pickled keep their type, message and fields."""

from __future__ import annotations

import copy
import importlib
import pickle
import pkgutil
import string
from pathlib import Path

import pytest

from spinor_geom import errors
from spinor_geom.errors import NonFiniteVertexError, SpinorGeomError

OWN = {  # what types with an `__init__` of their own are made of
    NonFiniteVertexError: {"vertex": 3, "place": "line 4"},
}


class Value(int):
    """A number that can be formatted by every message, also as a pair."""

    def __getitem__(self, _: object) -> Value:
        return self


def all_types(base: type[SpinorGeomError] = SpinorGeomError) -> list[type[SpinorGeomError]]:
    below = {one for kind in base.__subclasses__() for one in all_types(kind)}
    return sorted({base, *below}, key=lambda kind: kind.__qualname__)


def example(kind: type[SpinorGeomError]) -> SpinorGeomError:
    if kind in OWN:
        return kind(**OWN[kind])
    names = {name.split("[")[0] for _, name, _, _ in string.Formatter().parse(kind.sentence) if name}
    if names:
        return kind(**{name: Value(number + 2) for number, name in enumerate(sorted(names))})
    return kind("a sentence with {braces}", place="line 2", ids=[[1, 2], [3]], path=Path("a"))


def test_the_types_in_the_module_of_errors_are_all_there_are() -> None:
    for package in ("fill", "batching", "plateau", "adapters"):
        for found in pkgutil.iter_modules(importlib.import_module(f"spinor_geom.{package}").__path__):
            importlib.import_module(f"spinor_geom.{package}.{found.name}")
    assert {kind.__module__ for kind in all_types()} == {errors.__name__}


@pytest.mark.parametrize("kind", all_types(), ids=lambda kind: kind.__name__)
def test_every_type_survives_pickling_and_copying(kind: type[SpinorGeomError]) -> None:
    error = example(kind)
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        for again in (pickle.loads(pickle.dumps(error, protocol)), copy.copy(error)):
            assert type(again) is kind
            assert (str(again), again.args, again.fields) == (str(error), error.args, error.fields)
            assert vars(again) == vars(error)
