"""A fit on Ω with spikes at corners near which the normal of the surface is reversed (see `domain.opening`).

With ζ as there, in a frame with the corner's plane p is ζ^((α − 1)/2) and q is ζ^((1 − α)/2) up to smooth factors,
where πα is the angle of Γ. Where both are equal the normal is in between. A fit on the given Ω shows this away from the
corner, which determines the size of the spike, and p and q in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from spinor_geom.arrays import EPS, Array, place_of, to_numpy
from spinor_geom.domain.opening import Opening
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary
from spinor_geom.errors import DomainError
from spinor_geom.plateau.network.discretisation import Discretisation, interpolate_matching
from spinor_geom.plateau.network.gauss_newton import Fit

_LEAST = 0.1  # ratio |p/q|² at a corner, in its frame, where the power law is measured


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tip:
    """A corner where the normal is reversed."""

    number: int  # of the corner
    at: float  # its parameter on ∂Ω
    angle: float  # α
    frame: Complex[np.ndarray, "2 2"]  # unit spinors whose normals are that of the corner's plane, and its opposite
    reach: Float[np.ndarray, "2"]  # differences of parameters before and after it where the power law is measured
    length: float  # distance in Ω from the corner where |p| = |q|

    def away(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Differences of parameters from the corner's, between −1/2 and 1/2."""
        return (t - self.at + 0.5) % 1.0 - 0.5

    def model(self, zeta: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n 2"]:
        """Values of p and q in the frame, on the image."""
        common = (1 + zeta) ** ((self.angle - 1) / 2)
        return np.stack([common, common * zeta ** (1 - self.angle)], axis=1)


def opened(
    stage: Discretisation, fit: Fit, *, offset: float
) -> tuple[Discretisation, Complex[Array, "n 2"], Float[Array, " nodes"]]:
    """A fit on Ω with spikes at corners where the normal is reversed: the discretisation, read-outs and slide.

    Raises a DomainError if there are none, or if the image of Ω would overlap itself.
    """
    tips, boundary, put = _tips(stage, fit), stage.domain.boundary, place_of(fit.readout).put
    assert isinstance(boundary, SplineBoundary)  # around flattened surfaces
    angles, lengths = np.full((2, len(stage.corners[0])), 0.0)
    for tip in tips:
        angles[tip.number], lengths[tip.number] = np.pi * tip.angle, tip.length
    opening = Opening.of(boundary, angles, lengths)
    if opening is None:
        raise DomainError("the plane domain has no corners that can be opened")
    new = Discretisation.first(
        PlaneDomain.inside(opening.boundary),
        stage.curves,
        stage.corners,
        degree=stage.degree,
        offset=offset,
        at_corner=stage.at_corner,
    )
    panels = new.panels
    t = opening.given_parameters(panels.t)
    factor, zeta = opening.factor(t)
    spinors = to_numpy(stage.network.features(put(boundary.point(t))) @ fit.readout) * factor[:, None]
    slide = interpolate_matching(stage.matchings(fit)[0], t)
    ends = opening.boundary.parameters[:-1][opening.boundary.corners]
    for tip, place in zip(tips, zeta, strict=True):
        along, model, sides, outer = (panels.t - ends[tip.number] + 0.5) % 1.0 - 0.5, tip.model(place), [], []
        for side, far in zip((-1, 1), tip.reach, strict=True):
            near = np.flatnonzero((side * along > 0) & (np.abs(tip.away(t)) <= far))
            sides.append(near[np.argsort(np.abs(along[near]))])
            outer.append((sides[-1][-1] + side) % len(t))
        amounts = (spinors[outer] @ tip.frame.conj().T / model[outer]).mean(axis=0)
        for near in sides:
            spinors[near] = (amounts * model[near]) @ tip.frame
            length = (np.abs(spinors[near]) ** 2).sum(axis=1) * (panels.weights * np.abs(panels.dz))[near]
            last = slide[near[-1]]
            width = (last - stage.corners[0][tip.number] + 0.5) % 1.0 - 0.5
            slide[near] = last + width * (np.cumsum(length) / length.sum() - 1)
    return new, new.readout_of(put(spinors)), put(slide)


def _tips(stage: Discretisation, fit: Fit) -> list[_Tip]:
    """The corners where the normal is reversed, by the power law on both sides."""
    boundary, put = stage.domain.boundary, place_of(fit.readout).put
    assert isinstance(boundary, SplineBoundary)  # around flattened surfaces
    arriving, leaving = (
        to_numpy(stage.curves[0].point_and_derivative(put((stage.corners[0] + side) % 1.0))[1])
        for side in (-(EPS**0.5), EPS**0.5)
    )
    normals = np.cross(arriving, leaving)
    sines = np.linalg.norm(normals, axis=1)
    angles = 1 - np.arctan2(sines, (arriving * leaving).sum(axis=1)) / np.pi
    ends = boundary.parameters[:-1][boundary.corners]
    corners = boundary.point(ends)
    own, lengths = boundary.corner_angles / np.pi, np.diff(np.append(ends, ends[0] + 1))
    spinors = to_numpy(stage.problem.features[: stage.problem.nodes] @ fit.readout)
    found = []
    for number, (x, y, z) in enumerate(normals / np.maximum(sines, EPS)[:, None]):
        frame = np.array([[1 + z, 1j * y - x], [x + 1j * y, 1 + z]])
        frame /= max(np.linalg.norm(frame[0]), EPS)
        p, q = np.abs(spinors @ frame.conj().T).T
        away = (stage.panels.t - ends[number] + 0.5) % 1.0 - 0.5
        distance, nodes = np.abs(stage.panels.z - corners[number]), []
        for side, length in ((-1, lengths[number - 1]), (1, lengths[number])):
            along = np.flatnonzero((side * away > 0) & (side * away < length / 2))
            along = along[np.argsort(distance[along])]
            large = np.flatnonzero(p[along] ** 2 > _LEAST * q[along] ** 2)
            if len(large) and large[-1] < len(along) - 1:
                nodes.append(along[large[-1]])
        if len(nodes) == 2 and own[number] > angles[number]:
            sizes = distance[nodes] * (p[nodes] / q[nodes]) ** (own[number] / (1 - angles[number]))
            found.append(
                _Tip(
                    number=number,
                    at=float(ends[number]),
                    angle=float(angles[number]),
                    frame=frame,
                    reach=np.abs(away[nodes]),
                    length=float(np.sqrt(sizes.prod())),
                )
            )
    return found
