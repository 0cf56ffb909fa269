"""Every error has a message, wherever it is raised, and keeps its type, message and fields when it is pickled."""

import ast
import copy
import importlib
import inspect
import pickle
import pkgutil
import string
from pathlib import Path

import pytest

import spinor_geom
from spinor_geom import errors
from spinor_geom.errors import NonFiniteVertexError, SpinorGeomError


def fields_of(kind):
    """The fields in the message of a type."""
    return {name.partition("[")[0] for _, name, _, _ in string.Formatter().parse(kind.sentence) if name}


SENTENCES = {
    name: fields_of(kind)
    for name, kind in inspect.getmembers(errors, inspect.isclass)
    if issubclass(kind, errors.SpinorGeomError) and kind.sentence
}


def test_errors_have_the_fields_that_their_messages_use():
    raised = 0
    for path in Path(spinor_geom.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in SENTENCES:
                raised += 1
                assert {word.arg for word in node.keywords} >= SENTENCES[node.func.id], f"{path}:{node.lineno}"
                assert not node.args, f"{path}:{node.lineno}"
    assert raised > 30


def test_ids_are_attributes_and_tuples():
    error = errors.SelfCrossingLoopError(edges=[[0, 1], [5, 6]], count=2, found="2")
    assert error.edges == error.fields["edges"] == ((0, 1), (5, 6))
    assert "its edges (0, 1) and (5, 6) meet (2 such pairs were found)" in str(error)


OWN = {  # what types with an `__init__` of their own are made of
    NonFiniteVertexError: {"vertex": 3, "place": "line 4"}
}


class Value(int):
    """A number that can be formatted by every message, also as a pair."""

    def __getitem__(self, _):
        return self


def all_types(base=SpinorGeomError):
    below = {one for kind in base.__subclasses__() for one in all_types(kind)}
    return sorted({base, *below}, key=lambda kind: kind.__qualname__)


def example(kind):
    if kind in OWN:
        return kind(**OWN[kind])
    if names := fields_of(kind):
        return kind(**{name: Value(number + 2) for number, name in enumerate(sorted(names))})
    return kind("a sentence with {braces}", place="line 2", ids=[[1, 2], [3]], path=Path("a"))


def test_the_types_in_the_module_of_errors_are_all_there_are():
    for package in ("fill", "batching", "plateau", "adapters"):
        for found in pkgutil.iter_modules(importlib.import_module(f"spinor_geom.{package}").__path__):
            importlib.import_module(f"spinor_geom.{package}.{found.name}")
    assert {kind.__module__ for kind in all_types()} == {errors.__name__}


@pytest.mark.parametrize("kind", all_types(), ids=lambda kind: kind.__name__)
def test_every_type_survives_pickling_and_copying(kind):
    error = example(kind)
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        for again in (pickle.loads(pickle.dumps(error, protocol)), copy.copy(error)):
            assert type(again) is kind
            assert (str(again), again.args, again.fields) == (str(error), error.args, error.fields)
            assert vars(again) == vars(error)
