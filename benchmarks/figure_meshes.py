"""Every hole of every mesh file in a folder: how many are filled, how exactly, how fast; and where the time goes."""

from __future__ import annotations

import cProfile
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType

import numpy as np
from figure_tables import Figure, figure_table, note, short_reason

from spinor_geom import FillResult, SpinorGeomError, fill_hole, read_mesh
from spinor_geom.adapters.mesh_files import FORMATS
from spinor_geom.bench.tables import Table

SHIPPED = Path(__file__).parent.parent / "data"
NEAR, NEARER, NEAR_SHARE = 1e-2, 1e-3, 0.9  # RMS residuals per mean edge; share of all loops within the first
MESH_SECONDS = {"bunny_scan.ply": 5.0, "rangemap_lato000.ply": 15.0, "spot_cut.obj": 4.0}
STEPS = ("read", "solve", "mesh", "stitch", "all")
WORST_NAMED = 8
PROFILE_ROWS = 20


@dataclass(frozen=True, kw_only=True)
class MeshRecord:
    """What filling one mesh file gave.

    Attributes:
        file: The file's name.
        loops: Number of boundary loops; 0 where the mesh was refused whole.
        residuals: RMS residual per mean edge of every loop that was filled.
        reasons: Why a loop was left open, for every loop that was.
        refusal: Why the mesh was refused whole, or empty.
        watertight: Of the filled mesh.
        seconds: By step: "read" includes the search for loops, "mesh" the attributes.
    """

    file: str
    loops: int = 0
    residuals: tuple[float, ...] = ()
    reasons: tuple[str, ...] = ()
    refusal: str = ""
    watertight: bool = False
    seconds: dict[str, float]

    @property
    def name(self) -> str:
        """The file's name, marked where `data/` does not have it."""
        return self.file if (SHIPPED / self.file).exists() else f"{self.file} †"


def meshes(only: str, folder: Path) -> list[Table]:
    """Fills every hole of every mesh file of a folder that has `only` in its name, once each."""
    warm_up()
    records = []
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in FORMATS and only in path.name:
            note(path.name)
            record = filled_file(path)
            if record is not None:
                records.append(record)
    whole = MeshRecord(
        file="",
        loops=sum(record.loops for record in records),
        residuals=tuple(value for record in records for value in record.residuals),
        reasons=tuple(reason for record in records for reason in record.reasons),
        seconds={step: sum(record.seconds[step] for record in records) for step in STEPS},
    )
    closed = f"{sum(record.watertight for record in records)} of {len(records)}"
    columns = (
        "mesh",
        "loops",
        "filled",
        "within 1e-2",
        "within 1e-3",
        "worst",
        "watertight",
        *(f"{s} s" for s in STEPS),
    )
    rows = [row(record, record.name, "yes" if record.watertight else "no") for record in records]
    every = Table(title="Every hole of every mesh", columns=columns, rows=(*rows, row(whole, "**all**", closed)))
    reasons = tuple((record.name, *line) for record in records for line in shortfalls(record))
    why = Table(title="Loops refused, or filled beyond 1e-2", columns=("mesh", "loops", "why"), rows=reasons)
    return [figure_table("Meshes against the targets", targets(records, whole)), every, why]


def filled_file(path: Path) -> MeshRecord | None:
    """Fills all holes of a file; None where it has no faces or no holes."""
    start = time.perf_counter()
    try:
        file = read_mesh(path)
        read = time.perf_counter() - start
        if not len(file.mesh.faces):
            return None
        _, result = fill_hole(file, return_report=True)
    except SpinorGeomError as error:
        spent = time.perf_counter() - start
        return MeshRecord(
            file=path.name, refusal=str(error), seconds={**dict.fromkeys(STEPS, 0.0), "read": spent, "all": spent}
        )
    whole = time.perf_counter() - start
    if not result.loops:
        return None
    solutions = [outcome.solution for outcome in result.loops if outcome.filled]
    return MeshRecord(
        file=path.name,
        loops=len(result.loops),
        residuals=tuple(found.boundary_residual.rms_per_edge for found in solutions if found is not None),
        reasons=tuple(outcome.reason for outcome in result.loops if not outcome.filled),
        watertight=result.watertight,
        seconds=step_seconds(result, read, whole),
    )


def step_seconds(result: FillResult, read: float, whole: float) -> dict[str, float]:
    """Seconds of a fill by step; what a refused loop took before it was refused counts as solving."""

    def spent(*names: str) -> float:
        return sum(outcome.timings.get(name, 0.0) for outcome in result.loops for name in names)

    return {
        "read": read + result.timings["read"] + result.timings["loops"],
        "solve": spent("solve", "failed"),
        "mesh": spent("mesh", "attributes"),
        "stitch": result.timings["stitch"],
        "all": whole,
    }


def warm_up() -> None:
    """Fills a pyramid without its base, so that no mesh pays for imports."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]])
    fill_hole((vertices, np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])))


def row(record: MeshRecord, name: str, watertight: str) -> tuple[str, ...]:
    """A line of the table of meshes; shares are of all loops, refused ones included."""
    shares = [f"{within(record, limit) / record.loops:.1%}" if record.loops else "" for limit in (NEAR, NEARER)]
    worst = f"{max(record.residuals):.1e}" if record.residuals else ""
    times = [f"{record.seconds[step]:.2f}" for step in STEPS]
    return name, str(record.loops), str(len(record.residuals)), *shares, worst, watertight, *times


def within(record: MeshRecord, limit: float) -> int:
    """How many loops are filled to a residual."""
    return sum(value <= limit for value in record.residuals)


def targets(records: Sequence[MeshRecord], whole: MeshRecord) -> list[Figure]:
    """What is promised of all meshes together, and of single ones."""
    near = within(whole, NEAR)
    refused = sum(bool(record.refusal) for record in records)
    silent = whole.loops - len(whole.residuals) - sum(bool(reason) for reason in whole.reasons)
    figures = [
        Figure(
            case="all meshes",
            name="loops within 1e-2 of an edge",
            measured=f"{near} of {whole.loops}, {near} of the {len(whole.residuals)} filled",
            target=f"≥ {NEAR_SHARE:.0%}",
            met=whole.loops > 0 and near >= NEAR_SHARE * whole.loops,
        ),
        Figure(
            case="all meshes",
            name="loops neither filled nor refused with a reason",
            measured=f"{silent} ({len(whole.reasons)} loops refused, {refused} meshes refused whole)",
            target="0",
            met=silent == 0,
        ),
    ]
    timed = [record for record in records if record.file in MESH_SECONDS]
    return figures + [
        Figure.at_most(record.name, "seconds, whole", record.seconds["all"], MESH_SECONDS[record.file])
        for record in timed
    ]


def shortfalls(record: MeshRecord) -> list[tuple[str, str]]:
    """How many loops and why: a line for every reason to refuse a loop, then one for the fills that are far off."""
    if record.refusal:
        return [("all", short_reason(record.refusal))]
    reasons: dict[str, list[str]] = {}
    for reason in record.reasons:
        # the same reason with other numbers is the same reason
        reasons.setdefault(re.sub(r"\d[\d.e+-]*", "#", reason), []).append(short_reason(reason))
    lines = [(str(len(texts)), texts[0] + ("; …" if len(texts) > 1 else "")) for texts in reasons.values()]
    far = sorted((value for value in record.residuals if not value <= NEAR), reverse=True)
    if far:
        worst = ", ".join([f"{value:.1e}" for value in far[:WORST_NAMED]] + ["…"] * (len(far) > WORST_NAMED))
        lines.append((str(len(far)), f"filled, residuals {worst}"))
    return lines


def profile(path: Path) -> list[Table]:
    """The functions with the most time of their own while one mesh is filled; the profiler itself slows them down."""
    note(f"profile of {path.name}")
    warm_up()
    file = read_mesh(path)
    profiler = cProfile.Profile()
    profiler.runcall(fill_hole, file)
    entries = sorted(profiler.getstats(), key=lambda entry: -entry.inlinetime)[:PROFILE_ROWS]
    rows = tuple(
        (f"`{function_name(e.code)}`", str(e.callcount), f"{e.inlinetime:.3f}", f"{e.totaltime:.3f}") for e in entries
    )
    columns = ("function", "calls", "own s", "with callees s")
    return [Table(title=f"Profile of `fill_hole` on {path.name}", columns=columns, rows=rows)]


def function_name(code: CodeType | str) -> str:
    """Module and name of a profiled function, without the folders it lies in."""
    if isinstance(code, str):
        return re.sub(r" at 0x[0-9a-f]+", "", code).strip("<>")
    file = Path(code.co_filename)
    return f"{file.parent.name if file.stem == '__init__' else file.stem}.{code.co_name}"
