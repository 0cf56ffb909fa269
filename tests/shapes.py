"""Checks that arrays have the shapes that annotations state: `pytest -p tests.shapes tests/mesh`.

Only arrays are checked; mypy checks the other types. Of each function the first calls in each test are checked, as
some are called a hundred thousand times.
"""

import ast
import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from functools import wraps
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType, NoneType, UnionType
from typing import Any, Union, get_args, get_origin

import numpy as np
from jaxtyping import AbstractArray, jaxtyped

CALLS = 20  # of one function in one test

_test = 0  # number of the test that runs


def pytest_configure() -> None:
    """Runs before any module of the package is imported."""
    sys.meta_path.insert(0, _Finder())


def pytest_runtest_setup() -> None:
    global _test
    _test += 1


def arrays_checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Wraps a function so that it raises a TypeError if an array does not match its annotation."""
    run: Callable[..., Any] | None = None
    test = calls = 0

    @wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        nonlocal run, test, calls
        test, calls = _test, 1 if test != _test else calls + 1
        if calls > CALLS:
            return function(*args, **kwargs)
        if run is None:  # not before the first call, as annotations may name what comes later in the module
            named = {name: _evaluated(hint, function) for name, hint in function.__annotations__.items()}
            hints = {name: hint for name, hint in named.items() if _has_shape(hint)}
            run = _checking(function, hints) if hints else function
        return run(*args, **kwargs)

    return checked


def _checking(function: Callable[..., Any], hints: Mapping[str, Any]) -> Callable[..., Any]:
    parameters = list(inspect.signature(function).parameters.values())
    in_order = [one.name for one in parameters if one.kind != inspect.Parameter.KEYWORD_ONLY]
    if any(one.kind == inspect.Parameter.VAR_POSITIONAL for one in parameters):
        in_order += in_order[-1:] * 100

    @jaxtyped(typechecker=None)  # one name of a length is one number within a call
    @wraps(function)
    def checking(*args: Any, **kwargs: Any) -> Any:
        given = [
            (name, value) for name, value in [*zip(in_order, args, strict=False), *kwargs.items()] if name in hints
        ]
        wrong = [one for one in given if not _fits(one[1], hints[one[0]])]
        result = function(*args, **kwargs)  # a function may refuse what does not match, by an error of its own
        if not wrong and "return" in hints and not _fits(result, hints["return"]):
            wrong = [("return", result)]
        for name, value in wrong:
            got = f"{tuple(value.shape)} of {value.dtype}" if hasattr(value, "shape") else repr(value)[:200]
            raise TypeError(f"{function.__module__}.{function.__qualname__}: {name} must be {hints[name]}, got {got}")
        return result

    return checking


def fields_checked(dataclass: type) -> type:
    """Checks the arrays that a dataclass is made of, unless it converts them or raises errors of its own."""
    if is_dataclass(dataclass) and not hasattr(dataclass, "__post_init__"):
        dataclass.__init__ = arrays_checked(dataclass.__init__)
    return dataclass


def _evaluated(hint: Any, function: Callable[..., Any]) -> Any:
    try:
        return eval(hint, function.__globals__) if isinstance(hint, str) else hint
    except (AttributeError, NameError, TypeError):  # what only type checkers import or may subscript
        return Any


def _has_shape(hint: Any) -> bool:
    return _is_shape(hint) or any(map(_has_shape, get_args(hint)))


def _fits(value: object, hint: Any) -> bool:
    """Whether all arrays in a value have the shapes of its annotation."""
    origin, parts = get_origin(hint), get_args(hint)
    if isinstance(value, np.ndarray) and value.dtype.char == "q":
        value = value.view(np.int64)  # jaxtyping does not know numpy's second name of int64
    if _is_shape(hint):
        return isinstance(value, hint)
    if origin in (Union, UnionType):
        shapes = [part for part in parts if _is_shape(part)]
        if shapes and hasattr(value, "dtype"):
            return any(isinstance(value, shape) for shape in shapes)
        return value is None or any(_fits(value, part) for part in parts if part is not NoneType and part not in shapes)
    if origin is tuple and isinstance(value, tuple):
        parts = parts[:1] * len(value) if parts[1:] == (...,) else parts
        return len(parts) == len(value) and all(map(_fits, value, parts))
    if origin in (list, Sequence) and isinstance(value, (list, tuple)):
        return all(_fits(one, parts[0]) for one in value)
    if origin in (dict, Mapping) and isinstance(value, Mapping):
        return all(_fits(one, parts[1]) for one in value.values())
    return True


def _is_shape(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, AbstractArray)


class _Decorating(ast.NodeTransformer):
    """Decorates functions, under the decorators that they have, and classes, over them."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        self.generic_visit(node)
        # `__init__` converts what it is given, and raises errors of its own; warnings name the line that calls
        names_its_caller = any(isinstance(one, ast.keyword) and one.arg == "stacklevel" for one in ast.walk(node))
        if node.name != "__init__" and not names_its_caller:
            node.decorator_list.append(_named("arrays_checked", node))
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.ClassDef:
        self.generic_visit(node)
        node.decorator_list.insert(0, _named("fields_checked", node))
        return node


def _named(name: str, place: ast.stmt) -> ast.expr:
    decorator = ast.parse(f"__import__('sys').modules['{__name__}'].{name}", mode="eval").body
    for node in ast.walk(decorator):
        ast.copy_location(node, place)
    return decorator


class _Loader(SourceFileLoader):
    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        tree = _Decorating().visit(ast.parse(self.get_data(path)))
        return compile(tree, path, "exec", dont_inherit=True)


class _Finder(MetaPathFinder):
    def find_spec(self, fullname: str, path: Sequence[str] | None, target: object = None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(fullname, path) if fullname.partition(".")[0] == "spinor_geom" else None
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(fullname, spec.loader.path)
        return spec
