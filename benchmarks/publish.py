"""Publishes a run of `spinor-geom bench` in this folder: CSV files, the tables in README.md, and the picture.

`python benchmarks/publish.py RUN` takes the folder of a run; its records replace those of the same suite, case, method
and number of points. Without a run only the tables are written again, from the CSV files.
"""

import argparse
import ast
import csv
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from spinor_geom.bench.cases import known_kind
from spinor_geom.bench.machine import Record, is_older
from spinor_geom.bench.measured import DISTANCE
from spinor_geom.bench.promises import LEAST_POINTS, Promise, promises
from spinor_geom.bench.run_tables import LOCAL, csv_text, filler_table, method_name, pieces_of, scale_of
from spinor_geom.bench.runner import PICTURED, SUITES, VIEWS, read_records
from spinor_geom.files import atomic_path, write_text
from spinor_geom.render.portrait import Portrait
from spinor_geom.render.tables import Table

HERE = Path(__file__).parent
README, PICTURE = HERE / "README.md", HERE.parent / "docs" / "cut-outs.png"
BEGIN, END = "<!-- tables: begin (written by publish.py) -->", "<!-- tables: end -->"
POINTS = 64  # of the loops in the table of disks
ADVISED = ("squiggle", "fin", "facing-triangles")  # odd rims for which docs/choosing.md recommends a filler
LEFT_OUT = ("message", "expected", *LOCAL)  # fields that are too long for a table, or of this machine


def main(arguments: Sequence[str] | None = None) -> None:
    """Publishes a run, or writes the tables only."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", nargs="?", type=Path, metavar="RUN", help="folder of a run")
    run = parser.parse_args(arguments).run
    if run is not None:
        publish(read_records(run))
        if folders := [run / VIEWS / case for case in PICTURED if (run / VIEWS / case).is_dir()]:
            draw(folders)
    before, rest = README.read_text(encoding="utf-8").split(BEGIN)
    text = "\n\n".join(table.markdown() for table in page_tables([r for suite in SUITES for r in read(suite)]))
    write_text(README, f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.split(END)[1]}")


def publish(records: Sequence[Record]) -> None:
    """Adds records to the CSV of their suites, with four digits."""
    for suite in dict.fromkeys(r["suite"] for r in records):
        whole = {key(r): r for r in read(suite)}
        for record in records:
            if record["suite"] == suite and is_used(record):
                kept = {name: value for name, value in record.items() if name not in LEFT_OUT}
                short = {name: float(f"{v:.4g}") if isinstance(v, float) else v for name, v in kept.items()}
                short["case"] = record["case"].rpartition("/")[2]
                whole[key(short)] = short
        write_text(HERE / f"{suite}.csv", csv_text(list(whole.values())))


def is_used(record: Record) -> bool:
    """Whether a table here, a promise or a statement in the documentation uses a record."""
    ours, suite = "spinor" in record["method"], record["suite"]
    if record["status"] == "missing":
        return False
    if suite == "disks":
        compared = "libigl" in record["method"] and known_kind(record["case"]) == "smooth"
        return record["n"] >= LEAST_POINTS and (ours or compared)
    if suite == "odd":
        return ours or record["case"] in ADVISED or record.get("area_error") is not None
    return ours or suite not in ("ragged", "meshes")


def key(record: Record) -> tuple[object, ...]:
    """The identifier of a measurement, equal for records that replace each other."""
    return tuple(record.get(name) for name in ("suite", "case", "method", "n"))


def read(suite: str) -> list[Record]:
    """The published records of a suite, without the fields of empty cells."""
    path = HERE / f"{suite}.csv"
    if not path.exists():
        return []
    with open(path, encoding="utf-8", newline="") as file:
        return [{name: _value(text) for name, text in row.items() if text} for row in csv.DictReader(file)]


def _value(text: str) -> object:
    """A cell as a number or boolean if it is one, else as text."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


def page_tables(records: Sequence[Record]) -> list[Table]:
    """The tables in `README.md`."""
    found = promises(records)
    missed: dict[tuple[str, str], list[Promise]] = defaultdict(list)
    for figure in found:
        if not figure.met and figure.kind == "accuracy":
            missed[figure.suite, figure.text].append(figure)
    rows = [
        (suite, ", ".join(f.case for f in of_text), text, " / ".join(f.measured for f in of_text))
        for (suite, text), of_text in missed.items()
    ]
    return [
        Table(
            title="Suites",
            columns=("suite", "measured", "commits", "dates", "loads", "older", "promises kept", "times kept"),
            rows=[suite_row(suite, records, found) for suite in SUITES],
            note="Older: measurements of our methods whose code has changed since their commit; marked † below.",
        ),
        Table(title="Promises missed", columns=("suite", "case", "promise", "measured"), rows=rows),
        disk_table([r for r in records if r["suite"] == "disks"]),
        filler_table([r for r in records if r["suite"] == "cut-outs"]),
    ]


def suite_row(suite: str, records: Sequence[Record], found: Sequence[Promise]) -> tuple[str, ...]:
    """The number of records, their dates and loads, and the numbers of promises that are kept."""
    here = [r for r in records if r["suite"] == suite]
    commits = dict.fromkeys(str(r["commit"]).rpartition("+g")[2] for r in here)
    loads = [r["load"] for r in here if r.get("load") is not None]
    kept = []
    for kind in ("accuracy", "time"):
        met = [f.met for f in found if f.suite == suite and f.kind == kind]
        kept.append(f"{sum(met)} of {len(met)}" if met else "")
    dates = _range([str(r["date"]) for r in here])
    older = str(sum(map(is_older, here)))
    return (f"[{suite}]({suite}.csv)", str(len(here)), ", ".join(commits), dates, _range(loads), older, *kept)


def _range(values: Sequence[str] | Sequence[float]) -> str:
    """The least and the largest value."""
    if not values:
        return "not kept"
    return " to ".join(dict.fromkeys(v if isinstance(v, str) else f"{v:g}" for v in (min(values), max(values))))


def disk_table(disks: Sequence[Record]) -> Table:
    """Our disks over smooth cases in three samplings; their meshes compared with uniform discrete surfaces."""
    of = {(r["case"], r["n"], r["method"]): r for r in disks}
    rows = []
    for (case, n, method), mine in of.items():
        other = of.get((case, n, "libigl-uniform"))
        if method != "spinor" or n != POINTS or other is None or "@" in case or known_kind(case) != "smooth":
            continue
        samplings = [of.get((f"{case}{sampling}", n, "spinor"), {}) for sampling in ("", "@even", "@uneven")]
        surface = [_numbers(samplings, name) for name in ("area_error", "limit_error", "surface_distance_max")]
        names = ("triangles", "mesh_area_error", "distance_max", "curvature_rms", "seconds")
        meshes = [_numbers((mine, other), name) for name in names]
        rows.append((f"{case}{method_name(mine).removeprefix(method)}", *surface, *meshes))
    meshed = ("triangles", "mesh area error", "distance max", "curvature rms", "seconds")
    return Table(
        title=f"Disks over smooth curves of {POINTS} points",
        columns=("case", "area error", "limit error", "surface distance max", *meshed),
        rows=rows,
        note="Columns of our surface: points at the formula's steps / equally far apart / at edges of random lengths. "
        "Columns of meshes, with points at the formula's steps: ours / that of libigl-uniform.",
    )


def _numbers(records: Sequence[Record], name: str) -> str:
    """A field of several records in one cell."""
    values = [record.get(name) for record in records]
    return " / ".join("–" if v is None else f"{v:.2g}" if isinstance(v, float) else str(v) for v in values)


def draw(folders: Sequence[Path]) -> None:
    """Draws a row for each cut-out: the removed piece and the patches, coloured by distance (yellow: far)."""
    side, strips = 220, []
    with tempfile.TemporaryDirectory() as place:
        for folder in folders:
            pieces = pieces_of(folder)
            scale = scale_of(pieces)
            first, *others = (
                Portrait.of_mesh(
                    piece.vertices, piece.faces, {DISTANCE: np.clip(piece.fields[DISTANCE], scale.low, scale.high)}
                )
                for piece in pieces.values()
            )
            path = Path(place) / f"{folder.name}.png"
            first.beside(*others).write(path, eye=(0.0, -2.0, 1.3), size=(side * len(pieces), side))
            strips.append(Image.open(path).convert("RGB"))
    whole = Image.new("RGB", (max(strip.width for strip in strips), side * len(strips)), "white")
    for k, strip in enumerate(strips):
        whole.paste(strip, (0, side * k))
    with atomic_path(PICTURE) as temporary:
        whole.quantize(128).save(temporary, format="PNG", optimize=True)


if __name__ == "__main__":
    main()
