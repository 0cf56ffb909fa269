"""Seconds and memory of a solve: smooth loops and rough ones, from few vertices to thousands."""

from __future__ import annotations

import multiprocessing
import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection

from figure_curves import measured_rms_per_edge, timed_solve
from figure_tables import Figure, figure_table, note, short_reason

from spinor_geom import BoundaryLoop, SpinorGeomError, gallery
from spinor_geom.bench.tables import Table

SMOOTH_SECONDS = {64: 0.05, 256: 0.08, 1000: 0.3, 5000: 2.0}
ROUGH_SECONDS = {300: 1.0, 1000: 8.0, 5000: 60.0}
USUAL, NEAR = 1e-3, 1e-2  # RMS distance per mean edge that smooth and rough loops are solved to
NOISE = 0.15  # of a mean edge
MEMORY = 6.0  # GiB
RUNS, ENOUGH_SECONDS, LIMIT_SECONDS = 5, 60.0, 900.0


@dataclass(frozen=True, kw_only=True)
class SpeedCase:
    """A loop to be timed.

    Attributes:
        name: What it is.
        loop: Makes it; called in the process that solves it.
        tolerance: RMS distance per mean edge it is solved to.
        seconds: How long that may take.
    """

    name: str
    loop: Callable[[], BoundaryLoop]
    tolerance: float
    seconds: float


@dataclass(frozen=True, kw_only=True)
class SpeedRecord:
    """What the solves of one loop took.

    Attributes:
        seconds: Of each counted solve.
        stages: Medians of the stages' seconds.
        rms: RMS distance from Γ per mean edge.
        memory: The process's peak after the solves, in GiB.
        refusal: Why there is no solution, or empty.
    """

    seconds: tuple[float, ...] = ()
    stages: dict[str, float]
    rms: float = float("nan")
    memory: float = float("nan")
    refusal: str = ""


def speed(only: str) -> list[Table]:
    """Times solves of loops with `only` in their names, whole and by stage, each loop in a process of its own."""
    figures: list[Figure] = []
    measured: list[tuple[str, SpeedRecord]] = []
    for case in cases():
        if only not in case.name:
            continue
        note(case.name)
        record = in_own_process(case)
        if record.refusal:
            told = f"none: {short_reason(record.refusal)}"
            figures.append(Figure(case=case.name, name="solution", measured=told, target="one", met=False))
            continue
        figures += record_figures(case, record)
        measured.append((case.name, record))
    stages = tuple(dict.fromkeys(stage for _, record in measured for stage in record.stages))
    rows = tuple((name, *(f"{record.stages.get(stage, 0.0):.3f}" for stage in stages)) for name, record in measured)
    return [
        figure_table("Solve of a loop, first fill to solution", figures),
        Table(title="Seconds of a solve by stage, medians", columns=("case", *stages), rows=rows),
    ]


def cases() -> list[SpeedCase]:
    """All loops that are timed."""
    ellipse = gallery.ellipse(2.0, 0.3)
    smooth = [
        SpeedCase(name=f"{curve.name}, {n} vertices", loop=partial(smooth_loop, k, n), tolerance=USUAL, seconds=seconds)
        for k, curve in enumerate(smooth_curves())
        for n, seconds in SMOOTH_SECONDS.items()
    ]
    rough = [
        SpeedCase(
            name=f"{ellipse.name}, {n} vertices, {NOISE:.0%} noise",
            loop=partial(rough_loop, n),
            tolerance=NEAR,
            seconds=seconds,
        )
        for n, seconds in ROUGH_SECONDS.items()
    ]
    return smooth + rough


def smooth_curves() -> tuple[gallery.KnownCurve, ...]:
    """The curves that are timed without noise."""
    return gallery.twisted_circle(), gallery.ellipse(2.0, 0.3), gallery.tennis_seam(0.8)


def smooth_loop(place: int, vertices: int) -> BoundaryLoop:
    """A sample of one of the smooth curves."""
    return smooth_curves()[place].sample(vertices)


def rough_loop(vertices: int) -> BoundaryLoop:
    """An even sample of a saddle-shaped ellipse with vertex noise."""
    return gallery.noisy_loop(gallery.evenly_sampled(gallery.ellipse(2.0, 0.3), vertices), NOISE, seed=0)


def in_own_process(case: SpeedCase) -> SpeedRecord:
    """Solves a loop in a fresh process, whose peak memory is that loop's; ended where it takes far too long."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=send_record, args=(case, sender))
    process.start()
    sender.close()
    try:
        if receiver.poll(LIMIT_SECONDS):
            record = receiver.recv()
            assert isinstance(record, SpeedRecord)
            return record
        return SpeedRecord(stages={}, refusal=f"not solved in {LIMIT_SECONDS:g} s")
    except EOFError:
        process.join()
        return SpeedRecord(stages={}, refusal=f"the process ended with status {process.exitcode}")
    finally:
        process.terminate()
        process.join()


def send_record(case: SpeedCase, sender: Connection) -> None:
    """What the process of a case does."""
    try:
        record = timed_record(case)
    except SpinorGeomError as error:
        record = SpeedRecord(stages={}, refusal=str(error))
    sender.send(record)
    sender.close()


def timed_record(case: SpeedCase) -> SpeedRecord:
    """Solves a loop several times, after one solve of another loop and one of this that are not counted.

    Where that takes long there are fewer runs, and the first counts too.
    """
    timed_solve(gallery.twisted_circle().sample(32), USUAL)
    loop = case.loop()
    runs = [timed_solve(loop, case.tolerance)]
    while len(runs) < RUNS + 1 and sum(seconds for _, seconds in runs) < ENOUGH_SECONDS:
        runs.append(timed_solve(loop, case.tolerance))
    memory = peak_memory()
    counted = runs[1:] or runs
    solution = counted[0][0]
    return SpeedRecord(
        seconds=tuple(seconds for _, seconds in counted),
        stages={
            stage: statistics.median(solution.timings.get(stage, 0.0) for solution, _ in counted)
            for stage in solution.timings
        },
        rms=measured_rms_per_edge(solution),
        memory=memory,
    )


def peak_memory() -> float:
    """The process's peak resident memory, in GiB; not a number on systems that do not tell."""
    try:
        import resource
    except ImportError:
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2 ** (30 if sys.platform == "darwin" else 20)


def record_figures(case: SpeedCase, record: SpeedRecord) -> list[Figure]:
    """The figures of one loop beside their targets."""
    runs = len(record.seconds)
    name = f"seconds, median of {runs}" if runs > 1 else "seconds"
    figures = [
        Figure.at_most(case.name, name, statistics.median(record.seconds), case.seconds),
        Figure.at_most(case.name, "RMS distance from Γ / mean edge", record.rms, case.tolerance),
    ]
    if case.tolerance == NEAR:
        figures.append(Figure.at_most(case.name, "peak memory, GiB", record.memory, MEMORY))
    return figures
