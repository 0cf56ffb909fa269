"""Films whose edges are cables: minima of the area plus the sum of tension times length.

The unknowns are the control points of the cables. The gradient of the area is ∮ ν·δΓ ds over the exact film, its second
derivative that of `area_hessian`. At the minimum a cable of tension T has the curvature vector ν/T, with the conormal ν
of the film that points outwards: the curvature is 1/T, in the tangent plane of the film.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import cho_factor, cho_solve, eigh

from spinor_geom.errors import LoopError, OutOfTimeError, SurfaceError, require_positive, require_type
from spinor_geom.gradients.area_hessian import boundary_form, rim_terms
from spinor_geom.gradients.rim_nodes import RimNodes
from spinor_geom.membrane.cables import Cable, CableEdge, Edge, LengthTerms, Stay
from spinor_geom.membrane.frame import Frame
from spinor_geom.membrane.frame_file import edges_of_arguments
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.plateau.options import Model
from spinor_geom.plateau.route_result import FAILURES
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau
from spinor_geom.shown import shortened

_XYZ = np.arange(3)
_MOST_STEPS = 12
_STIFF = 20.0
_LEAST = 1e-9  # eigenvalue, relative to the largest one
# Relative to the size: a predicted next step below the first ends the search. Steps below the second that do
# not decrease end it too, because they have the size of the film's error. Longer ones than the third are shortened.
_FINAL, _NOISE, _LONGEST = 1e-7, 1e-5, 0.15
_ROUGH, _ROUGHLY = 1e-4, 1e-3  # expected step above which the film is computed with the second tolerance
# Parts of each piece of ∂Ω for the finite elements of the second derivative. With 1 a step leaves up to a tenth of the
# distance to the minimum, with 3 a hundredth.
_FINER = 3
_BALANCED = 1e-9  # largest force that is left at a free node or ring, relative to tensions and size


@dataclass(frozen=True, kw_only=True, eq=False)
class CableShape:
    """A cable in equilibrium.

    Attributes:
        cable: as given, in the direction in which the frame is passed.
        tension: given, or that of the cable of given length.
        length: in mesh units.
        control: control points of `CableEdge`.
    """

    cable: Cable
    tension: float
    length: float
    control: Float[np.ndarray, "k 3"]

    def __repr__(self) -> str:
        return f"CableShape(tension {self.tension:.6g}, length {self.length:.6g})"

    def point(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Points of the cable, 0 ≤ x ≤ 1 from start to end."""
        return np.asarray(CableEdge(self.cable).shapes(x) @ self.control)

    def curvature(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Curvature vectors. Their length is 1/tension in equilibrium."""
        edge = CableEdge(self.cable)
        first, second = edge.shapes(x, 1) @ self.control, edge.shapes(x, 2) @ self.control
        square = (first * first).sum(axis=1, keepdims=True)
        return np.asarray((second - (second * first).sum(axis=1, keepdims=True) / square * first) / square)


@dataclass(frozen=True, kw_only=True, eq=False)
class Membrane:
    """A film with cables at its edges, in equilibrium.

    Attributes:
        film: the film.
        cables: the cables and stays in the order of the arguments, each with its reflections.
        supports: the corners of the frame, where edges meet, and other ends of stays.
        is_free: which of them are free, because a stay starts there.
        forces: of the supports on the corners, in units of the surface tension times mesh units, or 0 if free.
        edge_forces: of fixed edges and rings on the film, by edge in the order of the arguments, each with its
            reflections, or 0 for cables.
        edge_names: of these edges: the number of the argument, such as "4", and for its reflections "4.1" and so on.
        heights: displacements of the rings along the z axis.
        steps: sizes of the steps of Newton's method, in mesh units.
    """

    film: PlateauSolution
    cables: tuple[CableShape, ...]
    supports: Float[np.ndarray, "n 3"]
    is_free: Bool[np.ndarray, " n"]
    forces: Float[np.ndarray, "n 3"]
    edge_forces: Float[np.ndarray, "e 3"]
    edge_names: tuple[str, ...]
    heights: Float[np.ndarray, " r"]
    steps: tuple[float, ...]

    def __repr__(self) -> str:
        return shortened(f"Membrane({len(self.cables)} cables, area {self.film.area:.6g}, {self.film.route!r})")

    @property
    def energy(self) -> float:
        """Area plus the sum of tension times length."""
        return self.film.area + sum(one.tension * one.length for one in self.cables)

    @property
    def total_force(self) -> Float[np.ndarray, "3"]:
        """Sum of all forces of supports, fixed edges and rings: 0 in equilibrium."""
        return np.asarray(self.forces.sum(axis=0) + self.edge_forces.sum(axis=0))


def solve_membrane(
    edges: Sequence[Edge],
    *,
    tolerance: float = 1e-4,
    time_limit: float = 60.0,
) -> Membrane:
    """A film of surface tension 1 inside a closed frame of cables and fixed edges, and between rings.

    Args:
        edges: in any order and direction: cables; fixed edges, which are `OpenCurve`s without corners or (m, 3) points,
            two of them for a straight line; stays; rings; up to three mutually orthogonal planes of symmetry, in which
            the others are reflected; and shapes of build123d, CadQuery or OCP, whose labels are their kinds as in STEP
            files.
        tolerance: of the film, as for `solve_plateau`. Its boundary is usually nearer by orders of magnitude.
        time_limit: seconds in all. A film in progress may exceed it.

    Returns:
        The film and the cables at a minimum of area + Σ tension · length − Σ force · height.

    Raises:
        OptionError: the edges do not form a closed frame, or there are less than two.
        SurfaceError: there is no equilibrium near: the film collapses because tensions are too small or cables too
            long, no film connects the rings, or Newton's method does not converge.
        OutOfTimeError: the time limit.
        MeshExtentError: the frame is too large or too small for floating-point numbers.
        SpinorGeomError: the errors of `solve_plateau`.
    """
    require_type(edges, Iterable, function="solve_membrane", takes="a sequence of edges")
    require_positive("tolerance", tolerance)
    require_positive("time_limit", time_limit, finite=False)
    frame, begin = Frame.of(edges_of_arguments(edges)), perf_counter()
    control, tensions = frame.start, np.array([one.first_tension for one in frame.cables], dtype=np.float64)
    while len(frame.crossed(frame.straight, control)):
        control = (control + frame.straight) / 2
    steps: list[float] = []
    is_narrow, is_stable = False, True
    while True:
        left = time_limit - (perf_counter() - begin)
        if left <= 0:
            raise OutOfTimeError
        expected = _next_step(steps) / frame.size
        is_rough = expected > _ROUGH and len(frame.unknowns) > 0
        film = _film(frame, control, max(tolerance, _ROUGHLY) if is_rough else tolerance, left)
        state = _State(frame=frame, control=control, film=film)
        is_done = _has_stalled(steps, frame.size) or (expected <= _FINAL and state.is_balanced(tensions))
        if is_done or not len(frame.unknowns) or len(steps) == _MOST_STEPS:
            break
        step, changes, is_stable = state.step(tensions)
        share = min(1.0, _LONGEST * frame.size / max(float(np.abs(step).max()), np.finfo(float).tiny))
        crossed = frame.crossed(control, control + share * step)
        if len(crossed) and (is_narrow or len(frame.crossed(control, control + share / 2 * step))):
            raise SurfaceError(_collapsed(frame, f"its edges would cross at {frame.nodes[crossed[0]].tolist()}"))
        is_narrow = len(crossed) > 0
        share = share / 2 if is_narrow else share
        control, tensions = control + share * step, tensions + share * changes
        steps.append(share * float(np.linalg.norm(step, axis=1).max()))
        if (tensions <= 0).any():
            raise SurfaceError(_collapsed(frame, "a cable would have to push"))
    if steps and not is_stable:
        raise SurfaceError(_collapsed(frame, "the film is unstable"))
    if steps and not is_done:
        raise SurfaceError(_collapsed(frame, f"Newton's method did not converge in {len(steps)} steps"))
    return state.membrane(tensions, tuple(steps))


def _next_step(steps: list[float]) -> float:
    """The size of the next step, predicted from the last two. At first it is that of the last one."""
    return steps[-1] ** 2 / max(*steps[-2:], np.finfo(float).tiny) if steps else np.inf


def _has_stalled(steps: list[float], size: float) -> bool:
    """Whether steps have the size of the film's error."""
    return len(steps) > 1 and 0.3 * steps[-2] < steps[-1] <= _NOISE * size


def _collapsed(frame: Frame, why: str) -> str:
    """The sentence that no equilibrium was found."""
    cables = [one.cable for one in frame.cables if not isinstance(one.cable, Stay)]
    ratios = [one.tension / one.chord for one in cables if one.tension is not None]
    advice = "give shorter cables" if cables else "move the rings together"
    if ratios:
        advice = f"raise the tensions, of which the smallest is {min(ratios):.3g} of the distance of its ends"
        advice += ", or give shorter cables" * (len(ratios) < len(cables))
    return f"no equilibrium of the film was found: {why}; {advice}"


def _film(frame: Frame, control: Float[np.ndarray, "c 3"], tolerance: float, time_limit: float) -> PlateauSolution:
    """The film inside the frame for control points of the cables."""
    curves = frame.curves(control)
    # between two rims the other routes resolve corners less well, and take longer
    model: Model = "cauchy" if frame.edges and len(curves) == 2 else "auto"
    try:
        film = solve_plateau(
            curves if frame.rings else curves[0], model=model, tolerance=tolerance, time_limit=time_limit
        )
    except (LoopError, *FAILURES) as error:
        if isinstance(error, LoopError) and not frame.cables:
            raise  # given edges cross each other
        raise SurfaceError(_collapsed(frame, f"its edges do not bound a film ({error})")) from error
    if not isinstance(film, PlateauSolution):
        raise SurfaceError(_collapsed(frame, film.reason))
    return film


@dataclass(frozen=True, kw_only=True, eq=False)
class _Piece:
    """Nodes on a rim of the film that move with some control points: shape functions B there and their derivatives."""

    at: Int[np.ndarray, " c"]  # the control points
    here: Int[np.ndarray, " n"]  # the nodes
    values: Float[np.ndarray, "n c"]
    slopes: Float[np.ndarray, "n c"]  # by the parameter of Γ


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    """A film over cables, with the derivatives of area and lengths in the control points."""

    frame: Frame
    control: Float[np.ndarray, "c 3"]
    film: PlateauSolution

    @cached_property
    def nodes(self) -> list[RimNodes]:
        """Quadrature nodes on each rim."""
        return RimNodes.all_of(self.film)

    @cached_property
    def owners(self) -> list[tuple[int, bool]]:
        """The curve of the frame on which each rim lies, and whether the rim has the opposite direction."""
        found, curves, s = [], self.frame.curves(self.control), np.array([0.1])
        for rim in self.film.rims:
            gaps = [
                np.linalg.norm(one - rim.loop.points[0], axis=1).min() for one in curves if isinstance(one, np.ndarray)
            ]
            own = int(np.argmin([*gaps, 1e-9 * self.frame.size]))
            curve = curves[own]
            away = curve.point(s) - rim.curve.point(s) if isinstance(curve, ClosedCurve) else np.zeros(3)
            found.append((own, bool(np.linalg.norm(away) > 1e-6 * self.frame.size)))
        return found

    def edges_at(self, rim: int, s: Float[np.ndarray, " k"]) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """The edges of parameters on a rim, and the parameters on them. Rings come after the edges."""
        own, back = self.owners[rim]
        if own < len(self.frame.rings):
            return np.full(len(s), len(self.frame.edges) + own), s
        edge, x = self.frame.places(-s if back else s)
        return edge, x

    def pieces(self, rim: int, s: Float[np.ndarray, " k"]) -> Iterator[_Piece]:
        """The pieces of a rim that move."""
        frame = self.frame
        edge, x = self.edges_at(rim, s)
        for k in np.unique(edge).tolist():
            here = np.flatnonzero(edge == k)
            if k >= len(frame.edges):
                at, ones = frame.ring_controls[[k - len(frame.edges)]], np.ones((len(here), 1))
                yield _Piece(at=at, here=here, values=ones, slopes=0 * ones)
            elif k in frame.cable_numbers:
                number = frame.cable_numbers[k]
                cable, rate = frame.cables[number], (-1) ** self.owners[rim][1] / np.diff(frame.starts)[k]
                values, slopes = (cable.shapes(x[here], order) for order in (0, 1))
                yield _Piece(at=frame.controls[number], here=here, values=values, slopes=slopes * rate)

    @cached_property
    def by_area(self) -> Float[np.ndarray, "c 3"]:
        """The gradient of the area."""
        gradient = np.zeros_like(self.control)
        for number, nodes in enumerate(self.nodes):
            for piece in self.pieces(number, nodes.places):
                gradient[piece.at] += piece.values.T @ nodes.conormal[piece.here]
        return gradient

    @cached_property
    def lengths(self) -> list[LengthTerms]:
        """`length_terms` of each cable."""
        frame = self.frame
        return [one.length_terms(self.control[at]) for one, at in zip(frame.cables, frame.controls, strict=True)]

    @property
    def by_area_twice(self) -> Float[np.ndarray, "c 3 c 3"]:
        """The second derivative of the area."""
        film, count = self.film, self.frame.count
        domain, form, jacobi = film.domain.divided(_FINER), np.zeros((count, 3, count, 3)), []
        for number, (rim, nodes, boundary) in enumerate(zip(film.rims, self.nodes, domain.boundaries, strict=True)):
            _, turned, bent = rim_terms(film, nodes)
            speed = np.linalg.norm(rim.curve.derivative(nodes.places), axis=1)[:, None]
            for piece in self.pieces(number, nodes.places):
                at, size = piece.at, len(piece.at)
                for one, matrix in ((piece.slopes / speed[piece.here], turned), (piece.values, bent)):
                    pairs = np.einsum("kj,kab->kajb", piece.values, matrix[piece.here]).reshape(len(one), -1)
                    form[np.ix_(at, _XYZ, at, _XYZ)] += (one.T @ pairs).reshape(size, 3, size, 3)
            normals = film.array_surface.normal(boundary.vertices)
            normals = np.where(np.isfinite(normals), normals, 0)
            u = np.zeros((len(normals), count, 3))
            for piece in self.pieces(number, rim.places(boundary.parameters[:-1])):
                u[np.ix_(piece.here, piece.at)] = piece.values[:, :, None] * normals[piece.here, None]
            jacobi.append(u.reshape(len(u), -1))
        form += boundary_form(film.array_surface, domain.triangulation, np.concatenate(jacobi)).reshape(form.shape)
        return np.asarray((form + form.transpose(2, 3, 0, 1)) / 2)

    def gradient(self, tensions: Float[np.ndarray, " t"]) -> Float[np.ndarray, "c 3"]:
        """The gradient of the energy."""
        frame, gradient = self.frame, np.array(self.by_area)
        for at, tension, (_, by_length, _, _) in zip(frame.controls, tensions.tolist(), self.lengths, strict=True):
            gradient[at] += tension * by_length
        gradient[frame.ring_controls, 2] -= [ring.force or 0.0 for ring in frame.rings]
        return gradient

    def is_balanced(self, tensions: Float[np.ndarray, " t"]) -> bool:
        """Whether the forces at free nodes and rings balance."""
        frame, unknowns = self.frame, self.frame.unknowns
        is_point = np.isin(unknowns // 3, [*range(len(frame.nodes)), *frame.ring_controls.tolist()])
        left = np.abs(self.gradient(tensions).ravel()[unknowns[is_point]])
        return bool(left.max(initial=0.0) <= _BALANCED * max([frame.size, *tensions.tolist()]))

    def step(self, tensions: Float[np.ndarray, " t"]) -> tuple[Float[np.ndarray, "c 3"], Float[np.ndarray, " t"], bool]:
        """Newton's step of control points and of tensions of cables of given length, and whether the film is stable."""
        frame, unknowns = self.frame, self.frame.unknowns
        matrix, gradient = self.by_area_twice, self.gradient(tensions).ravel()[unknowns]
        rows, misses = [], []
        for number, (own, tension) in enumerate(zip(frame.cables, tensions.tolist(), strict=True)):
            at, (length, by_length, twice, along) = frame.controls[number], self.lengths[number]
            # area and length do not depend on displacements along the cable, which are kept small
            matrix[np.ix_(at, _XYZ, at, _XYZ)] += tension * (twice + along)
            if own.cable.length is not None:
                row = np.zeros_like(self.control)
                row[at] = by_length
                rows.append(row.ravel()[unknowns])
                misses.append(length - own.cable.length)
                # a multiple of the constraint, which does not change the step, makes the matrix positive
                matrix += _STIFF * tension / length * row[:, :, None, None] * row
                gradient += _STIFF * tension / length * misses[-1] * rows[-1]
        size = matrix.shape[0] * 3
        values, vectors = eigh(matrix.reshape(size, size)[np.ix_(unknowns, unknowns)])
        # away from a minimum, absolute values make the step a descent
        factor = cho_factor((vectors * np.maximum(np.abs(values), _LEAST * values[-1])) @ vectors.T)
        move, changes = -cho_solve(factor, gradient), np.zeros(len(tensions))
        if rows:
            constraint = np.stack(rows)
            by_tension = cho_solve(factor, constraint.T)
            more = np.linalg.solve(constraint @ by_tension, misses + constraint @ move)
            move -= by_tension @ more
            changes[[k for k, one in enumerate(frame.cables) if one.cable.length is not None]] = more
        step = np.zeros(size)
        step[unknowns] = move
        return step.reshape(-1, 3), changes, bool(values[0] > 0)

    def membrane(self, tensions: Float[np.ndarray, " t"], steps: tuple[float, ...]) -> Membrane:
        """The result."""
        frame = self.frame
        shapes = [
            CableShape(cable=own.cable, tension=tension, length=length, control=self.control[at])
            for own, tension, (length, _, _, _), at in zip(
                frame.cables, tensions.tolist(), self.lengths, frame.controls, strict=True
            )
        ]
        held = np.zeros((len(frame.edges) + len(frame.stays) + len(frame.rings), 3))
        for number, nodes in enumerate(self.nodes):
            edge, _ = self.edges_at(number, nodes.places)
            np.add.at(held, np.where(edge < len(frame.edges), edge, edge + len(frame.stays)), nodes.conormal)
        held[list(frame.cable_numbers)] = 0
        order = np.argsort(frame.numbers, kind="stable")
        numbers = np.array(frame.numbers)[order]
        copies = np.arange(len(numbers)) - np.searchsorted(numbers, numbers)
        return Membrane(
            film=self.film,
            cables=tuple(shapes[k] for k in np.argsort(frame.cable_given, kind="stable").tolist()),
            supports=self.control[: len(frame.nodes)],
            is_free=frame.is_free,
            forces=self.gradient(tensions)[: len(frame.nodes)],
            edge_forces=held[order],
            edge_names=tuple(
                f"{number}.{copy}" if copy else f"{number}" for number, copy in zip(numbers, copies, strict=True)
            ),
            heights=self.control[frame.ring_controls, 2],
            steps=steps,
        )
