"""`fill_hole`, `spinor-geom fill` and batches give the same for the same file: bytes, report, status and message."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from spinor_geom import fill_hole, read_mesh
from spinor_geom.cli.main import main
from spinor_geom.errors import SpinorGeomError
from spinor_geom.files import MESH_SUFFIXES, json_text, printable
from tests.batching.files import record, without_seconds
from tests.batching.test_task import solved
from tests.fill.shapes import circle, collar, cylinder, figure_eight, obj_text, soup, together, tube

Options = dict[str, Any]


def as_obj(vertices, faces):
    return obj_text(vertices, faces).encode()


def ring_with_island():
    """A plane ring of triangles with a loose square in its hole."""
    square = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / 4
    ring = collar(circle(16), circle(16, height=1))
    return as_obj(*together(ring, (square, np.array([[0, 1, 2], [0, 2, 3]]))))


def textured():
    """A tube with texture seams and a material."""
    text = as_obj(*cylinder(12, 3)).replace(b"f ", b"vt 0 0\nvt 1 0\nvt 0 1\nusemtl skin\nf ", 1)
    return b"mtllib skin.mtl\n" + re.sub(rb"f (\d+) (\d+) (\d+)", rb"f \1/1 \2/2 \3/3", text)


SHAPES: dict[str, Callable[[], bytes]] = {
    "tube.obj": lambda: as_obj(*cylinder(16, 4)),
    "island.obj": ring_with_island,
    "eight.obj": lambda: as_obj(*collar(figure_eight(12, 0.0), [0, 0, 3])),  # both rims cross themselves
    "soup.obj": lambda: as_obj(*soup(tube(12))),
    "coloured.obj": lambda: re.sub(rb"(v .*)\n", rb"\1 1 0.5 0\n", as_obj(*cylinder(12, 3))),
    "textured.obj": textured,
    "two\u00a0names.obj": lambda: b"o a\n" + as_obj(*cylinder(12, 3)) + b"g b\n" + b"f 1 2 3\n",
}


@pytest.fixture(scope="module")
def shapes(tmp_path_factory):
    """Meshes with holes of special kinds, as OBJ, and those that can be filled in all formats."""
    folder = tmp_path_factory.mktemp("shapes")
    for name, content in SHAPES.items():
        (folder / name).write_bytes(content())
    (folder / "skin.mtl").write_text("newmtl skin\nmap_Kd -s 2 2 skin.png\nmap_Bump gone.png\n")
    (folder / "skin.png").write_bytes(b"an image")
    return folder


def filled(path, options):
    try:
        return fill_hole(path, return_report=True, **options)
    except SpinorGeomError as error:
        return error


def both_filled(path, output, options):
    """The exit status of `fill`, and the result of its call of `fill_hole`, or of a direct call if it made none."""
    named = {"edge_length": "target_edge_length"}
    own = {named.get(name, name): value for name, value in options.items() if name != "strict"}
    own |= {"continuity": {"default": own.get("continuity", "C0")}}
    own |= {name: [value] for name, value in own.items() if name == "bridge"}  # which may be repeated
    results = []

    def recording(mesh, loop, **given):
        assert own.items() <= {**given, "loop": loop, "merge": own.get("merge", False)}.items()
        results.append(fill_hole(mesh, loop, **given))
        return results[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("spinor_geom.cli.fill.fill_hole", recording)
        report = output.with_suffix(".json")
        status = main(["fill", str(path), "-o", str(output), "--report", str(report), *command_line(options)])
    return status, results[0] if results else filled(path, own)


def command_line(options):
    words = []
    for name, value in options.items():
        text = ",".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
        words += [f"--{name.replace('_', '-')}", *([] if value is True else [text])]
    return words


def require_same(folder, output, capsys, options):
    """Checks all files of a folder, which are solved together; gives the statuses."""
    solved([folder], output / "batch", **options)
    statuses = []
    for path in sorted(folder.iterdir()):
        found = record(output / "batch", f"{folder.name}/{path.name}") if path.suffix in MESH_SUFFIXES else None
        if found is None:
            continue
        where, alone = path.name, output / f"alone{path.suffix}"
        statuses.append(found["status"])
        capsys.readouterr()
        status, outcome = both_filled(path, alone, options)
        errors = capsys.readouterr().err
        if isinstance(outcome, SpinorGeomError):
            assert (status, found["status"], found["filled"]) == (2, "failed", None), where
            # both of the others name the file before the sentence
            assert printable(str(outcome)).endswith(found["reason"]), where
            assert " ".join(found["reason"].split()) in errors, (where, errors)
            continue
        _, result = outcome
        report = without_seconds(json.loads(json_text(result.to_dict())))
        told = json.loads(alone.with_suffix(".json").read_text(encoding="utf-8"))["notes"]
        report["notes"] = [note.removeprefix(f"{alone}: ") for note in told]
        for entry, expected in zip(without_seconds(found["loops"]), report.pop("loops"), strict=True):
            assert entry | expected == entry, where
        assert {key: found[key] for key in report} == report, where
        folder_of_results = output / "batch" / "files" / folder.name / path.name
        written = (folder_of_results / found["filled"]).read_bytes()
        # 3MF archives hold the time at which they were written
        if path.suffix == ".3mf":
            one, other = (read_mesh(file).mesh for file in (folder_of_results / found["filled"], alone))
            assert np.array_equal(one.vertices, other.vertices), where
            assert np.array_equal(one.faces, other.faces), where
        else:
            assert written == alone.read_bytes(), where
        if path.stem == "textured" and "merge" not in options:  # merged vertices lose their materials, which is told
            for folder_of_one in (folder_of_results, output):
                assert (folder_of_one / "skin.png").read_bytes() == b"an image"
        failed = any(loop["status"] == "failed" for loop in found["loops"])
        assert found["status"] == ("done" if status == 0 else "failed" if failed else "imperfect"), where
    return statuses


OPTIONS: list[Options] = [
    {},
    {"keep_largest": True, "edge_length": 0.2, "merge": True},
    {"loop": [1]},
    {"bridge": [0, 1]},
    {"islands": "join", "max_perimeter": 3.0, "tolerance": 1e-14, "strict": True},
]


@pytest.mark.parametrize("options", OPTIONS, ids=lambda options: ", ".join(options) or "none")
def test_options_do_the_same_in_both(shapes, tmp_path, capsys, options):
    statuses = require_same(shapes, tmp_path, capsys, options)
    assert len(statuses) == len(SHAPES)


def test_all_formats_are_filled_as_by_fill(shapes, tmp_path, capsys):
    folder = tmp_path / "formats"
    folder.mkdir()
    for suffix in MESH_SUFFIXES:
        read_mesh(shapes / "island.obj").write(folder / f"island{suffix}")
    assert len(require_same(folder, tmp_path, capsys, {})) == len(MESH_SUFFIXES)
