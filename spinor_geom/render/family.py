"""The associate family of a surface as layers: two arrays of positions, and the cosine and sine of one angle."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from jaxtyping import Complex, Float, Int

from spinor_geom.domain.panels import Panels
from spinor_geom.domain.plane_domain import PlaneDomain, sampled
from spinor_geom.errors import PeriodError
from spinor_geom.meshing.embed import mesh_surface
from spinor_geom.render.colours import BACK_COLOUR, FRONT_COLOUR, GRID_COLOUR
from spinor_geom.render.layers import Faces, Lines
from spinor_geom.surface import SpinorSurface, formulas

GAUSS = "Gauss curvature"
VERTICES = 4000
# lines of the grid across the longer side of Ω, and points on each
GRID_LINES, _LINE_POINTS = 16, 240
# a period larger than this share of the boundary's length is no error of the quadrature
_LARGEST_PERIOD = 1e-6


def associate_family(surface: SpinorSurface, *, vertices: int = VERTICES) -> tuple[Faces, Lines, Lines]:
    """All surfaces with φ turned into e^{iθ}φ: they are isometric and have the same normals and Gauss curvature.

    Args:
        surface: over a domain around which ∮ φ dz = 0, as around every one without poles of p and q.
        vertices: of the mesh.

    Returns:
        The surface with its Gauss curvature as a field, the image of a square grid in Ω, and the boundary, all on the
        same vertices, those of the boundary first. Their conjugates have the same mean as they.

    Raises:
        PeriodError: the conjugate surface does not close around ∂Ω or a hole, so that it has no mesh on this domain.
        SurfaceError: the surface is not finite on its domain.
    """
    if not surface.domain.holes:  # around those `associate` looks itself
        _check_periods(surface)
    mesh = mesh_surface(surface, vertices=vertices)
    ends, lines = grid_lines(surface.domain)
    points = np.concatenate([mesh.points, ends])
    own = np.concatenate([mesh.vertices, np.asarray(surface.position(ends)).reshape(-1, 3)])
    conjugate = np.asarray(surface.associate(np.pi / 2).position(points))
    places: dict[str, Any] = {"vertices": own, "conjugate": conjugate - conjugate.mean(axis=0) + own.mean(axis=0)}
    fields = {GAUSS: np.asarray(surface.gauss_curvature(points))}
    rim = np.arange(mesh.boundary_size)
    return (
        Faces(**places, faces=mesh.faces, colour=FRONT_COLOUR, inside=BACK_COLOUR, fields=fields),
        Lines(**places, edges=lines + len(mesh.points), colour=GRID_COLOUR, width=0.75),
        Lines(**places, edges=np.stack([rim, np.roll(rim, -1)], axis=1), width=2.5),
    )


def grid_lines(
    domain: PlaneDomain, count: int = GRID_LINES
) -> tuple[Complex[np.ndarray, " n"], Int[np.ndarray, "l 2"]]:
    """Points on the lines of a square grid inside Ω, and the pairs of them that are neighbours on a line.

    Args:
        domain: Ω.
        count: lines across the longer side of its bounding box.
    """
    v = sampled(domain.boundary, 8)
    low, size = complex(v.real.min(), v.imag.min()), complex(np.ptp(v.real), np.ptp(v.imag))
    step, along = max(size.real, size.imag) / count, np.linspace(0, 1, _LINE_POINTS)
    upright = low.real + size.real / 2 + step * _places(size.real / step)
    level = low.imag + size.imag / 2 + step * _places(size.imag / step)
    z = np.concatenate(
        [upright[:, None] + 1j * (low.imag + size.imag * along), (low.real + size.real * along) + 1j * level[:, None]]
    )
    inside = domain.contains(z)
    number = np.cumsum(inside.ravel()).reshape(z.shape) - 1
    both = inside[:, 1:] & inside[:, :-1]
    return z[inside], np.stack([number[:, :-1][both], number[:, 1:][both]], axis=1)


def _places(across: float) -> Float[np.ndarray, " k"]:
    """Places of lines one apart, one of them in the middle, on a length that begins and ends on none."""
    most = int(np.ceil(across / 2 - 1e-9)) - 1
    return np.arange(-most, most + 1, dtype=np.float64)


def _check_periods(surface: SpinorSurface) -> None:
    domain = surface.domain
    panels = Panels.on(domain.boundary, domain.panel_breaks, surface.order)
    with torch.no_grad():
        p, q = surface.spinors(torch.from_numpy(panels.z).to(surface.constant.device)).unbind(-1)
        phi, factor = (a.cpu().resolve_conj().numpy() for a in (formulas.phi(p, q), formulas.conformal_factor(p, q)))
    period = ((panels.dz * panels.weights)[:, None] * phi).sum(axis=0)
    length = float((panels.arc_weights * factor).sum())
    if not np.abs(period).max() <= _LARGEST_PERIOD * length:
        around = "the domain's boundary, as p or q has a pole inside"
        raise PeriodError(angle=np.pi / 2, around=around, period=(-period.imag).tolist())
