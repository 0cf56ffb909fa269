"""Measures and writes the figures of `README.md`, `docs/benchmark.md` and this folder, in about 40 minutes.

`python benchmarks/publish.py RUN` measures into the folder RUN, where a stopped command continues. The records become
the CSV files here and the tables and plots between the markers of the three pages.
"""

import argparse
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

from PIL import Image

from spinor_geom.bench.cases import KNOWN, REFERENCE_CASE
from spinor_geom.bench.fillers import FILLERS, OURS, SMOOTH, SMOOTHEST
from spinor_geom.bench.frames import FRAME_METHODS
from spinor_geom.bench.machine import Record
from spinor_geom.bench.measured import DISTANCE, REMOVED
from spinor_geom.bench.plots import plots
from spinor_geom.bench.promises import Promise, promises
from spinor_geom.bench.run_tables import csv_text, filler_table, pieces_of, scale_of, summary_table
from spinor_geom.bench.runner import PICTURED, SUITES, VIEWS, Run, Settings, measure
from spinor_geom.files import atomic_path, together, write_text
from spinor_geom.render.page import Table
from spinor_geom.render.png import write_png
from spinor_geom.render.portrait import Portrait
from spinor_geom.render.scene import Faces, Scene

ROOT = Path(__file__).parents[1]
POINTS = 64  # of loops where one number is enough
LEFT_OUT = ("message", "expected")  # fields that are too long for a table
SLOW = ("meshlab-close-refined", "meshlab-close-smoothed")  # have ten seconds for each hole
CAPS = ("icosphere-4-0.85", "icosphere-4-0.7", "icosphere-4-0.3", "icosphere-4-0")
# each tool of the table in the README, with options for minimal and for smooth patches
TOOLS: Mapping[str, tuple[str, str]] = {
    "spinor_geom": (OURS, SMOOTH),
    "MeshLib": ("meshlib-nicely", "meshlib-nicely"),
    "CGAL": ("cgal-fair", "cgal-fair-2"),
    "MeshLab": ("meshlab-close-refined", "meshlab-close-smoothed"),
    "PyMeshFix": ("pymeshfix", "pymeshfix-refined"),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures what the folder lacks, and writes the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of the run")
    parser.add_argument("--data", type=Path, default=ROOT / "data", metavar="FOLDER", help="mesh files (default: data)")
    options = parser.parse_args(arguments)
    write(measured(options.run, settings(options.data)))


def settings(data: Path) -> list[Settings]:
    """What is measured: all suites, with fewer points and tools where the pages need no more."""
    common: dict[str, Any] = {"data": data, "repeat": 1, "time_limit": 30.0}
    compared = tuple(dict.fromkeys(method for methods in TOOLS.values() for method in methods if method not in SLOW))

    def part(suite: str, **more: Any) -> Settings:
        return Settings(suites=(suite,), **{**common, **more})

    return [
        part("disks", methods=("spinor", "libigl", "libigl-uniform")),
        part("fills", cases=(REFERENCE_CASE,), methods=tuple(method for method in FILLERS if method not in SLOW)),
        part("fills", cases=tuple(KNOWN), methods=compared, hole_points=(POINTS,)),
        part("fills", cases=(REFERENCE_CASE,), methods=SLOW, time_limit=10.0),
        *(part(suite, methods=compared) for suite in ("odd", "reports", "meshes")),
        part("cut-outs", methods=tuple(method for method in SMOOTHEST if method not in SLOW)),
        part("cut-outs", methods=SLOW[1:], time_limit=10.0),
        part("cad"),
    ]


def measured(folder: Path, parts: Sequence[Settings]) -> Run:
    """One run of several parts, which are measured unless the folder has them."""

    def show(record: Record, done: int, total: int) -> None:
        print(f"{done}/{total} {record['suite']} {record['method']} {Path(record['case']).name}", flush=True)

    runs = [measure(part, folder, on_record=show) for part in parts]
    records = {r["key"]: r for run in runs for r in run.records}  # parts may overlap
    return Run(folder=folder, description=runs[-1].description, records=list(records.values()))


def write(run: Run) -> None:
    """Writes CSV files, plots, picture and the pages' tables, all or none."""
    records = [{**r, "case": Path(r["case"]).name} for r in run.records if r["status"] != "missing"]
    about, drawn, place = source(records, run.description["machine"]), plots(records), ROOT / "docs" / "bench"
    of = {suite: [r for r in records if r["suite"] == suite] for suite in SUITES}
    page = [summary_table(records), *promise_tables(of), filler_table(of["cut-outs"])]
    pictured = [run.folder / VIEWS / case for case in PICTURED if (run.folder / VIEWS / case).is_dir()]
    picture = drawing(pictured) if pictured else None
    place.mkdir(exist_ok=True)
    with together():
        for suite, here in of.items():
            write_text(ROOT / "benchmarks" / f"{suite}.csv", csv_text([short(r) for r in here]))
        for plot in drawn:
            with atomic_path(place / f"{plot.name}.png") as path:
                path.write_bytes(plot.png())
        if picture is not None:
            with atomic_path(ROOT / "docs" / "cut-outs.png") as path:
                picture.save(path, format="PNG", optimize=True)
        put("README.md", comparison=[readme_table(records).markdown(), about])
        put(
            "docs/benchmark.md",
            plots=[about, *(plot.markdown("bench") for plot in drawn)],
            areas=[area_table(records).markdown(), about],
            frames=[frame_table(of["cad"]).markdown(), about],
        )
        put("benchmarks/README.md", tables=[about, *(table.markdown() for table in page)])


def put(page: str, **blocks: Sequence[str]) -> None:
    """Replaces the texts between the markers of a page."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for name, parts in blocks.items():
        begin, end = (f"<!-- {name}: {edge} (benchmarks/publish.py) -->" for edge in ("begin", "end"))
        before, rest = text.split(begin)
        text = "\n\n".join([before + begin, *parts, end]) + rest.split(end)[1]
    write_text(ROOT / page, text)


def short(record: Record) -> Record:
    """A record with four digits and without long texts."""
    return {k: float(f"{v:.4g}") if isinstance(v, float) else v for k, v in record.items() if k not in LEFT_OUT}


def source(records: Sequence[Record], machine: Mapping[str, Any]) -> str:
    """The commit, the date and the machine of the records, in a sentence."""
    commits = ", ".join(dict.fromkeys(str(r["commit"]).rpartition("+g")[2] for r in records))
    dates, loads = (
        " to ".join(dict.fromkeys((str(min(values)), str(max(values)))))
        for values in ([r["date"] for r in records], [r["load"] for r in records])
    )
    here = f"{machine['processor']}, {machine['cores']} cores, one thread, load {loads}, Python {machine['python']}"
    return f"Measured at commit {commits}, {dates}, on {here}."


def readme_table(records: Sequence[Record]) -> Table:
    """A column for each tool, a row for each figure."""
    done = [r for r in records if r["status"] == "done"]
    cut_outs, meshes = ([r for r in done if r["suite"] == suite] for suite in ("cut-outs", "meshes"))
    disks = [r for r in cut_outs if r["kind"] == "scan"]

    def row(text: str, smooth: bool, figure: Callable[[str], str]) -> tuple[str, ...]:
        return text, *(figure(methods[smooth]) for methods in TOOLS.values())

    def middle(here: Sequence[Record], field: str) -> Callable[[str], str]:
        return lambda m: _figure([r[field] for r in here if r["method"] == m and r.get(field) is not None])

    def seconds(method: str) -> str:
        at = {n: _figure([r["seconds"] for r in _rim(done, method, n)]) for n in (64, 1000)}
        return f"{at[64]} ({at[1000]})"

    whole = "seconds, {} {} (median)"
    return Table(
        columns=("", *TOOLS),
        rows=[
            row("smooth rim of 64 points: error of the patch's area", False, lambda m: _excess(_rim(done, m, 64))),
            row("cap of the unit sphere above z = 0.3, C1: RMS distance", True, lambda m: _cap(cut_outs, m, CAPS[2])),
            row(f"{_count(disks)} disks cut out of scans, C1: median distance", True, middle(disks, "distance")),
            row("seconds, smooth rim of 64 (1,000) points", False, seconds),
            row(whole.format(_count(cut_outs), "cut-outs, C1"), True, middle(cut_outs, "seconds")),
            row(whole.format(_count(meshes), "whole meshes"), False, middle(meshes, "seconds")),
        ],
    )


def area_table(records: Sequence[Record]) -> Table:
    """Areas, seconds and distances of caps for each filler."""
    done = [r for r in records if r["status"] == "done"]
    cut_outs, sizes = [r for r in done if r["suite"] == "cut-outs"], (64, 256, 1000)
    rows = []
    for method in FILLERS:
        rims = [_rim(done, method, n) for n in sizes]
        caps = [_cap(cut_outs, method, cap) for cap in CAPS]
        if any(rims) or any(cap != "–" for cap in caps):
            seconds = ", ".join(_figure([r["seconds"] for r in rim]) for rim in rims)
            rows.append((method, ", ".join(map(_excess, rims)), seconds, ", ".join(caps)))
    return Table(
        columns=("filler", "area compared with the exact one", "seconds", "distance from the sphere"), rows=rows
    )


def frame_table(cad: Sequence[Record]) -> Table:
    """Shells over CAD edges: ours, and Open CASCADE's filling with default and with finer settings."""
    of = {(r["case"], r["method"]): r for r in cad if r["status"] == "done"}
    rows = []
    for case in dict.fromkeys(case for case, _ in of):
        here = [of.get((case, method), {}) for method in FRAME_METHODS]
        names = ("area_error", "rim_distance", "faces", "file_kib", "cpu_seconds")
        rows.append((f"`{case}`", *(_numbers(here, name) for name in names)))
    columns = (
        "frame",
        "area error",
        "distance of the rim per diameter",
        "faces",
        "STEP file in KiB",
        "processor seconds",
    )
    return Table(columns=columns, rows=rows)


def promise_tables(of: Mapping[str, Sequence[Record]]) -> Iterator[Table]:
    """The numbers of records and of promises that are kept, and the promises that are missed."""
    found = promises([r for here in of.values() for r in here])
    rows = [
        (f"[{suite}]({suite}.csv)", str(len(here)), _kept([f for f in found if f.suite == suite]))
        for suite, here in of.items()
    ]
    yield Table(title="Suites", columns=("suite", "measured", "promises kept"), rows=rows)
    missed: dict[tuple[str, str], list[Promise]] = defaultdict(list)
    for figure in found:
        if not figure.met:
            missed[figure.suite, figure.text].append(figure)
    columns = ("suite", "case", "promise", "measured")
    texts = [
        (suite, ", ".join(f.case for f in of_text), text, " / ".join(f.measured for f in of_text))
        for (suite, text), of_text in missed.items()
    ]
    yield Table(title="Promises missed", columns=columns, rows=texts)


def _kept(found: Sequence[Promise]) -> str:
    return f"{sum(figure.met for figure in found)} of {len(found)}" if found else ""


def _rim(done: Sequence[Record], method: str, n: int) -> list[Record]:
    """The fill of the reference's rim with n points, if the filler closes it."""
    found = [r for r in done if (r["suite"], r["case"], r["method"], r["n"]) == ("fills", REFERENCE_CASE, method, n)]
    return [r for r in found if not r["open_rim_edges"]]


def _excess(rim: Sequence[Record]) -> str:
    if not rim:
        return "–"
    percent = 100 * rim[0]["area_excess"]
    return f"{percent:{'+.0f' if abs(percent) >= 10 else '+.2g'}} %".replace("-", "−")


def _cap(cut_outs: Sequence[Record], method: str, cap: str) -> str:
    """RMS distance of the new vertices, or of the triangles without new vertices, from the unit sphere."""
    return _figure([r["distance"] * r["diameter"] for r in cut_outs if (r["case"], r["method"]) == (cap, method)])


def _figure(values: Sequence[float]) -> str:
    return f"{median(values):.2g}" if values else "–"


def _count(records: Sequence[Record]) -> int:
    return len({r["case"] for r in records})


def _numbers(records: Sequence[Record], name: str) -> str:
    """A field of several records in one cell."""
    values = [record.get(name) for record in records]
    return " / ".join("–" if v is None else f"{v:.2g}" if isinstance(v, float) else str(v) for v in values)


def drawing(folders: Sequence[Path]) -> Image.Image:
    """A row for each cut-out: the removed piece and the patches, coloured by distance (yellow: far)."""
    rows = [pieces_of(folder) for folder in folders]
    columns = list(dict.fromkeys(name for pieces in rows for name in pieces))
    size, strips = (220 * len(columns), 220), []
    with tempfile.TemporaryDirectory() as place:
        for folder, pieces in zip(folders, rows, strict=True):
            path, scales = Path(place) / f"{folder.name}.png", {DISTANCE: scale_of(pieces)}
            drawn = {name: _portrait(piece) for name, piece in pieces.items()}
            open_hole = replace(drawn[REMOVED], layers=drawn[REMOVED].layers[1:])
            scenes = [replace(drawn.get(name, open_hole), title=name, scales=scales) for name in columns]
            write_png(scenes, path, size=size)
            strips.append(Image.open(path).convert("RGB"))
    whole = Image.new("RGB", (size[0], size[1] * len(strips)), "white")
    for k, strip in enumerate(strips):
        whole.paste(strip, (0, size[1] * k))
    return whole.quantize(128)


def _portrait(piece: Faces) -> Scene:
    return Portrait.of_mesh(piece.vertices, piece.faces, piece.fields).scene(eye=(0.0, -2.0, 1.3), size=(1, 1))


if __name__ == "__main__":
    main()
