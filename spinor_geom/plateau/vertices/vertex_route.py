"""The route for rough rims: the minimal surface through their points that is nearest to a discrete or a smooth one.

A mesh has only the points of a rim, so Γ between them is the boundary of the surface. Points are added on long edges,
where this boundary would be far from the edge. n points give 3n equations for the read-outs of p and q, fewer than
unknowns. The solution is the one nearest to p and q of a start in the H¹ norm on ∂Ω: p and q then hardly vary along an
edge, and Γ is close to the rim's edges. There is no slide, and two to six Newton steps suffice.

For one rim the start is a discrete minimal disk, and Ω is the disk flattened with its boundary lengths. For several
rims the start is the smooth surface over averages of the rims, on a circular domain. Its nearest points to the rims'
points, along the tangent planes, are the vertices of ∂Ω. p and q are sums of polynomials and Cauchy units, with poles
beside each edge and deeper in each hole. Three equations for each hole make Re ∮ φ dz = 0.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Complex, Float, Int

from spinor_geom.arrays import Array, norm, place_of, shifted
from spinor_geom.deadline import is_out_of_time
from spinor_geom.discrete.first_fill import LONGEST
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.domain.flattening import Flattening, flatten
from spinor_geom.domain.plane_domain import PlaneDomain, SplineBoundary
from spinor_geom.domain.quadrature import cumulative_matrix
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import DomainError, OutOfTimeError, SurfaceError
from spinor_geom.holomorphic.poles import polygon_poles
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.mesh.piece_polynomials import piece_places, through
from spinor_geom.plateau.initial_spinors import lifted_spinors
from spinor_geom.plateau.misfit import Misfit
from spinor_geom.plateau.problem import PlateauProblem, Route
from spinor_geom.plateau.route_result import RouteResult
from spinor_geom.plateau.vertices.through_points import NODES, Basis, Passing, nearest_through
from spinor_geom.surface.array_surface import ArraySurface
from spinor_geom.surface.interior import RimPrimitive

# Largest distance of a start from the points, and of Γ from the rim's edges, in mean edges. One in seven rims cut along
# triangles exceeds half of it. Along a rim the errors of a start's edges add up like a random walk, so starts of more
# than `LONGEST` points may be farther away: 3.4 for 1,200 points with noise of 30 % of an edge, where Newton's method
# still converges. For rims of scans it did not converge from starts beyond this limit.
_FAR = 2.0


def disk_through_points(problem: PlateauProblem) -> RouteResult:
    """The minimal disk through the points of a rough loop that is nearest to a discrete minimal disk.

    Raises:
        SurfaceError: the start is too far from conformal, or Γ runs too far from the loop's edges.
        DomainError: the disk has no simple flattening.
        OutOfTimeError: time ran out.
    """
    loop, place, allowed = problem.unit, problem.options.place, problem.allowed
    (points, are_own), clock = problem.unit.divided, problem.clock
    with clock.stage("first fill"):
        disk = problem.start or first_disk(points)
    with clock.stage("flattening"):
        flat = flatten(disk.vertices, disk.faces, len(points))
        images = flat.images
        domain = _domain(disk.faces, images, flat)
        spinors = lifted_spinors(disk.vertices, disk.faces, images, (len(points),), place)
    raw: Complex[Array, "k 2"] | None = None
    for nodes in (NODES, 2 * NODES):
        left = problem.steps.left
        try:
            with clock.stage("features"):
                polygon = place.put(flat.boundary)
                basis = Basis.on([polygon], [polygon_poles(flat.boundary)], nodes=nodes)
            with clock.stage("fit"):
                raw = _fitted(basis, spinors, raw, problem)
        except OutOfTimeError:
            if raw is None:
                raise
            break  # keep the surface with fewer nodes
        with clock.stage("surface"):
            network = basis.network(raw)
            (rim,) = ArraySurface(network, domain).rim_primitives(2 * nodes)
            error = rim.at_breaks[:-1].real - points
            error -= error.mean(axis=0)
        distance = np.linalg.norm(error) / len(points) ** 0.5
        # more nodes do not help a start that is far away and allows no step
        is_stuck = problem.steps.left == left and distance > 0.1 * loop.mean_edge_length
        if distance <= allowed or is_stuck or is_out_of_time():
            break
    with clock.stage("surface"):
        root = domain.root
        at_root = rim.at_breaks[root] if root < len(points) else rim.inside(domain.triangulation.points[[root]])[0]
        surface = ArraySurface(network, domain, points[0] + error[0] + at_root.real)
        surface.rim = rim
        found = passed(surface, [rim], [points], [error], area=rim.area, near="the discrete one")
        found = replace(found, curves=(replace(found.curves[0], at_points=are_own),))
        bulge = found.curves[0].bulge() / loop.mean_edge_length
        if not bulge <= _FAR:
            raise SurfaceError(
                f"the boundary of the surface through the loop's points is up to {bulge:.1f} edges away from its edges"
            )
        return found


THROUGH_POINTS = Route("vertices", disk_through_points)


def _fitted(
    basis: Basis, spinors: Complex[Array, "n 2"], raw: Complex[Array, "k 2"] | None, problem: PlateauProblem
) -> Complex[Array, "k 2"]:
    """Read-outs of the surface through all points nearest to spinors at edge midpoints. `raw` is an initial guess."""
    start = basis.rims[0].nearest_between(spinors)
    readout = start if raw is None else basis.readout(raw)
    wanted = place_of(start).put(problem.unit.divided[0])
    here = Passing(basis=basis, points=(wanted,), raw=basis.raw(readout))
    in_edges = here.distance / problem.unit.mean_edge_length
    if not in_edges <= _FAR * max(1.0, len(wanted) / LONGEST) ** 0.5:
        raise SurfaceError(
            "the flattened discrete disk over the loop is too far from conformal: p and q of its frames give "
            f"a surface {in_edges:.0f} edges away from the points"
        )
    return basis.raw(nearest_through(here, readout, start=start, allowed=problem.allowed, steps=problem.steps))


def _domain(faces: Int[np.ndarray, "f 3"], images: Complex[np.ndarray, " n"], flat: Flattening) -> PlaneDomain:
    """The inside of the flattened boundary, with the triangles of the disk if none is flipped."""
    boundary = polygon_through(flat.boundary)
    a, b, c = images[faces].T
    if not ((np.conj(b - a) * (c - a)).imag > 0).all():
        return PlaneDomain.inside(boundary, flat.log_scale)
    mesh = PlaneTriangulation(points=images, faces=faces, boundary_size=len(flat.boundary))
    return PlaneDomain(boundary=boundary, triangulation=mesh, log_scale=flat.log_scale)


def passed(
    surface: ArraySurface,
    rims: Sequence[RimPrimitive],
    points: Sequence[Float[np.ndarray, "_ 3"]],
    errors: Sequence[Float[np.ndarray, "_ 3"]],
    *,
    area: float,
    near: str,
) -> RouteResult:
    """The result for a surface whose boundary differs from the points of each rim by `errors`."""
    curves, misfits = [], []
    for rim, own, error in zip(rims, points, errors, strict=True):
        velocity = rim.velocity.real.reshape(len(own), -1, 3) * np.diff(rim.panels.breaks)[:, None, None]
        curves.append(_curve_through(own, velocity, error))
        misfits.append(_misfit_at_points(curves[-1], error))
    return RouteResult(
        domain=surface.domain,
        surface_at=surface.placed,
        curves=tuple(curves),
        matchings=tuple(
            np.column_stack([boundary.parameters[:-1], curve.breaks[:-1]])
            for boundary, curve in zip(surface.domain.boundaries, curves, strict=True)
        ),
        misfit=Misfit.together(misfits),
        area=area,
        route="vertices",
        limit=f"no minimal surface near {near} was found closer to the points",
    )


def _curve_through(
    points: Float[np.ndarray, "n 3"], velocity: Float[np.ndarray, "n g 3"], error: Float[np.ndarray, "n 3"]
) -> BoundaryCurve:
    """Γ: a surface's boundary minus its errors at the points, which are interpolated linearly between them.

    `velocity` is the derivative of r by the share of each edge, at Gauss-Legendre nodes. The errors of the polynomials
    at the ends of the pieces are removed likewise: curves with gaps have no patches.
    """
    place = piece_places()
    within = np.einsum("hg,ngk->hnk", cumulative_matrix(velocity.shape[1], tuple(place)), velocity)
    values = points + within - place[:, None, None] * (shifted(error, -1, axis=0) - error)
    chord = norm(shifted(points, -1, axis=0) - points)
    breaks = np.append(0.0, np.cumsum(chord) / chord.sum())
    breaks[-1] = 1.0
    values[0] = points
    width, corners = np.diff(breaks)[:, None], np.ones(len(points), dtype=bool)
    coefficients = through(values, width[:, 0])
    powers = np.arange(len(coefficients) - 1, -1, -1)[:, None, None]
    ends = (coefficients * width**powers).sum(axis=0)
    coefficients[-2] += (shifted(points, -1, axis=0) - ends) / width
    return BoundaryCurve(kind="analytic", breaks=breaks, coefficients=coefficients, corners=corners)


def _misfit_at_points(curve: BoundaryCurve, error: Float[np.ndarray, "n 3"]) -> Misfit:
    """The misfit of a boundary with given errors at the points, linear between them."""
    points = curve.coefficients[-1]
    length = norm(shifted(points, -1, axis=0) - points)
    after, local_edge = shifted(error, -1, axis=0), (length + shifted(length, 1)) / 2
    distance = norm(error)
    squares = (error * error + error * after + after * after).sum(axis=1) / 3
    return Misfit(
        rms=float(np.sqrt(length @ squares / length.sum())),
        max=float(distance.max()),
        max_per_local_edge=float((distance / local_edge).max()),
        length=curve.length(),
    )


def polygon_through(vertices: Complex[np.ndarray, " n"]) -> SplineBoundary:
    """The closed polygon through vertices, which are not marked as corners because p and q are regular there."""
    step = shifted(vertices, -1) - vertices
    if not step.all():
        raise DomainError("two neighbouring points of the flattened disk's boundary coincide", vertices=len(vertices))
    along = np.append(0.0, np.cumsum(np.abs(step)) / np.abs(step).sum())
    along[-1] = 1.0
    return SplineBoundary(along, np.stack([step / np.diff(along), vertices]), np.zeros(len(vertices), dtype=bool))
