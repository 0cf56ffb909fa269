"""Films that meet planes of symmetry at right angles, from the film over the reflected curves.

Let F_i = ∫ N_i·φ dz for the unit normal N_i of plane i. The film meets the plane along a level line of Re F_i. There
φ·N_i is as long as dr/dz, because the film is orthogonal to the plane, so that Im F_i is the arc length, and the free
edge in Ω solves dz/dτ = ±i/(N_i·φ(z)).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import compress, pairwise, product
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float, Inexact
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from spinor_geom.arrays import EPS
from spinor_geom.domain.plane_domain import PARTS, TOWARDS_CORNER, PlaneDomain, SplineBoundary
from spinor_geom.domain.quadrature import rule
from spinor_geom.errors import OptionError, SurfaceError
from spinor_geom.mesh.array_checks import frozen
from spinor_geom.mesh.boundary_loop import BoundaryLoop, diagonals
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.open_curve import OpenCurve
from spinor_geom.mesh.piece_polynomials import ANALYTIC_DEGREE, piece_places, through
from spinor_geom.plateau.evidence import Evidence
from spinor_geom.plateau.newton import SMALL, STEPS_TO_ROUNDING
from spinor_geom.plateau.rim_match import RimMatch
from spinor_geom.plateau.solution import NoConnectedSurface, PlateauSolution
from spinor_geom.plateau.stability import EQUAL_NORMALS, Stability
from spinor_geom.surface.array_surface import PATH_ORDER, ArraySurface

_LONGEST = 20.0  # length of a free edge that ends nowhere, in diagonals
_END_POINTS = 6  # of a curve for the polynomial whose derivative is the tangent at its end
# Pieces of a free edge. It is traced in `PARTS` steps for each piece of an edge as long as the diagonal.
_PIECES = 24


@dataclass(frozen=True, kw_only=True, eq=False)
class MirrorPlanes:
    """One, two or three mutually orthogonal planes."""

    normals: Float[np.ndarray, "k 3"]
    offsets: Float[np.ndarray, " k"]

    @classmethod
    def of(cls, planes: ArrayLike) -> MirrorPlanes:
        """The planes through points with normals, (k, 2, 3). Raises an OptionError or a MeshShapeError for others."""
        given = frozen(planes, "real numbers", None, 2, 3, name="planes as pairs (point, normal)")
        if not 1 <= len(given) <= 3 or not np.isfinite(given).all():
            raise OptionError("planes of symmetry must be one to three pairs (point, normal) of finite numbers")
        length = np.linalg.norm(given[:, 1], axis=1)
        if not length.all():
            raise OptionError(f"the normal of plane {int(length.argmin())} is 0; give the direction of its normal")
        normals = given[:, 1] / length[:, None]
        if np.abs(normals @ normals.T - np.eye(len(normals))).max() > SMALL:
            raise OptionError("the planes of symmetry are not mutually orthogonal; give orthogonal normals")
        return cls(normals=normals, offsets=(normals * given[:, 0]).sum(axis=1))

    def heights(self, r: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n k"]:
        """Signed distances from the planes."""
        return np.asarray(r @ self.normals.T - self.offsets)

    def image(self, r: Float[np.ndarray, "n 3"], across: Sequence[bool]) -> Float[np.ndarray, "n 3"]:
        """Points reflected in some of the planes."""
        return np.asarray(r - 2 * (self.heights(r) * np.array(across)) @ self.normals)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Arc:
    """A given curve, with its ends moved onto their planes, and whether its reflection has a corner there."""

    points: Float[np.ndarray, "m 3"]
    corners: np.ndarray
    is_detected: bool
    planes: tuple[int, int]

    @classmethod
    def of(cls, curve: OpenCurve, number: int, planes: MirrorPlanes) -> _Arc:
        points, corners = np.array(curve.points), curve.is_corner
        ends, at = [], diagonals(points) * SMALL
        heights = planes.heights(points)
        for place, name in ((0, "start"), (-1, "end")):
            near = np.flatnonzero(np.abs(heights[place]) <= at)
            if len(near) != 1:
                where = "no plane" if not len(near) else f"{len(near)} planes"
                raise OptionError(f"the {name} of curve {number} lies on {where} of mirror; it must lie on one")
            plane = int(near[0])
            points[place] -= heights[place, plane] * planes.normals[plane]
            ends.append(plane)
            corners[place] = _turns(points if place == 0 else points[::-1], corners, place, planes.normals[plane])
        return cls(points=points, corners=corners, is_detected=curve.is_detected, planes=(ends[0], ends[1]))

    def loops(self, planes: MirrorPlanes) -> Iterator[BoundaryLoop]:
        """The closed curves of its images. The first begins with the curve itself."""
        first, last = self.planes
        around = [(), (last,)] if first == last else [(), (last,), (first, last), (first,)]
        others = [k for k in range(len(planes.normals)) if k not in self.planes]
        corners = np.concatenate([self.corners, self.corners[-2:0:-1]] * (len(around) // 2))
        for beyond in product((False, True), repeat=len(others)):
            points = []
            for number, turned in enumerate(around):
                across = (*turned, *compress(others, beyond))
                image = planes.image(self.points, [k in across for k in range(len(planes.normals))])
                # the ends, on the planes, are those of the image before or after, bit for bit
                points.append(image[-2:0:-1] if number % 2 else image)
            found: Any = "auto" if self.is_detected else np.flatnonzero(corners)
            yield BoundaryLoop.from_points(np.concatenate(points), corners=found)


def _turns(points: Float[np.ndarray, "m 3"], corners: np.ndarray, place: int, normal: Float[np.ndarray, "3"]) -> bool:
    """Whether a curve that starts at a plane and its reflection have a corner there."""
    inner = np.flatnonzero(corners[1:-1] if place == 0 else corners[-2:0:-1])
    near = points[: min(_END_POINTS, int(inner[0]) + 2 if len(inner) else len(points))]
    t = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(near, axis=0), axis=1)))
    slope = np.array([Polynomial.fit(t, axis, len(t) - 1).deriv()(0.0) for axis in near.T])
    return bool(np.linalg.norm(np.cross(slope, normal)) > EQUAL_NORMALS * np.linalg.norm(slope))


def open_curves(what: Any) -> list[OpenCurve]:
    """The open curves that an argument describes: an `OpenCurve`, (m, 3) points, or a sequence of these."""
    if isinstance(what, OpenCurve):
        return [what]
    if isinstance(what, str) or not isinstance(what, Sequence | np.ndarray):
        raise OptionError(f"with mirror= give an OpenCurve, an array of points, or several, not {type(what).__name__}")
    if len(what) and not isinstance(what[0], OpenCurve) and np.ndim(what[0]) == 1:
        return [OpenCurve(np.asarray(what))]
    return [one if isinstance(one, OpenCurve) else OpenCurve(np.asarray(one)) for one in what]


def solve_mirrored(
    curves: Sequence[OpenCurve], planes: MirrorPlanes, solve: Callable[..., Any], tolerance: float
) -> PlateauSolution | NoConnectedSurface:
    """The part on one side of the planes of the film over curves and their reflections. See `solve_plateau`."""
    if not curves:
        raise OptionError("a film needs at least one open curve, got an empty sequence")
    arcs = [_Arc.of(curve, number, planes) for number, curve in enumerate(curves)]
    points = np.concatenate([arc.points for arc in arcs])
    heights = planes.heights(points)
    beyond = np.minimum(heights.max(axis=0), -heights.min(axis=0)) > SMALL * diagonals(points)
    if beyond.any():
        raise OptionError(
            f"the curves lie on both sides of plane {int(beyond.argmax())} of mirror; give those on one side"
        )
    whole = solve([loop for arc in arcs for loop in arc.loops(planes)], tolerance=tolerance)
    if isinstance(whole, NoConnectedSurface):
        return whole
    part = _Part(whole=whole, arcs=arcs, planes=planes).solution
    return replace(part, solved_to=partial(solve_mirrored, curves, planes, solve))


@dataclass(frozen=True, kw_only=True, eq=False)
class _PartEvidence(Evidence):
    """The evidence of a part, whose free edges may move in their planes: its stability is that of the whole film."""

    whole: Evidence

    @cached_property
    def stability(self) -> Stability:
        return self.whole.stability


@dataclass(frozen=True, kw_only=True, eq=False)
class _Curve:
    """Polynomial pieces of a curve: its values at the `piece_places` of pieces of given widths."""

    widths: Float[np.ndarray, " m"]
    values: Inexact[np.ndarray, "d m *k"]  # complex, or positions
    corners: Bool[np.ndarray, " m"]  # which pieces start at a corner


@dataclass(frozen=True, kw_only=True, eq=False)
class _Side:
    """A side of the part, over an interval that begins at 0."""

    length: float
    plane: _Curve  # on ∂Ω
    space: _Curve  # on Γ
    slopes: Float[np.ndarray, "d m 3"]  # Γ′
    ends: Float[np.ndarray, "2 3"]  # of Γ
    at_loop: Bool[np.ndarray, " m"]  # which pieces of Γ start at points of the loop
    pairs: Float[np.ndarray, "n 2"]  # matched parameters of ∂Ω and of Γ
    is_free: bool = False

    def between(self, before: _Side, after: _Side) -> _Side:
        """A free edge whose ends, which are off by the boundary residual, are moved to its neighbours.

        Displacements of an end decrease with a power of the distance from the other end, the highest that is exact.
        """
        x = (np.arange(_PIECES) + piece_places()[:, None])[..., None] / _PIECES
        first = before.ends[1] - self.ends[0]
        last = np.zeros(3) if after.is_free else after.ends[0] - self.ends[1]
        moved = (1 - x) ** ANALYTIC_DEGREE * first + x**ANALYTIC_DEGREE * last
        turned = (
            ANALYTIC_DEGREE
            / self.length
            * (x ** (ANALYTIC_DEGREE - 1) * last - (1 - x) ** (ANALYTIC_DEGREE - 1) * first)
        )
        space = replace(self.space, values=self.space.values + moved)
        return replace(self, space=space, slopes=self.slopes + turned, ends=self.ends + np.stack([first, last]))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Placed:
    """A given curve on a rim: its ranges of t and s, in the direction of the rim, and the planes of both ends."""

    rim: RimMatch
    t: tuple[float, float]
    s: tuple[float, float]
    planes: tuple[int, int]

    @classmethod
    def on(cls, arc: _Arc, solution: PlateauSolution) -> _Placed:
        for rim in solution.rims:
            n, at = len(rim.loop), [np.flatnonzero((rim.loop.points == r).all(axis=1)) for r in arc.points[[0, 1, -1]]]
            if all(len(found) for found in at):
                first, second, last = (int(found[0]) for found in at)
                is_ahead = (first + 1) % n == second
                start, end = (first, last) if is_ahead else (last, first)
                s = rim.curve.at_loop[[start, end]]
                t = np.concatenate([rim.parameters(s[k : k + 1]) for k in (0, 1)])
                # after the first point of the loop
                t[1], s[1] = t[1] + (t[1] <= t[0]), s[1] + (s[1] <= s[0])
                planes = arc.planes if is_ahead else arc.planes[::-1]
                return cls(rim=rim, t=(t[0], t[1]), s=(s[0], s[1]), planes=planes)
        raise SurfaceError("the boundary of the film does not contain the given curves")

    @property
    def side(self) -> _Side:
        curve, boundary = self.rim.curve, self.rim.boundary
        (t, of_plane), (s, of_space) = _cut(boundary.parameters, self.t), _cut(curve.breaks, self.s)
        length = float(np.linalg.norm(np.diff(curve.point(s), axis=0), axis=1).sum())
        rate, by_t = (length / (ends[1] - ends[0]) for ends in (self.s, self.t))
        z = boundary.point(t[:-1] + np.diff(t) * piece_places()[:, None])
        at = s[:-1] + np.diff(s) * piece_places()[:, None]
        known = np.arange(len(curve.breaks) - 1) if curve.at_points is None else np.flatnonzero(curve.at_points)
        pairs = np.concatenate([self.rim.matching + turn for turn in (-1, 0, 1, 2)])
        inside = (pairs > [self.t[0], self.s[0]]).all(axis=1) & (pairs < [self.t[1], self.s[1]]).all(axis=1)
        pairs = np.vstack([[self.t[0], self.s[0]], pairs[inside]])
        return _Side(
            length=length,
            plane=_Curve(widths=np.diff(t) * by_t, values=z, corners=boundary.corners[of_plane]),
            space=_Curve(widths=np.diff(s) * rate, values=curve.point(at), corners=curve.corners[of_space]),
            slopes=curve.derivative(at) / rate,
            ends=curve.point(np.array(self.s)),
            at_loop=np.isin(of_space, known),
            pairs=(pairs - [self.t[0], self.s[0]]) * [by_t, rate],
        )


def _cut(breaks: Float[np.ndarray, " m1"], ends: tuple[float, float]) -> tuple[Float[np.ndarray, " k1"], np.ndarray]:
    """The ends of pieces in an interval, and the numbers of these pieces."""
    m = len(breaks) - 1
    starts = (breaks[:-1] + np.arange(-1, 3)[:, None]).ravel()
    rounding = EPS**0.5
    inside = np.flatnonzero((starts > ends[0] + rounding) & (starts < ends[1] - rounding))
    first = int(np.searchsorted(starts, ends[0] + rounding)) - 1
    return np.array([ends[0], *starts[inside], ends[1]]), np.append(first, inside) % m


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """The part of a film on one side of planes of symmetry."""

    whole: PlateauSolution
    arcs: Sequence[_Arc]
    planes: MirrorPlanes

    @property
    def solution(self) -> PlateauSolution:
        sides, whole, surface = self._sides(), self.whole, self.whole.array_surface
        starts = np.append(0.0, np.cumsum([side.length for side in sides]))
        breaks, values, corners = _chained([side.plane for side in sides], starts)
        plane = through(np.stack([values.real, values.imag], axis=-1), np.diff(breaks))
        boundary = SplineBoundary(breaks, plane[..., 0] + 1j * plane[..., 1], corners)
        domain = PlaneDomain.inside(boundary)
        breaks, values, corners = _chained([side.space for side in sides], starts)
        slopes = np.concatenate([side.slopes for side in sides], axis=1) * starts[-1]
        at_loop = np.concatenate([side.at_loop for side in sides])
        curve = BoundaryCurve(
            kind="analytic",
            breaks=breaks,
            coefficients=through(values, np.diff(breaks)),
            corners=corners,
            slopes=through(slopes, np.diff(breaks)),
            at_points=None if at_loop.all() else at_loop,
        )
        loop = BoundaryLoop.from_points(values[0, at_loop], corners=np.flatnonzero(corners[at_loop]))
        spans = pairwise((starts / starts[-1]).tolist())
        pairs = [(side.pairs + start) / starts[-1] for side, start in zip(sides, starts, strict=False)]
        root = domain.triangulation.points[domain.root : domain.root + 1]
        make = partial(ArraySurface, surface.model, domain, surface.position(root)[0], spinor_map=surface.spinor_map)
        return replace(
            whole,
            rims=(RimMatch(loop=loop, curve=curve, boundary=boundary, matching=np.concatenate(pairs)),),
            domain=domain,
            boundary_residual=replace(whole.boundary_residual, diagonal=loop.diagonal),
            area=whole.area / 2 ** len(self.planes.normals),
            route="mirrored",
            evidence=_PartEvidence(make=make, whole=whole.evidence),
            annulus=None,
            free_edges=tuple(span for span, side in zip(spans, sides, strict=True) if side.is_free),
        )

    def _sides(self) -> list[_Side]:
        """The sides of the part in the direction of its boundary: given curves, and the free edges between them."""
        placed = [_Placed.on(arc, self.whole) for arc in self.arcs]
        left, at, sides = set(range(len(placed))), 0, []
        while at in left:
            left.remove(at)
            own = placed[at]
            sides.append(own.side)
            boundary, plane = own.rim.boundary, own.planes[1]
            z = complex(boundary.point(np.array(own.t[1])))
            before = complex(boundary.derivative(np.array(np.nextafter(own.t[1] + 1, 0))))
            reached = None
            while reached is None:
                starts = {k: one for k, one in enumerate(placed) if one.planes[0] == plane}
                targets = {k: complex(one.rim.boundary.point(np.array(one.t[0]))) for k, one in starts.items()}
                path, reached, other = self._traced(z, before, plane, targets)
                sides.append(self._free_side(path, plane))
                if other is not None:
                    z, before, plane = complex(path[-1]), complex(path[-1] - path[-2]), other
            at = reached
        if left:
            raise SurfaceError(f"the part of the film is no disk: its boundary does not reach curve {min(left)}")
        for k, side in enumerate(sides):
            if side.is_free:
                sides[k] = side.between(sides[k - 1], sides[(k + 1) % len(sides)])
        return sides

    def _integral(self, start: Complex[np.ndarray, " m"], end: Complex[np.ndarray, " m"]) -> Complex[np.ndarray, "m 3"]:
        """∫ φ dz along segments."""
        gauss = rule("gauss", PATH_ORDER)
        z = start[:, None] + (end - start)[:, None] * gauss.nodes
        values = self.whole.array_surface.null_curve(z.ravel()).reshape(*z.shape, 3)
        return np.asarray(np.einsum("mgk,g,m->mk", values, gauss.weights, end - start))

    def _traced(
        self, z: complex, before: complex, plane: int, targets: dict[int, complex]
    ) -> tuple[Complex[np.ndarray, " k"], int | None, int | None]:
        """Points in Ω along the free edge on a plane, up to the start of a given curve or to another plane.

        Returns with them the number of the curve or of the other plane.
        """
        surface, planes, step = self.whole.array_surface, self.planes, self.whole.diagonal / (PARTS * _PIECES)

        def ahead(w: complex) -> complex:
            return 1j / complex(surface.null_curve(np.array([w]))[0] @ planes.normals[plane])

        path, r = [z], surface.position(np.array([z]))[0]
        ends = {k: surface.position(np.array([target]))[0] for k, target in targets.items()}
        way = step if (np.conj(before) * ahead(z)).imag > 0 else -step
        for number in range(int(_LONGEST * PARTS * _PIECES)):
            reached = [k for k, end in ends.items() if np.linalg.norm(end - r) < 1.5 * step]
            if reached and number:
                return np.array([*path, targets[reached[0]]]), reached[0], None
            # the midpoint rule, then a step of Newton's method towards the plane
            new = z + way * ahead(z + 0.5 * way * ahead(z))
            moved = r + surface.integrate(np.array([z]), np.array([new]))[0]
            new += 1j * planes.heights(moved)[plane] * ahead(new)
            crossed = np.flatnonzero(planes.heights(r) * planes.heights(moved) < 0)
            crossed = crossed[crossed != plane]
            if len(crossed) and number:
                return np.array([*path, self._crossing(new, plane, int(crossed[0]))]), None, int(crossed[0])
            r = r + surface.integrate(np.array([z]), np.array([new]))[0]
            z = new
            path.append(z)
        raise SurfaceError("a free edge of the film ends at no given curve; the part inside is no disk with free edges")

    def _crossing(self, z: complex, plane: int, other: int) -> complex:
        """The point near z where the film meets two planes, by Newton's method."""
        both = [plane, other]
        for _ in range(STEPS_TO_ROUNDING):
            slope = self.whole.array_surface.null_curve(np.array([z]))[0] @ self.planes.normals[both].T
            away = self.planes.heights(self.whole.array_surface.position(np.array([z]))[0])[both]
            x, y = np.linalg.solve(np.stack([slope.real, -slope.imag], axis=1), -away)
            z += complex(x, y)
        return z

    def _free_side(self, path: Complex[np.ndarray, " k"], plane: int) -> _Side:
        """The free edge near points of Ω: Re F is 0, except near ends that are off the plane by the residual."""
        normal, surface = self.planes.normals[plane], self.whole.array_surface
        first, last = path[1] - path[0], path[-2] - path[-1]
        path = np.concatenate(
            [path[:1], path[0] + first * TOWARDS_CORNER[::-1], path[1:-1], path[-1] + last * TOWARDS_CORNER, path[-1:]]
        )
        along = np.concatenate([np.zeros((1, 3)), np.cumsum(self._integral(path[:-1], path[1:]), axis=0)])
        # at the ends, which are on ∂Ω, paths of integration are less accurate
        middle = len(path) // 2
        start = surface.position(path[[middle]]) - along[middle].real
        away = self.planes.heights(np.concatenate([start, start + along[-1].real]))[:, plane]
        f = along @ normal + away[0]
        length = float(abs(f[-1].imag))
        x = (np.arange(_PIECES) + piece_places()[:, None]).ravel() / _PIECES
        wanted = away @ [(1 - x) ** ANALYTIC_DEGREE, x**ANALYTIC_DEGREE] + 1j * x * f[-1].imag
        near = np.abs(x[:, None] - f.imag / f[-1].imag).argmin(axis=1)
        z = path[near]
        for _ in range(STEPS_TO_ROUNDING):
            moved = self._integral(path[near], z)
            z = z + (wanted - f[near] - moved @ normal) / (surface.null_curve(z) @ normal)
        if np.abs(surface.normal(z[_PIECES:-_PIECES]) @ normal).max() > EQUAL_NORMALS:
            raise SurfaceError("the film is not orthogonal to the planes: it has less symmetry than its curves")
        phi = surface.null_curve(z)
        r = start + (along[near] + self._integral(path[near], z)).real
        slopes = (phi * (1j * np.sign(f[-1].imag) / (phi @ normal))[:, None]).real
        r -= self.planes.heights(r)[:, [plane]] * normal
        slopes -= (slopes @ normal)[:, None] * normal
        shape, ends = (len(piece_places()), _PIECES), np.append(TOWARDS_CORNER, _PIECES - TOWARDS_CORNER)
        is_first = np.arange(_PIECES) == 0
        widths = np.full(_PIECES, length / _PIECES)
        return _Side(
            length=length,
            plane=_Curve(widths=widths, values=z.reshape(shape), corners=is_first),
            space=_Curve(widths=widths, values=r.reshape(*shape, 3), corners=is_first),
            slopes=slopes.reshape(*shape, 3),
            ends=np.stack([r[0], (start + along[-1].real - away[1] * normal)[0]]),
            at_loop=np.ones(_PIECES, dtype=bool),
            # graded towards the ends, beyond which the ratio of t to s is another one
            pairs=np.repeat(np.union1d(np.arange(_PIECES), ends)[:, None] * length / _PIECES, 2, axis=1),
            is_free=True,
        )


def _chained(
    curves: Sequence[_Curve], starts: Float[np.ndarray, " k1"]
) -> tuple[Float[np.ndarray, " m1"], Inexact[np.ndarray, "d m *k"], Bool[np.ndarray, " m"]]:
    """The breaks on [0, 1], the values and the corners of a closed curve of several."""
    breaks = [start + np.append(0.0, np.cumsum(one.widths)[:-1]) for one, start in zip(curves, starts, strict=False)]
    corners = [np.append(True, one.corners[1:]) for one in curves]
    values = np.concatenate([one.values for one in curves], axis=1)
    return np.append(np.concatenate(breaks) / starts[-1], 1.0), values, np.concatenate(corners)
