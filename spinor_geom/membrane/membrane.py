"""Films whose edges are cables: minima of the area plus the sum of tension times length.

The unknowns are the control points of the cables. The gradient of the area is ∮ ν·δΓ ds over the exact film, its second
derivative that of `area_hessian`. At the minimum a cable of tension T has the curvature vector ν/T, with the conormal ν
of the film that points outwards: the curvature is 1/T, in the tangent plane of the film.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from spinor_geom.errors import LoopError, OptionError, OutOfTimeError, SurfaceError, require_positive
from spinor_geom.gradients.area_hessian import boundary_form, rim_terms
from spinor_geom.gradients.rim_nodes import RimNodes
from spinor_geom.membrane.cables import DEGREE, Cable, CableEdge, FixedEdge
from spinor_geom.mesh.curve import ClosedCurve
from spinor_geom.mesh.open_curve import OpenCurve
from spinor_geom.plateau.route_result import FAILURES
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau
from spinor_geom.shown import shortened

_XYZ = np.arange(3)
_MEETING = 1e-9  # distance of ends that are one point, relative to the size
_MOST_STEPS = 12
_STIFF = 20.0
# Relative to the size: the error after a step below the first is far smaller; below the second, steps that no longer
# decrease have the size of the film's error; longer ones than the third are shortened.
_FINAL, _NOISE, _LONGEST = 3e-6, 1e-5, 0.15


@dataclass(frozen=True, kw_only=True, eq=False)
class CableShape:
    """A cable in equilibrium.

    Attributes:
        cable: as given.
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
        """Curvature vectors; their length is 1/tension in equilibrium."""
        edge = CableEdge(self.cable)
        first, second = edge.shapes(x, 1) @ self.control, edge.shapes(x, 2) @ self.control
        square = (first * first).sum(axis=1, keepdims=True)
        return np.asarray((second - (second * first).sum(axis=1, keepdims=True) / square * first) / square)


@dataclass(frozen=True, kw_only=True, eq=False)
class Membrane:
    """A film with cables at its edges, in equilibrium.

    Attributes:
        film: the film.
        cables: the cables, in the order of the edges.
        supports: the corners of the frame, where edges meet.
        forces: of the supports on the corners, in units of the surface tension times mesh units.
        edge_forces: of fixed edges on the film, by edge; 0 for cables.
        steps: sizes of the steps of Newton's method, in mesh units.
    """

    film: PlateauSolution
    cables: tuple[CableShape, ...]
    supports: Float[np.ndarray, "n 3"]
    forces: Float[np.ndarray, "n 3"]
    edge_forces: Float[np.ndarray, "n 3"]
    steps: tuple[float, ...]

    def __repr__(self) -> str:
        return shortened(f"Membrane({len(self.cables)} cables, area {self.film.area:.6g}, {self.film.route!r})")

    @property
    def energy(self) -> float:
        """Area plus the sum of tension times length."""
        return self.film.area + sum(one.tension * one.length for one in self.cables)

    @property
    def total_force(self) -> Float[np.ndarray, "3"]:
        """Sum of all forces of supports and fixed edges: 0 in equilibrium."""
        return np.asarray(self.forces.sum(axis=0) + self.edge_forces.sum(axis=0))


def solve_membrane(
    edges: Sequence[Cable | OpenCurve | ArrayLike],
    *,
    tolerance: float = 1e-4,
    time_limit: float = 60.0,
) -> Membrane:
    """A film of surface tension 1 inside a closed frame of cables and fixed edges.

    Args:
        edges: in order around the frame, each from the end of the one before: cables, and fixed edges, which are
            `OpenCurve`s without corners or (m, 3) points; two points are a straight line.
        tolerance: of the film, as for `solve_plateau`; its boundary is usually nearer by orders of magnitude.
        time_limit: seconds in all; a film in progress may exceed it.

    Returns:
        The film and the cables at a minimum of area + Σ tension · length.

    Raises:
        OptionError: the edges do not form a closed frame, or there is no cable.
        SurfaceError: there is no equilibrium near: the film collapses because tensions are too small or cables too
            long, or Newton's method does not converge.
        OutOfTimeError: the time limit, which also weak tensions reach.
        SpinorGeomError: the errors of `solve_plateau`.
    """
    require_positive("tolerance", tolerance)
    require_positive("time_limit", time_limit, finite=False)
    frame, begin = _Frame.of(edges), perf_counter()
    if frame.turns >= np.pi * (len(frame.edges) - 2):
        raise SurfaceError(_collapsed(frame, "its cables would turn by more than its corners leave room for"))
    control = frame.start
    tensions = np.array([one.tension or 0.0 for one in frame.cables])
    steps: list[float] = []
    while True:
        left = time_limit - (perf_counter() - begin)
        if left <= 0:
            raise OutOfTimeError
        film = frame.film(control, tolerance, left)
        state = _State(frame=frame, control=control, film=film)
        if not steps and len(frame.given):
            tensions = state.first_tensions(tensions)
        if (steps and _has_converged(steps, frame.size)) or len(steps) == _MOST_STEPS:
            break
        step, changes = state.step(tensions)
        longest = float(np.abs(step).max())
        share = min(1.0, _LONGEST * frame.size / max(longest, np.finfo(float).tiny))
        control, tensions = control + share * frame.moves(step), tensions + share * changes
        steps.append(share * float(np.linalg.norm(frame.moves(step), axis=1).max()))
        if (tensions <= 0).any():
            raise SurfaceError(_collapsed(frame, "a cable would have to push"))
    if not _has_converged(steps, frame.size):
        raise SurfaceError(_collapsed(frame, f"Newton's method did not converge in {len(steps)} steps"))
    return state.membrane(tensions, tuple(steps))


def _has_converged(steps: list[float], size: float) -> bool:
    return steps[-1] <= _FINAL * size or (len(steps) > 1 and 0.3 * steps[-2] < steps[-1] <= _NOISE * size)


def _collapsed(frame: _Frame, why: str) -> str:
    """The sentence that no equilibrium was found."""
    chords = [float(np.linalg.norm(np.subtract(one.end, one.start))) for one in frame.cables]
    ratios = [(one.tension or 0.0) / chord for one, chord in zip(frame.cables, chords, strict=True) if one.tension]
    advice = "give shorter cables"
    if ratios:
        advice = f"raise the tensions, of which the smallest is {min(ratios):.3g} of the distance of its ends"
    return f"no equilibrium of the film was found: {why}; {advice}"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Frame:
    """The edges of a membrane: control points 0 … n − 1 are the corners, then come those of each cable."""

    edges: tuple[CableEdge | FixedEdge, ...]
    corners: Float[np.ndarray, "n 3"]
    size: float

    @classmethod
    def of(cls, given: Sequence[Cable | OpenCurve | ArrayLike]) -> _Frame:
        edges: list[CableEdge | FixedEdge] = []
        ends = []
        for number, one in enumerate(given):
            if isinstance(one, Cable):
                edges.append(CableEdge(one))
                ends.append([one.start, one.end])
                continue
            curve = one if isinstance(one, OpenCurve) else OpenCurve(np.asarray(one), corners=())
            if curve.is_corner.any():
                raise OptionError(f"fixed edge {number} has corners; divide it there into several edges")
            edges.append(FixedEdge(curve))
            ends.append(curve.points[[0, -1]].tolist())
        if len(edges) < 2 or not any(isinstance(edge, CableEdge) for edge in edges):
            raise OptionError("a membrane needs two edges or more, at least one of them a cable")
        places = np.asarray(ends, dtype=np.float64)
        size = float(np.linalg.norm(np.ptp(places.reshape(-1, 3), axis=0)))
        gaps = np.linalg.norm(places[:, 1] - np.roll(places[:, 0], -1, axis=0), axis=1)
        if gaps.max() > _MEETING * size:
            at = int(gaps.argmax())
            raise OptionError(
                f"edge {at} ends {gaps[at]:.3g} away from the start of edge {(at + 1) % len(edges)}; join them"
            )
        return cls(edges=tuple(edges), corners=places[:, 0], size=size)

    @cached_property
    def cable_numbers(self) -> list[int]:
        """The edges that are cables."""
        return [k for k, edge in enumerate(self.edges) if isinstance(edge, CableEdge)]

    @cached_property
    def cables(self) -> list[Cable]:
        """The cables."""
        return [edge.cable for edge in self.edges if isinstance(edge, CableEdge)]

    @cached_property
    def given(self) -> list[int]:
        """Which cables have a given length."""
        return [k for k, cable in enumerate(self.cables) if cable.length is not None]

    @property
    def turns(self) -> float:
        """A lower bound of the total turn of the cables less that of the fixed edges.

        By the theorem of Gauss and Bonnet, where the Gauss curvature of a film is not positive, its angles at n corners
        are 0 if this is π (n − 2), and negative beyond.
        """
        ends = np.linalg.norm(np.roll(self.corners, -1, axis=0) - self.corners, axis=1)
        return sum(
            -own.total_curvature if isinstance(own, FixedEdge) else chord / (own.cable.tension or np.inf)
            for own, chord in zip(self.edges, ends.tolist(), strict=True)
        )

    def controls(self, number: int) -> Int[np.ndarray, " k"]:
        """The control points of a cable."""
        edge, n = self.cable_numbers[number], len(self.edges)
        own = n + number * (DEGREE - 1) + np.arange(DEGREE - 1)
        return np.array([edge, (edge + 1) % n, *own])

    @property
    def count(self) -> int:
        """Number of control points."""
        return len(self.edges) + len(self.cables) * (DEGREE - 1)

    @property
    def start(self) -> Float[np.ndarray, "c 3"]:
        """Control points of parabolas towards the middle of the frame with straight cables."""
        control, x = np.zeros((self.count, 3)), (np.arange(9) + 0.5)[:, None] / 9
        ends = np.roll(self.corners, -1, axis=0)
        middles = [
            (own.point(x[:, 0]) if isinstance(own, FixedEdge) else (1 - x) * a + x * b).mean(axis=0)
            for own, a, b in zip(self.edges, self.corners, ends, strict=True)
        ]
        for number, edge in enumerate(self.cable_numbers):
            cable = self.edges[edge]
            assert isinstance(cable, CableEdge)
            control[self.controls(number)] = cable.start(np.mean(middles, axis=0), self.size)
        control[: len(self.edges)] = self.corners
        return control

    def moves(self, step: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "c 3"]:
        """Displacements of all control points, from those that are not corners."""
        return np.concatenate([np.zeros((len(self.edges), 3)), step])

    @cached_property
    def starts(self) -> Float[np.ndarray, " n1"]:
        """Parameters of Γ at the corners, in proportion to the chords of the edges."""
        chords = np.linalg.norm(np.roll(self.corners, -1, axis=0) - self.corners, axis=1)
        return np.asarray(np.append(0.0, np.cumsum(chords + 0.1 * self.size)) / (chords + 0.1 * self.size).sum())

    def places(self, s: Float[np.ndarray, "*n"]) -> tuple[Int[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """The edges of parameters of Γ, and the parameters on them."""
        s = np.mod(s, 1.0)
        edge = np.searchsorted(self.starts[1:-1], s, side="right")
        return edge, (s - self.starts[edge]) / np.diff(self.starts)[edge]

    def film(self, control: Float[np.ndarray, "c 3"], tolerance: float, time_limit: float) -> PlateauSolution:
        """The film inside the frame for control points of the cables."""
        numbers = {edge: number for number, edge in enumerate(self.cable_numbers)}
        widths = np.diff(self.starts)

        def derivative(order: int, s: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
            edge, x = self.places(np.asarray(s))
            values = np.empty((*np.shape(s), 3))
            for k, own in enumerate(self.edges):
                here = edge == k
                if isinstance(own, CableEdge):
                    at = own.shapes(x[here], order) @ control[self.controls(numbers[k])]
                else:
                    at = own.point(x[here], order)
                values[here] = at / widths[k] ** order
            return values

        joints = [
            self.starts[k] + widths[k] * own.knots[1:-1]
            for k, own in enumerate(self.edges)
            if isinstance(own, FixedEdge)
        ]
        curve = ClosedCurve(
            point=lambda s: derivative(0, s),
            derivative=lambda s: derivative(1, s),
            second_derivative=lambda s: derivative(2, s),
            corners=tuple(self.starts[:-1].tolist()),
            joints=tuple(np.concatenate(joints).tolist()) if joints else (),
        )
        try:
            film = solve_plateau(curve, tolerance=tolerance, time_limit=time_limit)
        except (LoopError, *FAILURES) as error:
            raise SurfaceError(_collapsed(self, f"its edges do not bound a film ({error})")) from error
        assert isinstance(film, PlateauSolution)
        return film


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    """A film over cables, with the derivatives of area and lengths in the control points."""

    frame: _Frame
    control: Float[np.ndarray, "c 3"]
    film: PlateauSolution

    @cached_property
    def nodes(self) -> RimNodes:
        (nodes,) = RimNodes.all_of(self.film)
        return nodes

    def shapes(self, s: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k c"]:
        """The shape functions of all control points at parameters of Γ; 0 on fixed edges."""
        edge, x = self.frame.places(s)
        values = np.zeros((len(s), self.frame.count))
        for number, own in enumerate(self.frame.cable_numbers):
            here = np.flatnonzero(edge == own)
            cable = self.frame.edges[own]
            assert isinstance(cable, CableEdge)
            values[np.ix_(here, self.frame.controls(number))] = cable.shapes(x[here])
        return values

    @cached_property
    def by_area(self) -> Float[np.ndarray, "c 3"]:
        """The gradient of the area."""
        return np.asarray(self.shapes(self.nodes.places).T @ self.nodes.conormal)

    @cached_property
    def lengths(
        self,
    ) -> list[tuple[float, Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3 k 3"], Float[np.ndarray, "k 3 k 3"]]]:
        frame, found = self.frame, []
        for number, own in enumerate(frame.cable_numbers):
            cable = frame.edges[own]
            assert isinstance(cable, CableEdge)
            found.append(cable.length_terms(self.control[frame.controls(number)]))
        return found

    def first_tensions(self, tensions: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Tensions of cables of given lengths that balance the film best on the average."""
        tensions = tensions.copy()
        for number in self.frame.given:
            by_length, by_area = self.lengths[number][1][2:], self.by_area[self.frame.controls(number)[2:]]
            tensions[number] = max(-(by_length * by_area).sum() / (by_length**2).sum(), 0.1 * self.frame.size)
        return tensions

    @property
    def by_area_twice(self) -> Float[np.ndarray, "c 3 c 3"]:
        """The second derivative of the area."""
        film, nodes, frame = self.film, self.nodes, self.frame
        form = np.zeros((frame.count, 3, frame.count, 3))
        _, turned, bent = rim_terms(film, nodes)
        edge, x = frame.places(nodes.places)
        by_x = np.diff(frame.starts)[edge] * np.linalg.norm(film.curve.derivative(nodes.places), axis=1)
        for number, own in enumerate(frame.cable_numbers):
            here, at, cable = edge == own, frame.controls(number), frame.edges[own]
            assert isinstance(cable, CableEdge)
            values, slopes = cable.shapes(x[here]), cable.shapes(x[here], 1) / by_x[here, None]
            count = len(at)
            for one, matrix in ((slopes, turned), (values, bent)):
                pairs = np.einsum("kj,kab->kajb", values, matrix[here]).reshape(len(values), -1)
                form[np.ix_(at, _XYZ, at, _XYZ)] += (one.T @ pairs).reshape(count, 3, count, 3)
        (rim,) = film.rims
        t, s = np.concatenate([rim.matching - 1, rim.matching, rim.matching + 1]).T
        at = np.interp(rim.boundary.parameters[:-1], t, s)
        normals = film.array_surface.normal(rim.boundary.vertices)
        u = (self.shapes(at)[:, :, None] * np.where(np.isfinite(normals), normals, 0)[:, None]).reshape(len(at), -1)
        form += boundary_form(film, u).reshape(form.shape)
        return np.asarray((form + form.transpose(2, 3, 0, 1)) / 2)

    def step(self, tensions: Float[np.ndarray, " t"]) -> tuple[Float[np.ndarray, "f 3"], Float[np.ndarray, " t"]]:
        """Newton's step of the control points and of the tensions of cables of given length."""
        frame, n = self.frame, len(self.frame.edges)
        second, gradient = self.by_area_twice, self.by_area.copy()
        sliding = np.zeros_like(second)
        rows = []
        for number, tension in enumerate(tensions.tolist()):
            at = frame.controls(number)
            length, by_length, twice, along = self.lengths[number]
            gradient[at] += tension * by_length
            second[np.ix_(at, _XYZ, at, _XYZ)] += tension * twice
            # area and length do not depend on displacements along the cable, which are kept small
            sliding[np.ix_(at, _XYZ, at, _XYZ)] += tension * along
            if number in frame.given:
                row = np.zeros((frame.count, 3))
                row[at] = by_length
                excess = length - (frame.cables[number].length or 0.0)
                # a multiple of the constraint, which does not change the step, makes the matrix positive
                second += _STIFF * tension / length * row[:, :, None, None] * row
                gradient += _STIFF * tension / length * excess * row
                rows.append((row[n:].ravel(), excess))
        size = 3 * (frame.count - n)
        matrix = (second + sliding)[n:, :, n:].reshape(size, size)
        try:
            factor = cho_factor(matrix)
        except LinAlgError as error:
            raise SurfaceError(_collapsed(frame, "the film is unstable")) from error
        move, changes = -cho_solve(factor, gradient[n:].ravel()), np.zeros(len(tensions))
        if rows:
            constraint, misses = np.stack([row for row, _ in rows]), np.array([one for _, one in rows])
            by_tension = cho_solve(factor, constraint.T)
            more = np.linalg.solve(constraint @ by_tension, misses + constraint @ move)
            move, changes[frame.given] = move - by_tension @ more, more
        return move.reshape(-1, 3), changes

    def membrane(self, tensions: Float[np.ndarray, " t"], steps: tuple[float, ...]) -> Membrane:
        """The result."""
        frame, n = self.frame, len(self.frame.edges)
        gradient = self.by_area.copy()
        shapes = []
        for number, tension in enumerate(tensions.tolist()):
            at, (length, by_length, _, _) = frame.controls(number), self.lengths[number]
            gradient[at] += tension * by_length
            shapes.append(
                CableShape(cable=frame.cables[number], tension=tension, length=length, control=self.control[at])
            )
        edge = frame.places(self.nodes.places)[0]
        fixed = [
            self.nodes.conormal[edge == k].sum(axis=0) if isinstance(own, FixedEdge) else np.zeros(3)
            for k, own in enumerate(frame.edges)
        ]
        return Membrane(
            film=self.film,
            cables=tuple(shapes),
            supports=frame.corners,
            forces=gradient[:n],
            edge_forces=np.array(fixed),
            steps=steps,
        )
