"""Options of `solve_plateau`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

import numpy as np

from spinor_geom.arrays import NUMPY, Place
from spinor_geom.errors import OptionError, require_count, require_positive

if TYPE_CHECKING:
    import torch

    from spinor_geom.mesh.curve import BoundaryCurve
    from spinor_geom.plateau.route_result import RouteResult
    from spinor_geom.plateau.solution import PlateauSolution
    from spinor_geom.plateau.steps import Steps


@dataclass(frozen=True, kw_only=True)
class Cauchy:
    """Options of the Cauchy network.

    Attributes:
        degree: highest degree of the polynomials. It is less for loops of fewer than 20 points.
        pole_offset: distance of the poles from ∂Ω, in local edge lengths.
    """

    degree: int = 40
    pole_offset: float = 1.0

    def __post_init__(self) -> None:
        """Checks the options."""
        require_count(degree=self.degree)
        require_positive("pole_offset", self.pole_offset)


@dataclass(frozen=True, kw_only=True)
class Laurent:
    """Options of Laurent series: p and q on a round annulus for two loops, on a disk with round holes for more.

    Attributes:
        modulus: selects the surface whose modulus (see `Annulus`) is nearest by ratio, of all that are found, or of the
            stable ones with `unstable="leave"`. None for the stable surface of least area.

    Raises:
        OptionError: the modulus is not positive.
    """

    modulus: float | None = None

    def __post_init__(self) -> None:
        if self.modulus is not None:
            require_positive("modulus", self.modulus)


Model: TypeAlias = Literal["auto", "cauchy", "series", "mlp"] | Cauchy | Laurent


def require_model(model: Model) -> None:
    """Checks the option `model`."""
    if not isinstance(model, (Cauchy, Laurent)) and model not in ("auto", "cauchy", "series", "mlp"):
        raise OptionError(
            f"unknown model {model!r}; choose 'auto', 'cauchy', 'series', 'mlp', Cauchy(...) or Laurent(...)"
        )


def usable_place(device: str | torch.device | None) -> Place:
    """The place of a device of torch, or numpy for None. Raises an OptionError if it cannot be used."""
    if device is None:
        return NUMPY
    from spinor_geom.torch_extra import torch

    try:
        place = Place(torch.device(device))
        float(place.put(np.zeros(1))[0])
    except (RuntimeError, AssertionError, TypeError) as error:
        raise OptionError(f"device {device} cannot be used ({str(error).splitlines()[0]}); choose another") from error
    return place


class Trainer(Protocol):
    """The options of a network and its training: `LevenbergMarquardt` or `RMSprop` of `spinor_geom.training`."""

    @property
    def takes_start(self) -> bool:
        """Whether training can start from p and q of a solution."""

    def disk(
        self, curve: BoundaryCurve, *, start: PlateauSolution | None, device: str | torch.device, steps: Steps
    ) -> RouteResult:
        """A minimal disk over Γ at unit size whose p and q are networks, from a solution over it or a random start."""


Optimizer: TypeAlias = Literal["levenberg-marquardt", "rmsprop"] | Trainer


@dataclass(frozen=True, kw_only=True)
class Options:
    """The checked options of `solve_plateau`."""

    model: Model = "auto"
    optimizer: Optimizer | None = None
    warm_start: bool = True
    tolerance: float = 1e-3
    max_iterations: int = 400
    unstable: str = "leave"
    between: str = "free"
    place: Place = NUMPY

    def __post_init__(self) -> None:
        require_model(self.model)
        if self.model != "mlp" and (self.optimizer is not None or not self.warm_start):
            raise OptionError(f"optimizer and warm_start are options of model='mlp', got model={self.model!r}")
        require_positive("tolerance", self.tolerance, finite=False)
        require_positive("max_iterations", self.max_iterations)
        if self.unstable not in ("leave", "keep"):
            raise OptionError(f"unknown choice for unstable {self.unstable!r}; choose 'leave' or 'keep'")
        if self.between not in ("smooth", "quintic", "free"):
            raise OptionError(f"unknown choice for between {self.between!r}; choose 'smooth', 'quintic' or 'free'")
        _ = self.trainer  # checks the optimizer

    def require_rims(self, count: int) -> None:
        """Checks that the model supports this number of loops."""
        if count == 1 and self.laurent is not None:
            raise OptionError("Laurent series need two or more loops; use model='auto' or 'series' for one")
        if count > 1 and self.trainer is not None:
            raise OptionError("model 'mlp' supports one loop only; use model='auto', 'series' or 'cauchy' for several")
        if count > 2 and not self.is_automatic and not self.is_series:
            raise OptionError("Cauchy networks support one or two loops; use model='auto' or 'series' for more")

    @property
    def cauchy(self) -> Cauchy:
        """Options of the Cauchy network."""
        return self.model if isinstance(self.model, Cauchy) else Cauchy()

    @property
    def laurent(self) -> Laurent | None:
        """Options of the Laurent series, or None for other models."""
        return self.model if isinstance(self.model, Laurent) else None

    @property
    def trainer(self) -> Trainer | None:
        """Options of the training, or None for models that are not trained."""
        if self.model != "mlp":
            return None
        from spinor_geom.training import LevenbergMarquardt, RMSprop

        optimizer = self.optimizer or "levenberg-marquardt"
        if optimizer == "levenberg-marquardt":
            return LevenbergMarquardt()
        if optimizer == "rmsprop":
            return RMSprop()
        if not isinstance(optimizer, (LevenbergMarquardt, RMSprop)):
            raise OptionError(
                f"unknown optimizer {optimizer!r}; choose 'levenberg-marquardt', 'rmsprop', LevenbergMarquardt(...) or "
                "RMSprop(...)"
            )
        if isinstance(optimizer, RMSprop) and optimizer.representation != "spinor":
            raise OptionError(
                f"solve_plateau supports the representation 'spinor', not {optimizer.representation!r}; use "
                "spinor_geom.training.train_by_rmsprop for it"
            )
        return optimizer

    @property
    def is_automatic(self) -> bool:
        """Whether the routes are chosen by the shape of the loops."""
        return self.model == "auto" or isinstance(self.model, Laurent)

    @property
    def is_series(self) -> bool:
        """Whether the model is a power series, or a Laurent series for several loops."""
        return self.model == "series"

    @property
    def is_quintic(self) -> bool:
        """Whether Γ is a spline that is a differentiable function of the points."""
        return self.between == "quintic"

    @property
    def replaces_unstable(self) -> bool:
        """Whether unstable surfaces are replaced by ones of less area."""
        return self.unstable == "leave"
