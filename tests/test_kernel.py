"""The binding of the compiled part: its version, its arguments, its failures."""

import ctypes
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from spinor_geom import kernel
from spinor_geom.errors import CompiledPartError, OptionError, OutOfTimeError

PACKAGE = Path(kernel.__file__).parent


@pytest.fixture
def copy(tmp_path):
    """A copy of the compiled part and its sources."""
    shutil.copytree(PACKAGE / "cpp", tmp_path / "cpp")
    for file in PACKAGE.glob("_kernel*"):
        shutil.copy(file, tmp_path)
    kernel.load(tmp_path)
    return tmp_path


def test_a_compiled_part_without_sources_is_loaded(copy):
    shutil.rmtree(copy / "cpp")
    assert kernel.load(copy).sizes.argtypes


def test_a_missing_compiled_part_is_an_error_with_its_cure(copy):
    for file in copy.glob("_kernel*"):
        file.unlink()
    with pytest.raises(CompiledPartError, match=r"missing.*install the package again.*setup.py build_ext"):
        kernel.load(copy)


@pytest.mark.parametrize("change", ["edited", "new", "removed"])
def test_a_stale_compiled_part_is_an_error_with_its_cure(copy, change):
    file = copy / "cpp" / ("another.hpp" if change == "new" else "tree.hpp")
    if change == "removed":
        file.unlink()
    else:
        with file.open("a") as source:
            source.write("// changed\n")
    with pytest.raises(CompiledPartError, match=r"other sources.*install the package again.*setup.py build_ext"):
        kernel.load(copy)


# of C++, and what a function takes for them
TYPES = {
    "int64_t": kernel._INTEGER,
    "double": kernel._NUMBER,
    "const int32_t*": np.ctypeslib.ndpointer(np.int32, flags="C_CONTIGUOUS"),
    "const int64_t*": kernel._INDICES,
    "const double*": kernel._NUMBERS,
    "const Point*": kernel._POINTS,
    "const Point3*": kernel._NUMBERS,
}


def test_the_table_of_functions_has_the_arguments_of_the_sources():
    text = "".join(file.read_text(encoding="utf-8") for file in (PACKAGE / "cpp").glob("*.cpp"))
    found = {name: arguments.split(",") for name, arguments in re.findall(r"ENTRY_POINT int (\w+)\(([^)]*)\)", text)}
    types = {name: [argument.strip().rpartition(" ")[0] for argument in found[name]] for name in found}
    found = {
        name: tuple(TYPES.get(kind, TYPES.get(f"const {kind}")) for kind in kinds) for name, kinds in types.items()
    }
    assert found == kernel.FUNCTIONS


BAD_ARRAYS = {
    "another dtype": (np.zeros((2, 3), dtype=complex), "must be of dtype float64, not complex128"),
    "more columns": (np.zeros((2, 4)), r"must have the shape \(n, 3\), not \(2, 4\)"),
    "one dimension": (np.zeros(3), r"must have the shape .*, not \(3,\)"),
    "NaN": ([[0, 0.5, np.nan]], "must be from 0 to 1, but number 2 is nan"),
    "too large": ([[0, 2.0, 0]], "must be from 0 to 1, but number 1 is 2.0"),
    "negative": ([[0, 0, -1]], "must be from 0 to 1, but number 2 is -1.0"),
}


@pytest.mark.parametrize(("values", "message"), BAD_ARRAYS.values(), ids=BAD_ARRAYS.keys())
def test_checked_arrays_have_their_dtype_shape_and_range(values, message):
    with pytest.raises(OptionError, match=f"places {message}"):
        kernel.checked("places", values, np.float64, None, 3, least=0, most=1)


def test_checked_arrays_are_contiguous_and_not_copied_without_need():
    array = np.arange(12.0).reshape(4, 3)
    assert kernel.checked("array", array, np.float64, 4, 3) is array
    for other in (np.asfortranarray(array), np.repeat(array, 2, axis=0)[::2], array.astype(np.float32), array.tolist()):
        found = kernel.checked("array", other, np.float64, 4, 3)
        assert found.flags.c_contiguous
        np.testing.assert_array_equal(found, array)


@pytest.mark.parametrize(
    "points", [np.zeros((3, 3), dtype=np.float32), np.zeros((3, 3), order="F") + np.eye(3, order="F"), [[0.0] * 3] * 3]
)
def test_an_unchecked_array_is_refused(points):
    with pytest.raises(ctypes.ArgumentError):
        kernel.call("minimum_area_splits", 3, points, 0.0, np.inf, np.zeros((3, 3), dtype=np.int64))


def test_the_time_limit_ends_a_function_without_a_result():
    points = np.random.default_rng(0).normal(size=(400, 3))
    with pytest.raises(OutOfTimeError):
        kernel.call("minimum_area_splits", 400, points, 0.0, -1.0, np.zeros((400, 400), dtype=np.int64))
