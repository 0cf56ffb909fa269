"""The gradient of the area with respect to the points of the loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Shaped

from spinor_geom.gradients.curve_chain import by_points
from spinor_geom.gradients.rim_nodes import RimNodes
from spinor_geom.plateau.route_result import typed_failures
from spinor_geom.plateau.threads import one_thread

if TYPE_CHECKING:
    from spinor_geom.plateau.solution import PlateauSolution


def area_gradient(solution: PlateauSolution) -> tuple[Float[np.ndarray, "_ 3"], ...]:
    """See `PlateauSolution.area_gradient`."""
    with one_thread(), typed_failures():
        along = RimNodes.all_of(solution)
        gradients = [
            by_points(rim.curve, one.places, one.conormal) for rim, one in zip(solution.rims, along, strict=True)
        ]
    return as_given(solution, gradients)


def as_given(
    solution: PlateauSolution, by_rim: Sequence[Shaped[np.ndarray, "_ *c"]]
) -> tuple[Shaped[np.ndarray, "_ *c"], ...]:
    """Rows for the points of each rim, reordered to the order and the directions of the given loops."""
    if solution.annulus is None:
        return tuple(by_rim)
    given = sorted(zip(solution.annulus.order, by_rim, strict=True), key=lambda pair: pair[0])
    return tuple(
        np.concatenate([rows[:1], rows[:0:-1]]) if is_back else rows
        for (_, rows), is_back in zip(given, solution.annulus.backward, strict=True)
    )
