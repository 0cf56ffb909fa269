"""What an experiment is, and what it leaves."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from spinor_geom.errors import OptionError
from spinor_geom.experiments import NAMES
from spinor_geom.training import RMSprop

Settings = TypeVar("Settings")  # a dataclass


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What was measured.

    Attributes:
        rows: the figures, as rows of one table; JSON-ready.
        holds: whether what the paper says was seen here too.
        verdict: the same in words, made from the figures.
        arrays: the data of the pictures.
        pictures: by file name.
    """

    rows: Sequence[Mapping[str, Any]]
    holds: bool
    verdict: str
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    pictures: Mapping[str, Figure] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment(Generic[Settings]):
    """One experiment of the paper.

    Attributes:
        title: what it shows.
        paper: the paper's setting.
        here: ours, where it differs.
        measure: runs it.
        full: its settings, the paper's where it names them.
        quick: settings that take a minute or two.
    """

    title: str
    paper: str
    here: str
    measure: Callable[[Settings], Outcome]
    full: Settings
    quick: Settings

    def settings(self, *, quick: bool) -> Settings:
        """The settings of a run."""
        return self.quick if quick else self.full

    def shortened(self) -> dict[str, tuple[Any, Any]]:
        """Each setting that the quick run changes: its full and its quick value."""
        long, short = _by_path(self.full), _by_path(self.quick)
        return {name: (value, short[name]) for name, value in long.items() if value != short[name]}


def _by_path(settings: Any, prefix: str = "") -> dict[str, Any]:
    """Nested settings as one dictionary, by names with dots."""
    flat: dict[str, Any] = {}
    for name, value in vars(settings).items():
        flat |= _by_path(value, f"{prefix}{name}.") if is_dataclass(value) else {f"{prefix}{name}": value}
    return flat


def keeping(settings: Settings, folder: Path) -> Settings:
    """Settings whose trainings keep their states in a folder, to go on from there; see `kept_as`."""
    changes = {
        name: replace(value, checkpoint=folder) if isinstance(value, RMSprop) else keeping(value, folder)
        for name, value in vars(settings).items()
        if is_dataclass(value)
    }
    return replace(settings, **changes)  # type: ignore[type-var] # every experiment's settings are a dataclass


def kept_as(name: str, options: RMSprop) -> RMSprop:
    """Options of one of an experiment's trainings: its state in a file of this name in the folder they name, if any."""
    if options.checkpoint is None:
        return options
    return replace(options, checkpoint=Path(options.checkpoint) / f"{name.replace(' ', '-')}.pt")


def experiment(name: str) -> Experiment[Any]:
    """The experiment of a name.

    Raises:
        OptionError: there is none.
    """
    if name not in NAMES:
        raise OptionError(f"there is no experiment {name!r}; choose from: {', '.join(NAMES)}")
    module = importlib.import_module(f"spinor_geom.experiments.{name.replace('-', '_')}")
    found: Experiment[Any] = module.EXPERIMENT
    return found


def fitted_slope(steps: Sequence[int], errors: Sequence[float], floor: float) -> float:
    """Slope of log(error) by log(steps), where errors are above a floor of rounding; NaN where fewer than two are."""
    above = [(n, e) for n, e in zip(steps, errors, strict=True) if e > floor]
    if len(above) < 2:
        return float("nan")
    n, e = np.log(np.array(above)).T
    return float(np.polyfit(n, e, 1)[0])
