"""`spinor-geom solve`: from edges to a minimal surface, at the same position and size; one sentence for bad input."""

import numpy as np
import pytest

from spinor_geom.cli.main import main
from tests.systems import OnUse

cad = OnUse("build123d")

ANGLES = 2 * np.pi * np.arange(32) / 32
CIRCLE = "".join(f"v {x} {y} 0\n" for x, y in zip(np.cos(ANGLES), np.sin(ANGLES), strict=True))


@pytest.fixture
def frame(tmp_path):
    """A circle of radius 3 and height 5, in two arcs."""
    arcs = [cad.CenterArc((0, 0), 3, start, 180).moved(cad.Location((0, 0, 5))) for start in (0, 180)]
    cad.export_step(cad.Compound(arcs), tmp_path / "frame.step")
    return tmp_path / "frame.step"


def test_edges_of_a_step_file_become_a_surface_in_their_place(frame, capsys):
    out = frame.parent / "new" / "film.igs"
    assert main(["solve", str(frame), "-o", str(out)]) == 0
    output = capsys.readouterr()
    assert "1 closed curve of 2 edges that belong to no face, in mm\n" in output.out
    assert output.err == ""
    # the free boundary of the film is the frame again
    assert main(["solve", str(out), "-o", str(frame.with_name("again.step"))]) == 0
    assert "edges on the free boundary of faces" in capsys.readouterr().out
    film = cad.import_step(frame.with_name("again.step"))
    assert film.area == pytest.approx(9 * np.pi, rel=1e-6)
    np.testing.assert_allclose(film.bounding_box().min.Z, 5, atol=1e-6)


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("cm", 100.0)])
def test_curves_of_an_obj_file_have_a_unit(unit, factor, tmp_path):
    (tmp_path / "circle.obj").write_text(f"{CIRCLE}l {' '.join(map(str, range(1, 33)))} 1\n")
    assert main(["solve", str(tmp_path / "circle.obj"), "-o", str(tmp_path / "film.step"), "--unit", unit]) == 0
    assert cad.import_step(tmp_path / "film.step").area == pytest.approx(np.pi * factor, rel=1e-6)  # the tolerance


def test_one_of_several_holes_is_chosen(tmp_path, capsys):
    tube = cad.Shell([face for face in cad.Cone(2, 1, 2).faces() if face.geom_type == cad.GeomType.CONE])
    cad.export_step(tube, tmp_path / "tube.step")
    arguments = ["solve", str(tmp_path / "tube.step"), "-o", str(tmp_path / "lid.step")]
    assert main(arguments) == 2
    assert "2 free boundaries" in capsys.readouterr().err
    assert main([*arguments, "--loop", "1"]) == 0
    assert cad.import_step(tmp_path / "lid.step").area == pytest.approx(np.pi, rel=1e-6)
    assert main([*arguments, "--loop", "2"]) == 2
    assert "loop 2 does not exist" in capsys.readouterr().err
