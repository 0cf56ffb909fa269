"""What works without torch and pymeshlab, and what says that they are missing."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
WITHOUT = """
import sys

MISSING = {missing}

class Without:
    def __init__(self, finder):
        self.finder = finder

    def __getattr__(self, name):
        return getattr(self.finder, name)

    def find_spec(self, name, *where):
        return None if name.partition(".")[0] in MISSING else self.finder.find_spec(name, *where)

sys.meta_path[:] = map(Without, sys.meta_path)
import numpy as np
import spinor_geom
from spinor_geom import gallery
"""
DONE = "\nprint('DONE')\n"


def run_without(program, place, *, missing=("torch", "pymeshlab")):
    """Runs a program where some packages cannot be found."""
    command = [sys.executable, "-c", WITHOUT.replace("{missing}", repr(missing)) + program + DONE]
    return subprocess.run(command, cwd=place, capture_output=True, text=True, timeout=600)


def test_it_works_without_torch(tmp_path):
    program = f"""
for continuity in ("C0", "C1"):
    mesh = "{ROOT}/data/trimesh_reference.obj"
    filled, report = spinor_geom.fill_hole(mesh, continuity=continuity, return_report=True)
spinor_geom.report(report, "report.html")
filled.write("filled.ply")
assert report.complete
assert spinor_geom.batch(mesh, "results", workers=1).progress.files_failed == 0
curve = gallery.twisted_circle()
solution = spinor_geom.solve_plateau(curve.sample(64))
surface, z = solution.array_surface, np.array([0.1, 0.2j])
assert abs(surface.mean_curvature(z)).max() < 1e-9 and solution.stability.verdict == "stable"
surface.save("surface.safetensors")
assert (spinor_geom.ArraySurface.load("surface.safetensors").position(z) == surface.position(z)).all()
assert spinor_geom.compare(solution).to_dict() and solution.to_nurbs().converged
assert np.shape(solution.area_gradient[0]) == (64, 3)
for model in ("auto", "cauchy", "series"):
    assert spinor_geom.solve_plateau(gallery.ellipse(1.5, 0.2).sample(48), model=model).converged
for make in gallery.SURFACES.values():
    make()
t = 2 * np.pi * np.arange(48) / 48
rings = [np.column_stack([np.cos(t), np.sin(t), z + 0 * t]) for z in (0.0, 0.8)]
assert spinor_geom.solve_plateau(rings).converged
assert spinor_geom.solve_plateau(gallery.l_shape(0.5).sample(32)).array_surface.area() > 3
(one,) = spinor_geom.solve_plateau_batch([gallery.tennis_seam().sample(64)])
assert one.converged
"""
    done = run_without(program, tmp_path)
    assert done.stdout == "DONE\n", done.stderr


def test_what_is_missing_is_one_sentence_with_its_extra(tmp_path):
    program = """
from spinor_geom.errors import MissingPackageError

square = [[0, 0, 0], [1, 0, 0.1], [1, 1, 0], [0, 1, 0.1]]
loop = spinor_geom.BoundaryLoop.from_points(square)
solution = spinor_geom.solve_plateau(loop)
box = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]), np.array([[0, 2, 1], [1, 2, 3]])
_, report = spinor_geom.fill_hole(box, return_report=True)
uses = {
    "torch": [
        lambda: solution.surface,
        lambda: spinor_geom.solve_plateau(loop, model="mlp"),
        lambda: spinor_geom.solve_plateau(loop, device="cuda"),
        *(lambda name=name: getattr(spinor_geom, name) for name in ("ComplexMLP", "SpinorSurface", "minimal_area")),
        lambda: __import__("spinor_geom.training"),
    ],
    "meshlab": [lambda: spinor_geom.discrete_minimal_surface(loop, method="pymeshlab")],
    "render": [lambda: spinor_geom.report(report)],
}
for extra, calls in uses.items():
    for call in calls:
        try:
            call()
        except MissingPackageError as error:
            print(str(error).endswith(f"pip install '.[{extra}]'"))
"""
    done = run_without(program, tmp_path, missing=("torch", "pymeshlab", "matplotlib"))
    assert done.stdout == 9 * "True\n" + "DONE\n", done.stderr
