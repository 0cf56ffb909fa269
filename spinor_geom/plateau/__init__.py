"""Plateau's problem for one or several boundary loops: the solver, its solutions and their checks.

A solve uses these modules, in this order:

- `solve`: the public functions
- `problem`: `PlateauProblem` (loops scaled to unit size, curves Γ through them, options) and the type `Route`
- `plan`: which routes are tried, in which order. The first surface within the tolerance is the solution
- the routes, each from a problem to a `RouteResult`:
  `plane_route` (plane loops), `harmonic` (Douglas's method for loops without corners), `vertices` (through the points
  of rough loops), `network` (Cauchy networks, also for corners), `rims` (several loops)
- `misfit`: the distance between boundary and Γ, with one definition for all routes
- `solution`: the surface in the caller's coordinates, with `evidence` computed on first use
- `mirrored`: films that meet planes of symmetry at right angles, as parts of films over reflected curves
- `disk_search`: disks of less area near unstable ones, and the search for all disks of a loop

A new route is a module with a `Route`, and a line in `plan`.
"""

from spinor_geom.plateau.annulus import Annulus
from spinor_geom.plateau.misfit import BoundaryResidual
from spinor_geom.plateau.options import Cauchy, Laurent
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.solve import solve_plateau, solve_plateau_batch
from spinor_geom.plateau.stability import Stability
from spinor_geom.plateau.steps import Iteration

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
