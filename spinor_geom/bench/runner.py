"""What a run measures, in which order, and its folder: every record is on the disk before the next task starts."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from spinor_geom.bench.cases import KNOWN, SAMPLED, Variation, base_name, known_case
from spinor_geom.bench.claims import REFERENCE_CASE
from spinor_geom.bench.cut_outs import CAPS, SCANS, WINDOWS, scan_names
from spinor_geom.bench.fillers import FILLERS, SMOOTHEST
from spinor_geom.bench.holes import ODD, PEER_TESTS, file_hole, mesh_files
from spinor_geom.bench.isolate import Record, Task, run_isolated
from spinor_geom.bench.machine import machine
from spinor_geom.bench.methods import LOOP_METHODS
from spinor_geom.errors import OptionError
from spinor_geom.files import finite, write_json

RECORDS, DESCRIPTION, VIEWS = "records.jsonl", "run.json", "views"
WORKER = "spinor_geom.bench.worker"
SUITES = ("known", "odd", "files", "scaling")
# points of the loops whose disks the page shows
VIEW_POINTS = 128
VIEW_METHODS = ("spinor", "libigl-uniform")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a run measures.

    Attributes:
        cases: names of known cases, odd rims, cut-outs and mesh files, and of groups; empty for the usual ones.
        methods: names of loop methods and fillers; empty for all.
        points: of the loops of known cases.
        hole_points: of the rims of known cases, for the fillers: all where they are compared with a reference, two of
            other smooth rims, the first of rims with corners.
        repeat: counted calls of each task.
        time_limit: of each task, in seconds.
        variation: of known cases.
        data: folder of mesh files; none without.
        scaling_points: of the loops that the time is fitted over.
        scaling_triangles: of the patches that the time is fitted over.
        quick: whether it is the short run; for its description.
    """

    cases: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    points: tuple[int, ...] = (32, 64, 128, 256)
    hole_points: tuple[int, ...] = (64, 256, 1000)
    repeat: int = 3
    time_limit: float = 180.0
    variation: Variation = field(default_factory=Variation)
    data: Path | None = None
    scaling_points: tuple[int, ...] = (50, 100, 200, 500, 1000, 2000, 5000)
    scaling_triangles: tuple[int, ...] = (1_000, 10_000, 100_000, 1_000_000)
    quick: bool = False

    @classmethod
    def short(cls, **changed: Any) -> Settings:
        """The run that takes less than two minutes: the claims' own cases, every tool once."""
        values: dict[str, Any] = {
            "points": (32, 64),
            "hole_points": (64,),
            "time_limit": 60.0,
            "scaling_points": (50, 150, 500),
            "scaling_triangles": (1_000, 10_000),
            "quick": True,
        }
        return cls(**{**values, **changed})

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Names of cases that may be asked for by one name."""
        scans = scan_names(self.data)
        parts = {"caps": tuple(CAPS), "windows": tuple(WINDOWS), "scans": scans, "peer-tests": tuple(PEER_TESTS)}
        return {**parts, "cut-outs": tuple(itertools.chain(*parts.values()))}

    @property
    def chosen(self) -> tuple[str, ...]:
        """Names of the cases that were asked for, without groups."""
        groups = self.groups
        return tuple(dict.fromkeys(itertools.chain(*(groups.get(name, (name,)) for name in self.cases))))

    def known_names(self) -> tuple[str, ...]:
        """Names of the known cases that are measured."""
        if self.cases:
            return tuple(name for name in self.chosen if base_name(name) in KNOWN or name.startswith("random-"))
        return QUICK_CASES if self.quick else (*KNOWN, *SAMPLED)

    def odd_names(self) -> tuple[str, ...]:
        """Names of the odd rims that are measured."""
        return tuple(name for name in ODD if name in self.chosen) if self.cases else tuple(ODD)

    def cut_out_names(self) -> tuple[str, ...]:
        """Names of the cut-outs that are measured."""
        there = (*CAPS, *WINDOWS, *scan_names(self.data))
        wanted = self.chosen if self.cases else QUICK_CUT_OUTS if self.quick else there
        return tuple(name for name in there if name in wanted)

    def files(self) -> list[Path]:
        """The mesh files that are measured.

        Raises:
            OptionError: there is no such folder.
        """
        if self.data is not None and not self.data.is_dir():
            raise OptionError(f"{self.data}: is not a folder; name one that holds mesh files")
        if self.data is None or (self.quick and not self.cases):
            return []
        return mesh_files(self.data, self.chosen)

    def wants(self, method: str) -> bool:
        """Whether a method is measured."""
        return not self.methods or method in self.methods

    def description(self) -> dict[str, Any]:
        """JSON-ready."""
        values = asdict(self)
        return {**values, "data": None if self.data is None else str(self.data)}


QUICK_CUT_OUTS = ("icosphere-3-0.7", "torus-outside-0.4")
# cut-outs of which the page shows what was removed and what each filler put there
PICTURED = ("icosphere-4-0.3", "torus-outside-0.4", "bunny_scan-02", "demosthenes_low_res-03")
QUICK_CASES = (
    "enneper-0.8",
    "tennis-seam",
    "random-1",
    "random-1@even",
    "random-1@uneven",
    "plane-l",
    "schwarz-d-quad",
)
# cases whose time is fitted, and the one whose patches grow
SCALED_LOOP, SCALED_PATCH = "tennis-seam", "enneper-0.8"
# edges inside our meshes of loops of any number of points
SCALED_EDGE = 0.1
SCALED_METHODS = ("spinor", "libigl", "libigl-uniform")


def plan(settings: Settings, folder: Path) -> list[list[Task]]:
    """All tasks, those of a list one after the other in one process.

    Raises:
        OptionError: a case, a method or the folder of mesh files does not exist, or nothing is left to measure.
    """
    files = settings.files()
    _check(settings, files)
    groups = [*_loops(settings, folder, files), *_fillers(settings, folder, files), *_scaling(settings)]
    groups = [group for group in groups if group]
    if not groups:
        raise OptionError("the chosen methods do not work on the chosen cases; nothing is left to measure")
    # a process for each method tells its cold start; one for all saves the imports
    return [list(itertools.chain.from_iterable(groups))] if settings.quick else groups


def _check(settings: Settings, paths: Sequence[Path]) -> None:
    files = [path.name for path in paths]
    for name in settings.cases:
        if settings.groups.get(name) == ():
            raise OptionError(
                f"none of {', '.join(SCANS)} is in the folder of mesh files; name the one that holds them"
            )
    cut_outs = settings.cut_out_names()
    for name in settings.chosen:
        if name not in ODD and name not in files and name not in cut_outs:
            try:
                known_case(name)
            except OptionError:
                choice = ", ".join([*KNOWN, "random-SEED", *ODD, *settings.groups, *files])
                raise OptionError(f"there is no case {name!r}; choose from: {choice}") from None
    for name in settings.methods:
        if name not in LOOP_METHODS and name not in FILLERS:
            choice = ", ".join([*LOOP_METHODS, *FILLERS])
            raise OptionError(f"there is no method {name!r}; choose from: {choice}")


def _loops(settings: Settings, folder: Path, files: Sequence[Path]) -> Iterator[list[Task]]:
    counts = {path: len(file_hole(path).loops) for path in files}
    for name, method in LOOP_METHODS.items():
        if not settings.wants(name):
            continue
        group: list[Task] = []
        points = [n for n in settings.points if n <= method.most_points]
        if name in ONE_SIZE or (settings.quick and name in SLOW):  # there to be compared once, not swept
            points = [n for n in points if n == VIEW_POINTS] or points[-1:]
        cases = settings.known_names()
        if settings.quick and not settings.cases and name in SLOW:
            cases = cases[:2]
        for case in cases:
            if name == "spinor-formula" and case not in FORMULAS:
                continue
            if case in SAMPLED and not settings.cases and name not in SCALED_METHODS:
                continue
            if name in ("spinor-series", "spinor-mlp") and case in KNOWN and KNOWN[case][0] != "smooth":
                continue
            for n in points:
                view = n == min(VIEW_POINTS, max(settings.points)) and name in VIEW_METHODS
                group.append(
                    _task(
                        settings,
                        suite="loop",
                        method=name,
                        case=case,
                        n=n,
                        view=str(folder / VIEWS / f"{case}-{name}.npz") if view else None,
                    )
                )
        if name in ("spinor", "libigl"):
            group += [
                _task(settings, suite="file loop", method=name, case=str(path), place=place, repeat=0)
                for path, count in counts.items()
                for place in range(count)
            ]
        yield group


# only curves in formulas have more than their samples
FORMULAS = ("twisted-circle", "tennis-seam", "plane-ellipse")
# what a short run measures on its first two cases only
SLOW = ("spinor-cauchy", "spinor-mlp", "pymeshlab")
ONE_SIZE = ("spinor-cauchy", "spinor-series", "spinor-mlp", "spinor-formula")


def _fillers(settings: Settings, folder: Path, files: Sequence[Path]) -> Iterator[list[Task]]:
    names = tuple(name for name in settings.known_names() if name == base_name(name))
    if settings.quick and not settings.cases:
        names = names[:1]
    for name in FILLERS:
        if not settings.wants(name):
            continue
        group = [
            _task(settings, suite="hole", method=name, case=case, n=n)
            for case in names
            for n in _hole_points(settings, case)
        ]
        if name in SMOOTHEST or name in settings.methods:
            group += [
                _task(
                    settings,
                    suite="cut-out",
                    method=name,
                    case=case,
                    n=None,
                    data=None if settings.data is None else str(settings.data),
                    repeat=1,
                    view=str(folder / VIEWS / case) if case in PICTURED else None,
                )
                for case in settings.cut_out_names()
            ]
        group += [
            _task(settings, suite="odd", method=name, case=case, n=None, repeat=0) for case in settings.odd_names()
        ]
        group += [_task(settings, suite="file", method=name, case=str(path), n=None, repeat=0) for path in files]
        yield group


def _hole_points(settings: Settings, case: str) -> tuple[int, ...]:
    if case == REFERENCE_CASE:
        return settings.hole_points
    return settings.hole_points[: 2 if case not in KNOWN or KNOWN[case][0] == "smooth" else 1]


def _scaling(settings: Settings) -> Iterator[list[Task]]:
    if settings.cases and SCALED_LOOP not in settings.cases:
        return
    for name in SCALED_METHODS:
        if not settings.wants(name):
            continue
        group = []
        if name != "libigl-uniform":
            group += [
                _task(
                    settings,
                    suite="loop",
                    method=name,
                    case=SCALED_LOOP,
                    n=n,
                    # the baseline's triangles grow inwards by themselves
                    edge=SCALED_EDGE if name == "spinor" else None,
                    scaling="points",
                    repeat=1,
                )
                for n in settings.scaling_points
            ]
        if name != "libigl":
            area = known_case(SCALED_PATCH, settings.variation).area or known_case(SCALED_PATCH).area
            assert area is not None
            for count in settings.scaling_triangles:
                edge = (4 * area / 3**0.5 / count) ** 0.5
                group.append(
                    _task(
                        settings,
                        suite="loop",
                        method=name,
                        case=SCALED_PATCH,
                        n=64,
                        edge=edge,
                        wanted=count,
                        scaling="triangles",
                        repeat=1,
                    )
                )
        yield group


def _task(settings: Settings, *, suite: str, method: str, case: str, repeat: int | None = None, **more: Any) -> Task:
    return {
        "suite": suite,
        "method": method,
        "package": "spinor_geom" if method in LOOP_METHODS else FILLERS[method].package,
        "case": case,
        "variation": asdict(settings.variation),
        "repeat": settings.repeat if repeat is None else repeat,
        **more,
    }


def key(task: Task) -> str:
    """What makes a task another one."""
    return json.dumps({name: value for name, value in task.items() if name != "view"}, sort_keys=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A run that has ended.

    Attributes:
        folder: of the run.
        description: settings, machine, versions.
        records: of all tasks, in their order, each with its task's fields.
    """

    folder: Path
    description: Mapping[str, Any]
    records: Sequence[Record]


def measure(
    settings: Settings,
    folder: str | os.PathLike[str],
    *,
    on_record: Callable[[Record, int, int], None] | None = None,
) -> Run:
    """Measures all that a run is to measure; what an earlier, killed run left in the folder is not measured again.

    Args:
        settings: what to measure.
        folder: of the run; made if it is not there.
        on_record: called after each task, with the numbers of tasks done and of all.

    Raises:
        OptionError: a case, a method or the folder of mesh files does not exist, or the run's folder holds one of other
            versions.
    """
    place = Path(folder)
    groups = plan(settings, place)
    place.mkdir(parents=True, exist_ok=True)
    description = _description(settings, place)
    done = {record["key"]: record for record in read_records(place)}
    total = sum(len(group) for group in groups)
    count = 0

    def keep(task: Task, answer: Record) -> None:
        nonlocal count
        record: Record = finite({"key": key(task), **task, **answer})
        # a line is whole or, where the process dies in it, dropped when it is read
        with open(place / RECORDS, "a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
            file.flush()
            os.fsync(file.fileno())
        done[record["key"]] = record
        count += 1
        if on_record is not None:
            on_record(record, count, total)

    count = sum(key(task) in done for group in groups for task in group)
    for group in groups:
        todo = [task for task in group if key(task) not in done]
        run_isolated(todo, module=WORKER, time_limit=settings.time_limit, on_record=keep)
    records = [done[key(task)] for group in groups for task in group]
    return Run(folder=place, description=description, records=records)


def read_records(folder: Path) -> list[Record]:
    """The records of a run's folder; a last line that was not finished is no record."""
    path = folder / RECORDS
    if not path.exists():
        return []
    text = path.read_text(encoding="utf-8")
    if text and not text.endswith("\n"):
        # what is added must not go on in the middle of that line
        text = text[: text.rfind("\n") + 1]
        path.write_text(text, encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def _description(settings: Settings, folder: Path) -> dict[str, Any]:
    here = {"settings": settings.description(), "machine": machine()}
    path = folder / DESCRIPTION
    if path.exists():
        before = json.loads(path.read_text(encoding="utf-8"))
        for name in ("versions", "cores", "processor"):
            if before["machine"][name] != here["machine"][name]:
                raise OptionError(
                    f"{folder} holds a run on another machine or of other versions ({name} differ); name another folder"
                )
        here["machine"] = before["machine"]
    write_json(path, here)
    return here
