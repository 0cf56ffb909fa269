"""Definition and runs of the paper's experiments, with data, pictures and a report."""

import importlib
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from markdown_it import MarkdownIt
from matplotlib.figure import Figure

from spinor_geom.errors import OptionError
from spinor_geom.experiments import NAMES
from spinor_geom.files import atomic_path, finite, together, write_json, write_text
from spinor_geom.render.page import Table, document, picture
from spinor_geom.training import LevenbergMarquardt, RMSprop
from spinor_geom.version import program_version

REPORT, PAGE, DESCRIPTION = "report.md", "report.html", "data.json"
QUICK = "Trainings have fewer epochs and grids are coarser than in the paper; the criteria are the same"
TITLE = "The paper's experiments, repeated"
_RESOLUTION = 160  # pixels per inch of the PNGs
_STYLE = "h2 { border-top: 1px solid var(--faint); padding-top: 1.5rem } img { display: block; max-height: 40rem }"


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """The result of a measurement.

    Attributes:
        rows: the rows of a table, with values that JSON can store.
        reproduced: whether the results agree with the paper.
        verdict: the figures that decide it, in a sentence.
        pictures: figures by file name.
    """

    rows: Sequence[Mapping[str, Any]]
    reproduced: bool
    verdict: str
    pictures: Mapping[str, Figure] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """One experiment of the paper.

    Attributes:
        title: for the report.
        paper: the paper's settings and statement.
        here: what differs here, and when the statement counts as reproduced.
        measure: the function that runs the experiment.
        full: the arguments of `measure`, with the paper's values if it states them.
        quick: the arguments that a run of one or two minutes changes. "a.b" is the field b of the argument a.
    """

    title: str
    paper: str
    here: str
    measure: Callable[..., Outcome]
    full: Mapping[str, Any]
    quick: Mapping[str, Any]

    def settings(self, *, quick: bool) -> dict[str, Any]:
        """The arguments of `measure`."""
        chosen = dict(self.full)
        for path, value in self.quick.items() if quick else ():
            name, _, option = path.partition(".")
            chosen[name] = replace(chosen[name], **{option: value}) if option else value
        return chosen

    def description(self, *, quick: bool) -> dict[str, Any]:
        """The settings as JSON values. Results are reused only if their settings are equal."""
        named = self.settings(quick=quick).items()
        return {name: finite(asdict(v) if isinstance(v, RMSprop | LevenbergMarquardt) else v) for name, v in named}


def experiment(name: str) -> Experiment:
    """An experiment by name. Raises OptionError for an unknown name."""
    if name not in NAMES:
        raise OptionError(f"there is no experiment {name!r}; choose from: {', '.join(NAMES)}")
    found: Experiment = importlib.import_module(f"spinor_geom.experiments.{NAMES[name]}").EXPERIMENTS[name]
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Results:
    """The results of one experiment, as stored in its folder."""

    name: str
    experiment: Experiment
    rows: Sequence[Mapping[str, Any]]
    reproduced: bool
    verdict: str
    pictures: Sequence[str]
    seconds: float


def reproduce(
    names: Sequence[str],
    folder: str | os.PathLike[str],
    *,
    quick: bool = False,
    on_start: Callable[[str], None] | None = None,
) -> tuple[Results, ...]:
    """Runs experiments one after the other and updates the report after each.

    Complete results of the same version and settings in the folder are reused. `on_start` is called with the name of
    each experiment, reused or not.
    """
    chosen, done = {name: experiment(name) for name in names}, list[Results]()
    for name, one in chosen.items():
        if on_start is not None:
            on_start(name)
        done.append(_run(name, one, Path(folder) / name, quick))
        with together():
            write_text(Path(folder) / REPORT, report(done, quick=quick))
            write_text(Path(folder) / PAGE, page(done, Path(folder), quick=quick))
    return tuple(done)


def _run(name: str, one: Experiment, folder: Path, quick: bool) -> Results:
    identity = {"name": name, "quick": quick, "settings": one.description(quick=quick), "version": program_version()}
    path = folder / DESCRIPTION
    found = _finished(path)
    if any(found.get(key) != value for key, value in identity.items()):
        begin = time.perf_counter()
        folder.mkdir(parents=True, exist_ok=True)
        outcome = one.measure(**one.settings(quick=quick))
        found = {
            **identity,
            "rows": finite(list(outcome.rows)),
            "reproduced": outcome.reproduced,
            "verdict": outcome.verdict,
            "pictures": list(outcome.pictures),
            "seconds": time.perf_counter() - begin,
        }
        for picture_name, figure in outcome.pictures.items():
            with atomic_path(folder / f"{picture_name}.png") as temporary:
                figure.savefig(temporary, dpi=_RESOLUTION, bbox_inches="tight")
        write_json(path, found)  # last, because it marks the results as complete
    measured = {key: value for key, value in found.items() if key not in identity}
    return Results(name=name, experiment=one, **measured)


def _finished(path: Path) -> dict[str, Any]:
    """The results of an earlier run, empty if they are not complete."""
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return found if all(path.with_name(f"{name}.png").is_file() for name in found["pictures"]) else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def report(done: Sequence[Results], *, quick: bool, shown: Callable[[str], str] | None = None) -> str:
    """The report in Markdown. `shown` returns the Markdown of a picture from its path, by default a link."""
    start = [
        f"# {TITLE}",
        f"{'Quick' if quick else 'Full'} run: {len(done)} {'experiment' if len(done) == 1 else 'experiments'} in "
        f"{sum(one.seconds for one in done):.0f} s; {sum(one.reproduced for one in done)} agree with the paper: the "
        "verdict of each says what was compared"
        f"{f'. {QUICK}' if quick else ''}.",
    ]
    link = shown or (lambda path: f"![{Path(path).stem}]({path})")
    return "\n\n".join([*start, *(_section(one, quick, link) for one in done)]) + "\n"


def page(done: Sequence[Results], folder: Path, *, quick: bool) -> str:
    """The report as an HTML page that contains its pictures."""

    def embedded(path: str) -> str:
        return picture((folder / path).read_bytes(), Path(path).stem)

    converter = MarkdownIt("commonmark").enable("table")
    return document(TITLE, [converter.render(report(done, quick=quick, shown=embedded))], style=_STYLE)


def _section(done: Results, quick: bool, shown: Callable[[str], str]) -> str:
    one = done.experiment
    full = SimpleNamespace(**one.full)
    shortened = [f"{name} {short} instead of {attrgetter(name)(full)}" for name, short in one.quick.items()]
    parts = [
        f"## {done.name}: {one.title}",
        f"**The paper.** {one.paper}",
        f"**Here.** {one.here} {done.seconds:.0f} s.",
        *([f"**Shortened.** {'; '.join(shortened)}."] if quick and shortened else []),
        Table.of_records(done.rows).markdown(),
        *(shown(f"{done.name}/{name}.png") for name in done.pictures),
        f"**{'Reproduced' if done.reproduced else 'Not reproduced'}.** {done.verdict}",
    ]
    return "\n\n".join(parts)
