"""Plateau's problem for one loop or several: solver, solution and its evidence.

The way of a loop, from a module to the next, in one direction:

- `request`: the loops, simple and at unit size, and Γ, the curves through their points
- `plan`: which routes are tried, and in what order; the first surface within the tolerance is the answer
- Ω: `plane_route` takes the inside of Γ, `harmonic_route` the unit disk or a smooth one of `omega`, `network_route` and
  `vertex_route` a flattened discrete surface, `rims` a disk with round holes for several loops
- the slide along Γ: `douglas` by Dirichlet's energy, `gauss_newton` together with p and q; through points there is none
- p and q: `lift` from a harmonic disk, `network` as polynomials and Cauchy units
- `misfit`: how far the boundary is from Γ, in one definition for all
- `solution`: the surface in the loops' coordinates, with its `evidence` on demand; `solutions`: what unstable disks
  lead to
"""

from spinor_geom.plateau.misfit import BoundaryResidual
from spinor_geom.plateau.options import Cauchy, Laurent
from spinor_geom.plateau.solution import Annulus, NoConnectedSurface, PlateauSolution
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
