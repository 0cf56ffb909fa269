"""What an experiment is, and what it leaves."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from spinor_geom.errors import OptionError
from spinor_geom.experiments import NAMES
from spinor_geom.training import RMSprop

Settings = TypeVar("Settings")


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
        return dict(_changed(self.full, self.quick, ""))


def _changed(full: Any, quick: Any, prefix: str) -> list[tuple[str, tuple[Any, Any]]]:
    found: list[tuple[str, tuple[Any, Any]]] = []
    for name in (entry.name for entry in fields(full)):
        long, short = getattr(full, name), getattr(quick, name)
        if hasattr(long, "__dataclass_fields__"):
            found += _changed(long, short, f"{prefix}{name}.")
        elif long != short:
            found.append((f"{prefix}{name}", (long, short)))
    return found


def keeping(settings: Settings, folder: Path) -> Settings:
    """Settings whose trainings keep their states in a folder, to go on from there; see `kept_as`."""
    changes: dict[str, Any] = {}
    for entry in fields(settings):  # type: ignore[arg-type] # every experiment's settings are a dataclass
        value = getattr(settings, entry.name)
        if isinstance(value, RMSprop):
            changes[entry.name] = replace(value, checkpoint=folder)
        elif is_dataclass(value):
            changes[entry.name] = keeping(value, folder)
    return replace(settings, **changes)  # type: ignore[type-var]


def kept_as(name: str, options: RMSprop) -> RMSprop:
    """Options of one of an experiment's trainings: its state in a file of this name in the folder they name, if any."""
    if options.checkpoint is None:
        return options
    return replace(options, checkpoint=Path(options.checkpoint) / f"{name.replace(' ', '-')}.pt")


def as_json(settings: Any) -> dict[str, Any]:
    """Settings as JSON holds them."""
    return asdict(settings)


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
