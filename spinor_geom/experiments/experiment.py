"""What an experiment is, and what it leaves."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from spinor_geom.errors import OptionError
from spinor_geom.experiments import NAMES
from spinor_geom.files import finite
from spinor_geom.training import LevenbergMarquardt, RMSprop


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What was measured.

    Attributes:
        rows: the figures, as rows of one table; JSON-ready.
        holds: whether what the paper says was seen here too.
        verdict: the same in words, made from the figures.
        pictures: by file name.
    """

    rows: Sequence[Mapping[str, Any]]
    holds: bool
    verdict: str
    pictures: Mapping[str, Figure] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """One experiment of the paper.

    Attributes:
        title: what it shows.
        paper: the paper's setting.
        here: ours, where it differs.
        measure: runs it, its settings by name.
        full: its settings, the paper's where it names them.
        quick: those that are changed so that it takes a minute or two; "a.b" is the option b of the setting a.
    """

    title: str
    paper: str
    here: str
    measure: Callable[..., Outcome]
    full: Mapping[str, Any]
    quick: Mapping[str, Any]

    def settings(self, *, quick: bool) -> dict[str, Any]:
        """The settings of a run."""
        chosen = dict(self.full)
        for path, value in self.quick.items() if quick else ():
            name, _, option = path.partition(".")
            chosen[name] = replace(chosen[name], **{option: value}) if option else value
        return chosen

    def description(self, *, quick: bool) -> dict[str, Any]:
        """The same, JSON-ready: by it a run knows what an earlier one finished."""
        told = {}
        for name, value in self.settings(quick=quick).items():
            told[name] = finite(asdict(value) if isinstance(value, RMSprop | LevenbergMarquardt) else value)
        return told

    def shortened(self) -> dict[str, tuple[Any, Any]]:
        """Each setting that the quick run changes: its full and its quick value."""
        paths = {path: path.partition(".") for path in self.quick}
        long = {path: getattr(self.full[a], b) if b else self.full[a] for path, (a, _, b) in paths.items()}
        return {path: (long[path], value) for path, value in self.quick.items()}


def kept_as(name: str, options: RMSprop) -> RMSprop:
    """Options of one of an experiment's trainings: its state in a file of this name in the folder they name, if any."""
    if options.checkpoint is None:
        return options
    return replace(options, checkpoint=Path(options.checkpoint) / f"{name.replace(' ', '-')}.pt")


def experiment(name: str) -> Experiment:
    """The experiment of a name.

    Raises:
        OptionError: there is none.
    """
    if name not in NAMES:
        raise OptionError(f"there is no experiment {name!r}; choose from: {', '.join(NAMES)}")
    found: Experiment = importlib.import_module(f"spinor_geom.experiments.{NAMES[name]}").EXPERIMENTS[name]
    return found
