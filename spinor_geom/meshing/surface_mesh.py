"""From any spinor surface to a triangle mesh whose vertices all lie on it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex

from spinor_geom.domain.plane_domain import Boundary
from spinor_geom.errors import OptionError, SurfaceError
from spinor_geom.meshing.embed import Patch
from spinor_geom.meshing.triangulate import piece_of, triangulate_pieces
from spinor_geom.surface.spinor_surface import SpinorSurface

# points at which the length of each piece of the boundary is measured, and the fewest edges of a side between corners
_FINE = 16
_FEWEST = 6


def mesh_surface(surface: SpinorSurface, *, vertices: int = 4000) -> Patch:
    """Meshes a whole surface with edges of about equal lengths in space; every vertex, the rim's too, is on it.

    A patch for a mesh, with the loop's own points as its rim, is `mesh_patch`.

    Args:
        surface: Over any domain.
        vertices: About so many.

    Raises:
        OptionError: Fewer than 3 vertices are asked for.
        SurfaceError: The surface is not finite on its domain.
    """
    if vertices < 3:
        raise OptionError(f"a mesh needs at least 3 vertices, got {vertices}")
    area = surface.area()
    if not 0 < area < np.inf:
        raise SurfaceError(f"the surface has the area {area}: p or q has a pole in its domain, or both are 0")
    # of equilateral triangles, two for each vertex
    target = float(np.sqrt(2 * area / (3**0.5 * vertices)))
    rims = [_rim(surface, boundary, target) for boundary in (surface.domain.boundary, *surface.domain.holes)]
    (plane,) = triangulate_pieces([piece_of(surface, rims, target, area)])
    positions = np.asarray(surface.position(plane.points))
    if not np.isfinite(positions).all():
        raise SurfaceError("the surface is not finite inside its domain: p or q has a pole there")
    return Patch(
        vertices=positions,
        faces=plane.faces,
        boundary_size=plane.boundary_size,
        points=plane.points,
        hole_sizes=tuple(len(rim) for rim in rims[1:]),
    )


def _rim(surface: SpinorSurface, boundary: Boundary, target: float) -> Complex[np.ndarray, " m"]:
    """Points of a part of ∂Ω, its corners among them, about `target` apart in space."""
    pieces = boundary.parameters
    t = np.append((pieces[:-1, None] + np.diff(pieces)[:, None] * (np.arange(_FINE) / _FINE)).ravel(), 1.0)
    middle, width = (t[1:] + t[:-1]) / 2, np.diff(t)
    speed = np.asarray(surface.conformal_factor(boundary.point(middle))) * np.abs(boundary.derivative(middle))
    length = np.append(0.0, np.cumsum(speed * width))
    starts = np.flatnonzero(boundary.corners) * _FINE
    if not len(starts):
        starts = np.array([0])
    sides = []
    for start, end in zip(starts, np.append(starts[1:], starts[0] + len(t) - 1), strict=True):
        # the last side may run over the end of the parameter
        from_, to = length[start], length[end % (len(t) - 1)] + (length[-1] if end >= len(t) - 1 else 0.0)
        count = max(_FEWEST, round((to - from_) / target))
        at = from_ + (to - from_) * np.arange(count) / count
        sides.append(np.interp(at % length[-1], length, t))
    return boundary.point(np.concatenate(sides))
