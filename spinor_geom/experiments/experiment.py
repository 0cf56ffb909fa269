"""What an experiment is, and runs of some: data, pictures, and one report."""

import hashlib
import importlib
import json
import os
import shutil
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
from spinor_geom.files import atomic_path, finite, json_text, write_json, write_text
from spinor_geom.render.page import cell, document, markdown, picture
from spinor_geom.training import LevenbergMarquardt, RMSprop
from spinor_geom.version import program_version

REPORT, PAGE, DESCRIPTION = "report.md", "report.html", "data.json"
SUFFIXES = (".png", ".pdf")  # of each picture
TITLE = "The paper's experiments, measured anew"
_RESOLUTION = 160  # pixels per inch of the PNGs
_STYLE = "h2 { border-top: 1px solid var(--faint); padding-top: 1.5rem } img { display: block; max-height: 40rem }"


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What was measured: JSON-ready rows of a table, whether what the paper says was seen, pictures by file name."""

    rows: Sequence[Mapping[str, Any]]
    holds: bool
    verdict: str
    pictures: Mapping[str, Figure] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """One experiment of the paper: what it shows, the paper's setting, and ours, where it differs."""

    title: str
    paper: str
    here: str
    measure: Callable[..., Outcome]  # runs it, its settings by name
    full: Mapping[str, Any]  # its settings, the paper's where it names them
    quick: Mapping[str, Any]  # those of a run of a minute or two; "a.b" is the option b of the setting a

    def settings(self, *, quick: bool) -> dict[str, Any]:
        """The settings of a run."""
        chosen = dict(self.full)
        for path, value in self.quick.items() if quick else ():
            name, _, option = path.partition(".")
            chosen[name] = replace(chosen[name], **{option: value}) if option else value
        return chosen

    def description(self, *, quick: bool) -> dict[str, Any]:
        """The same, JSON-ready: by it a run knows what an earlier one finished."""
        named = self.settings(quick=quick).items()
        return {name: finite(asdict(v) if isinstance(v, RMSprop | LevenbergMarquardt) else v) for name, v in named}


def kept_as(name: str, options: RMSprop) -> RMSprop:
    """Options of one of an experiment's trainings: its state in a file of this name in the folder they name, if any."""
    if options.checkpoint is None:
        return options
    return replace(options, checkpoint=Path(options.checkpoint) / f"{name.replace(' ', '-')}.pt")


def experiment(name: str) -> Experiment:
    """The experiment of a name; OptionError where there is none."""
    if name not in NAMES:
        raise OptionError(f"there is no experiment {name!r}; choose from: {', '.join(NAMES)}")
    found: Experiment = importlib.import_module(f"spinor_geom.experiments.{NAMES[name]}").EXPERIMENTS[name]
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Done:
    """An experiment that was run, as the folder of its name tells it; its pictures by their names."""

    name: str
    experiment: Experiment
    rows: Sequence[Mapping[str, Any]]
    holds: bool
    verdict: str
    pictures: Sequence[str]
    seconds: float


def reproduce(
    names: Sequence[str],
    folder: str | os.PathLike[str],
    *,
    quick: bool = False,
    on_done: Callable[[Done], None] | None = None,
) -> tuple[Done, ...]:
    """Runs experiments one after the other; each leaves its files, and its part of the report, as soon as it is done.

    A run that was stopped goes on where it was: what the same version finished with the same settings, and nobody has
    changed since, is not measured again, and the
    paper's trainings keep their states in the folder while they run. `on_done` hears of each, of those too.
    """
    chosen = {name: experiment(name) for name in names}
    done: list[Done] = []
    for name, one in chosen.items():
        done.append(_run(name, one, Path(folder) / name, quick))
        write_text(Path(folder) / REPORT, report(done, quick=quick))
        write_text(Path(folder) / PAGE, page(done, Path(folder), quick=quick))
        if on_done is not None:
            on_done(done[-1])
    return tuple(done)


def _run(name: str, one: Experiment, folder: Path, quick: bool) -> Done:
    """Measures and writes, unless it was done: the description, which is written last, tells that."""
    asked = {"name": name, "quick": quick, "settings": one.description(quick=quick), "version": program_version()}
    path, states = folder / DESCRIPTION, folder / "states"
    found = _finished(path)
    if any(found.get(key) != value for key, value in asked.items()):
        begin = time.perf_counter()
        states.mkdir(parents=True, exist_ok=True)
        keeping = {
            key: replace(value, checkpoint=states) if isinstance(value, RMSprop) else value
            for key, value in one.settings(quick=quick).items()
        }
        outcome = one.measure(**keeping)
        found = {
            **asked,
            "rows": finite(list(outcome.rows)),
            "holds": outcome.holds,
            "verdict": outcome.verdict,
            "pictures": list(outcome.pictures),
            "seconds": time.perf_counter() - begin,
        }
        for picture_name, figure in outcome.pictures.items():
            for suffix in SUFFIXES:
                with atomic_path(folder / f"{picture_name}{suffix}") as temporary:
                    figure.savefig(temporary, dpi=_RESOLUTION, bbox_inches="tight")
        write_json(path, {**found, "checksum": _checksum(found)})
    # also those of a run that was stopped between the description and here
    shutil.rmtree(states, ignore_errors=True)
    measured = {key: value for key, value in found.items() if key not in asked}
    return Done(name=name, experiment=one, **measured)


def _finished(path: Path) -> dict[str, Any]:
    """What an earlier run has written, as it wrote it and with all its pictures; else nothing."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        names = [path.with_name(f"{name}{suffix}") for name in found["pictures"] for suffix in SUFFIXES]
        is_whole = found.pop("checksum") == _checksum(found) and all(map(Path.is_file, names))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}
    return found if is_whole else {}


def _checksum(found: Mapping[str, Any]) -> str:
    return hashlib.sha256(json_text(found).encode()).hexdigest()


def report(done: Sequence[Done], *, quick: bool, shown: Callable[[str], str] | None = None) -> str:
    """The report of a run, in Markdown; `shown` makes what stands for a picture of its address, else a link."""
    held = sum(one.holds for one in done)
    start = [
        f"# {TITLE}",
        f"{'Quick' if quick else 'Full'} run: {len(done)} {'experiment' if len(done) == 1 else 'experiments'} in "
        f"{sum(one.seconds for one in done):.0f} s; what the paper says was seen in {held}.",
    ]
    link = shown or (lambda address: f"![{Path(address).stem}]({address})")
    return "\n\n".join([*start, *(_section(one, quick, link) for one in done)]) + "\n"


def page(done: Sequence[Done], folder: Path, *, quick: bool) -> str:
    """The same report as a page for a browser that needs no other file, its pictures inside."""

    def embedded(address: str) -> str:
        return picture((folder / address).read_bytes(), Path(address).stem)

    converter = MarkdownIt("commonmark").enable("table")
    return document(TITLE, [converter.render(report(done, quick=quick, shown=embedded))], style=_STYLE)


def _section(done: Done, quick: bool, shown: Callable[[str], str]) -> str:
    one = done.experiment
    columns = list(dict.fromkeys(name for row in done.rows for name in row))
    full = SimpleNamespace(**one.full)
    shortened = [f"{name} {short} instead of {attrgetter(name)(full)}" for name, short in one.quick.items()]
    parts = [
        f"## {done.name}: {one.title}",
        f"**The paper.** {one.paper}",
        f"**Here.** {one.here} {done.seconds:.0f} s.",
        *([f"**Shortened.** {'; '.join(shortened)}."] if quick and shortened else []),
        markdown(columns, [[cell(row.get(name)) for name in columns] for row in done.rows]),
        *(shown(f"{done.name}/{name}.png") for name in done.pictures),
        f"**{'Seen' if done.holds else 'Not seen'}.** {done.verdict}",
    ]
    return "\n\n".join(parts)
