"""Puts a run of `spinor-geom bench` beside this script: CSV of every measurement, the page's tables, the picture.

`python benchmarks/publish.py RUN` takes the folder of a run; its records take the places of those of the same suite,
case, method and size. Without a run the page is made anew from the CSV: rows of ours whose code has changed are marked.
"""

import argparse
import csv
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from spinor_geom.bench.cases import known_kind
from spinor_geom.bench.claims import LEAST_POINTS, Figure, claims
from spinor_geom.bench.machine import Record, is_older
from spinor_geom.bench.page import LOCAL, OLDER, Table, filler_table, pieces_of, scale_of, table_of
from spinor_geom.bench.runner import PICTURED, SUITES, VIEWS, read_records
from spinor_geom.bench.worker import DISTANCE
from spinor_geom.files import atomic_path, write_text
from spinor_geom.render.portrait import Portrait

HERE = Path(__file__).parent
README, PICTURE = HERE / "README.md", HERE.parent / "docs" / "cut-outs.png"
BEGIN, END = "<!-- tables: begin (written by publish.py) -->", "<!-- tables: end -->"
COLOURS, SIDE, EYE, POINTS = 128, 220, (0.0, -2.0, 1.3), 64
SAME = ("suite", "case", "method", "n")  # of two records makes them one measurement
ADVISED = ("squiggle", "fin", "facing-triangles")  # odd rims that docs/choosing.md advises on
LEFT_OUT = ("told", "expected", *LOCAL)  # too long for a table, or of this machine


def main(arguments: Sequence[str] | None = None) -> None:
    """Publishes a run, or the page alone."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", nargs="?", type=Path, metavar="RUN", help="folder of a run")
    run = parser.parse_args(arguments).run
    if run is not None:
        publish(read_records(run))
        if folders := [run / VIEWS / case for case in PICTURED if (run / VIEWS / case).is_dir()]:
            draw(folders)
    before, rest = README.read_text(encoding="utf-8").split(BEGIN)
    text = "\n\n".join(map(str, page_tables([record for suite in SUITES for record in read(suite)])))
    write_text(README, f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.split(END)[1]}")


def publish(records: Sequence[Record]) -> None:
    """Adds records to the CSV of their suites."""
    for suite in dict.fromkeys(r["suite"] for r in records):
        whole = {key(r): r for r in read(suite)}
        for record in records:
            if record["suite"] == suite and is_read(record):
                kept = {name: value for name, value in record.items() if name not in LEFT_OUT}
                short = {name: float(f"{v:.4g}") if isinstance(v, float) else v for name, v in kept.items()}
                short["case"] = record["case"].rpartition("/")[2]
                whole[key(short)] = short
        write_text(HERE / f"{suite}.csv", table_of(side_by_side(list(whole.values()))))


def is_read(record: Record) -> bool:
    """Whether a table here, a promise or a statement of the docs looks at a row: at most of ours, at some of others."""
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
    """What makes a record another one."""
    return tuple(record.get(name) for name in SAME)


def side_by_side(records: Sequence[Record]) -> list[Record]:
    """A row a case: the fields in which all methods agree, then "METHOD FIELD" for each of the others."""
    rows: dict[tuple[object, ...], list[Record]] = {}
    for record in records:
        rows.setdefault((record["case"], record.get("n")), []).append(record)
    names = dict.fromkeys(name for record in records for name in record)
    shared = [name for name in names if all(len({str(r.get(name)) for r in row}) == 1 for row in rows.values())]
    own = [name for name in names if name not in (*shared, "method")]
    made = []
    for row in rows.values():
        alone = {f"{r['method']} {name}": r.get(name) for r in row for name in own}
        made.append({name: row[0].get(name) for name in shared} | alone)
    return made


def read(suite: str) -> list[Record]:
    """The records of a suite; empty cells are no fields."""
    path = HERE / f"{suite}.csv"
    if not path.exists():
        return []
    records: list[Record] = []
    with open(path, encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            shared, own = dict[str, object](), dict[str, Record]()
            for name, text in row.items():
                method, of_one, field = name.partition(" ")
                if text != "":
                    (own.setdefault(method, {"method": method}) if of_one else shared)[field or name] = parsed(text)
            records += [{**shared, **fields} for fields in own.values()] or [shared]
    return records


def parsed(text: str) -> object:
    """A cell's value."""
    if text in ("True", "False"):
        return text == "True"
    try:
        number = float(text)
    except ValueError:
        return text
    return int(text) if text.lstrip("-").isdigit() else number


def page_tables(records: Sequence[Record]) -> list[Table]:
    """What stands on the page."""
    found = claims(records)
    missed: dict[tuple[str, str], list[Figure]] = defaultdict(list)
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
            rows=tuple(suite_row(suite, records, found) for suite in SUITES),
            note="Older: those of ours whose code has changed since their commit; marked † below.",
        ),
        Table(title="Promises missed", columns=("suite", "case", "promise", "measured"), rows=rows),
        disk_table([r for r in records if r["suite"] == "disks"]),
        filler_table([r for r in records if r["suite"] == "cut-outs"]),
    ]


def suite_row(suite: str, records: Sequence[Record], found: Sequence[Figure]) -> tuple[str, ...]:
    """How much was measured, when and at which load, and which promises are kept."""
    here = [r for r in records if r["suite"] == suite]
    commits, dates = (list(dict.fromkeys(str(r[name]) for r in here)) for name in ("commit", "date"))
    loads = [r["load"] for r in here if r.get("load") is not None]
    kept = []
    for kind in ("accuracy", "time"):
        mine = [f.met for f in found if f.suite == suite and f.kind == kind]
        kept.append(f"{sum(mine)} of {len(mine)}" if mine else "")
    return (
        f"[{suite}]({suite}.csv)",
        str(len(here)),
        ", ".join(commit.rpartition("+g")[2] for commit in commits),
        " to ".join(dict.fromkeys((min(dates, default=""), max(dates, default="")))),
        " to ".join(dict.fromkeys(f"{load:g}" for load in (min(loads), max(loads)))) if loads else "not kept",
        str(sum(map(is_older, here))),
        *kept,
    )


def disk_table(disks: Sequence[Record]) -> Table:
    """Ours on smooth cases beside uniform discrete surfaces: three samplings, and meshes of like sizes."""
    of = {(r["case"], r["n"], r["method"]): r for r in disks}
    rows = []
    for (case, n, method), mine in of.items():
        other = of.get((case, n, "libigl-uniform"))
        if method != "spinor" or n != POINTS or other is None or "@" in case or known_kind(case) != "smooth":
            continue
        samplings = [of.get((f"{case}{sampling}", n, "spinor"), {}) for sampling in ("", "@even", "@uneven")]
        surface = (
            " / ".join(number(r.get(name)) for r in samplings)
            for name in ("area_error", "limit_error", "surface_distance_max")
        )
        names = ("triangles", "mesh_area_error", "distance_max", "curvature_rms", "seconds")
        meshes = (" / ".join(number(r.get(name)) for r in (mine, other)) for name in names)
        rows.append((f"{case}{f' {OLDER}' if is_older(mine) else ''}", *surface, *meshes))
    meshed = ("triangles", "mesh area error", "distance max", "curvature rms", "seconds")
    return Table(
        title=f"Disks over smooth curves of {POINTS} points",
        columns=("case", "area error", "limit error", "surface distance max", *meshed),
        rows=tuple(rows),
        note="Of our surface: points at the formula's steps / equally far apart / at edges of random lengths. "
        "Of meshes, at the formula's steps: ours / libigl-uniform's.",
    )


def number(value: object) -> str:
    """A number in a cell."""
    return "–" if value is None else f"{value:.2g}" if isinstance(value, float) else str(value)


def draw(folders: Sequence[Path]) -> None:
    """The picture: a line a cut-out, what was removed and what the fillers put there, yellow the farthest away."""
    strips = []
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
            first.beside(*others).write(path, eye=EYE, size=(SIDE * len(pieces), SIDE))
            strips.append(Image.open(path).convert("RGB"))
    whole = Image.new("RGB", (max(strip.width for strip in strips), SIDE * len(strips)), "white")
    for place, strip in enumerate(strips):
        whole.paste(strip, (0, SIDE * place))
    with atomic_path(PICTURE) as temporary:
        whole.quantize(COLOURS).save(temporary, format="PNG", optimize=True)


if __name__ == "__main__":
    main()
