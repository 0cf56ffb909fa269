"""Every error has a message, wherever it is raised."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path
from string import Formatter

import spinor_geom
from spinor_geom import errors

SENTENCES = {
    name: {field.partition("[")[0] for _, field, _, _ in Formatter().parse(kind.sentence) if field}
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
