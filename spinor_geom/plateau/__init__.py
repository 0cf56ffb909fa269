"""Plateau's problem for one loop: solver, solution and its evidence."""

from spinor_geom.plateau.network_route import Cauchy
from spinor_geom.plateau.solution import BoundaryResidual, Iteration, PlateauSolution, Stability
from spinor_geom.plateau.solve import solve_plateau, solve_plateau_batch

__all__ = [
    "BoundaryResidual",
    "Cauchy",
    "Iteration",
    "PlateauSolution",
    "Stability",
    "solve_plateau",
    "solve_plateau_batch",
]
