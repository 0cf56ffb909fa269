"""Shells and files of Open CASCADE from spline patches with known areas."""

from types import SimpleNamespace

import numpy as np
import pytest

from spinor_geom.adapters.open_cascade import CAD_SUFFIXES, read_shape, require_cad_suffix, sewn_shell, write_shape
from spinor_geom.errors import CadFileError, MissingPackageError, OptionError
from tests.open_cascade import area_of, count, free_wires, is_valid

KNOTS = np.array([0, 0, 0.5, 1, 1])


def square(left, size=1.0):
    x, y = np.meshgrid(left + size * np.linspace(0, 1, 3), size * np.linspace(0, 1, 3), indexing="ij")
    net = np.stack([x, y, 0 * x], axis=-1)
    return SimpleNamespace(control_points=net, weights=np.ones(net.shape[:2]), degrees=(1, 1), knots=(KNOTS, KNOTS))


@pytest.mark.parametrize("suffix", CAD_SUFFIXES)
@pytest.mark.parametrize("squares", [1, 2])
def test_shells_come_back(tmp_path, suffix, squares, capfd):
    pytest.importorskip("OCP")
    path = tmp_path / f"squares{suffix.upper()}"
    write_shape(sewn_shell([square(k) for k in range(squares)]), path)
    shape = read_shape(path)
    assert is_valid(shape)
    assert (count(shape, "shell"), count(shape, "face")) == (1, squares)
    assert free_wires(shape)[:2] == (1, 0)
    assert abs(area_of(shape) - squares) < 1e-12
    assert capfd.readouterr() == ("", "")


def test_bad_shells_and_files_are_errors(tmp_path, capfd):
    pytest.importorskip("OCP")
    with pytest.raises(CadFileError, match="do not form one shell"):
        sewn_shell([square(0), square(3)])
    with pytest.raises(CadFileError, match="too short"):
        sewn_shell([square(0, 1e-6)])
    with pytest.raises(OptionError, match="unit must be one of"):
        sewn_shell([square(0)], unit="yard")
    with pytest.raises(CadFileError, match="no such file"):
        read_shape(tmp_path / "none.step")
    (tmp_path / "text.step").write_text("no STEP file")
    with pytest.raises(CadFileError, match="no shape"):
        read_shape(tmp_path / "text.step")
    assert capfd.readouterr() == ("", "")  # Open CASCADE's own messages are not printed


def test_unknown_suffixes_and_a_missing_package_are_errors(monkeypatch):
    with pytest.raises(CadFileError, match=r"'\.obj' is not a CAD format"):
        require_cad_suffix("film.obj")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingPackageError, match=r"\[cad\]"):
        require_cad_suffix("film.step")
