"""Plateau's problem for one loop or two: solver, solution and its evidence."""

from spinor_geom.plateau.network_route import Cauchy
from spinor_geom.plateau.solution import Annulus, BoundaryResidual, Iteration, NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.solve import solve_plateau, solve_plateau_batch
from spinor_geom.plateau.stability import Stability
from spinor_geom.plateau.task import Laurent

__all__ = [
    "Annulus",
    "BoundaryResidual",
    "Cauchy",
    "Iteration",
    "Laurent",
    "NoConnectedSurface",
    "PlateauSolution",
    "Stability",
    "solve_plateau",
    "solve_plateau_batch",
]
