"""Films whose edges are cables: minima of the area plus the sum of tension times length.

The unknowns are the control points of the cables. The gradient of the area is ∮ ν·δΓ ds over the exact film, its second
derivative that of `area_hessian`. At the minimum a cable of tension T has the curvature vector ν/T, with the conormal ν
of the film that points outwards: the curvature is 1/T, in the tangent plane of the film.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import eigh

from spinor_geom import deadline
from spinor_geom.errors import LoopError, SurfaceError, require_positive, require_type
from spinor_geom.gradients.area_hessian import boundary_form, rim_terms
from spinor_geom.gradients.rim_nodes import RimNodes
from spinor_geom.membrane.cables import Cable, Edge
from spinor_geom.membrane.frame import Frame, LengthTerms, cable_shapes, half_turn
from spinor_geom.membrane.frame_file import edges_of_arguments
from spinor_geom.plateau.options import Model
from spinor_geom.plateau.route_result import FAILURES
from spinor_geom.plateau.solution import PlateauSolution
from spinor_geom.plateau.solve import solve_plateau
from spinor_geom.shown import shortened

_XYZ = np.arange(3)
_MOST_STEPS = 12
_STIFF = 20.0
_LEAST = 1e-9  # eigenvalue, relative to the largest one
# Relative to the size: steps below the first end the search, longer ones than the second are shortened.
_FINAL, _LONGEST = 1e-9, 0.15
_ROUGH, _ROUGHLY = 1e-3, 1e-3  # step after which the film is computed with the second tolerance
# Parts of each piece of ∂Ω for the finite elements of the second derivative, whose error falls with the square: with 1
# a step leaves up to a tenth of the distance to the minimum, with 3 a hundredth, with 9 a thousandth.
_FINER = 9


@dataclass(frozen=True, kw_only=True, eq=False)
class CableShape:
    """A cable in equilibrium.

    Attributes:
        cable: as given, in the direction in which the frame is passed.
        tension: given, or that of the cable of given length.
        length: in mesh units.
        control: coefficients of `cable_shapes`.
    """

    cable: Cable
    tension: float
    length: float
    control: Float[np.ndarray, "k 3"]

    def __repr__(self) -> str:
        return f"CableShape(tension {self.tension:.6g}, length {self.length:.6g})"

    def point(self, x: Float[np.ndarray, " n"], order: int = 0) -> Float[np.ndarray, "n 3"]:
        """Points of the cable, 0 ≤ x ≤ 1 from start to end, or a derivative."""
        return np.asarray(cable_shapes(x, len(self.control) - 1, order) @ self.control)

    def curvature(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Curvature vectors. Their length is 1/tension in equilibrium."""
        first, second = self.point(x, 1), self.point(x, 2)
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


def solve_membrane(edges: Sequence[Edge], *, tolerance: float = 1e-4, time_limit: float = 60.0) -> Membrane:
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
    frame = Frame.of(edges_of_arguments(edges))
    if frame.is_overturned:
        raise _no_equilibrium("its cables would turn by more than its corners leave room for")
    control, tensions = frame.start, np.array([_first_tension(one.edge) for one in frame.cables])
    while len(frame.crossed(frame.straight, control)):
        control = (control + frame.straight) / 2
    steps: list[float] = []
    is_narrow = False
    with deadline.time_limit(time_limit):
        while True:
            deadline.require_time()
            is_rough = len(frame.unknowns) > 0 and (not steps or steps[-1] > _ROUGH * frame.size)
            film = _film(frame, control, max(tolerance, _ROUGHLY) if is_rough else tolerance)
            state = _State(frame=frame, control=control, film=film)
            if not len(frame.unknowns):
                break
            step, changes, is_stable = state.step(tensions)
            length, noise = float(np.abs(step).max()), frame.size * max(_FINAL, film.boundary_residual.max_per_diagonal)
            # forces at free points are exact only after another step
            if length <= noise and not is_rough and not (frame.is_hanging and steps[-1] > noise):
                if not is_stable:
                    raise _no_equilibrium("the film is unstable")
                break
            if len(steps) == _MOST_STEPS:
                raise _no_equilibrium(f"Newton's method did not converge in {len(steps)} steps")
            share = min(1.0, _LONGEST * frame.size / max(length, np.finfo(float).tiny))
            crossed = frame.crossed(control, control + share * step)
            if len(crossed):
                share /= 2
                if is_narrow or len(frame.crossed(control, control + share * step)):
                    raise _no_equilibrium(f"its edges would cross at {frame.nodes[crossed[0]].tolist()}")
            is_narrow = len(crossed) > 0
            control, tensions = control + share * step, tensions + share * changes
            steps.append(share * length)
            if (tensions <= 0).any():
                raise _no_equilibrium("a cable would have to push")
    return state.membrane(tensions, tuple(steps))


def _first_tension(cable: Cable) -> float:
    """The tension, or for a given length about that of an arc of a circle in a plane film."""
    return cable.tension or cable.chord / (2 * np.sin(half_turn(cable)))


def _no_equilibrium(why: str) -> SurfaceError:
    return SurfaceError(
        f"no equilibrium of the film was found: {why}; raise tensions, shorten cables, or move rings together"
    )


def _film(frame: Frame, control: Float[np.ndarray, "c 3"], tolerance: float) -> PlateauSolution:
    """The film inside the frame for control points of the cables."""
    curves = frame.curves(control)
    # between two rims the other routes resolve corners less well, and take longer
    model: Model = "cauchy" if frame.sides and len(curves) == 2 else "auto"
    try:
        film = solve_plateau(curves if frame.rings else curves[0], model=model, tolerance=tolerance)
    except (LoopError, *FAILURES) as error:
        if isinstance(error, LoopError) and not frame.cables:
            raise  # given edges cross each other
        raise _no_equilibrium(f"its edges do not bound a film ({error})") from error
    if not isinstance(film, PlateauSolution):
        raise _no_equilibrium(film.reason)
    return film


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
    def lengths(self) -> list[LengthTerms]:
        """`Part.length` of each cable."""
        return [one.length(self.control) for one in self.frame.cables]

    def places(self, rim: int, s: Float[np.ndarray, " k"]) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """The parts of the frame at parameters on a rim, and the parameters on them."""
        frame, annulus = self.frame, self.film.annulus
        own = 0 if annulus is None else annulus.order[rim]
        if own < len(frame.rings):
            return np.full(len(s), len(frame.parts) - len(frame.rings) + own), s
        return frame.places(s * self.direction(rim))

    def direction(self, rim: int) -> int:
        """1 if a rim has the direction of its curve in the frame, otherwise −1."""
        annulus = self.film.annulus
        return 1 if annulus is None else 1 - 2 * annulus.backward[annulus.order[rim]]

    def shapes(self, rim: int, s: Float[np.ndarray, " k"], order: int = 0) -> Float[np.ndarray, "k c"]:
        """The derivatives of points of a rim, or of Γ′, in the control points."""
        part, x = self.places(rim, s)
        found = np.zeros((len(s), len(self.control)))
        for k in np.unique(part).tolist():
            own, here = self.frame.parts[k], np.flatnonzero(part == k)
            found[np.ix_(here, own.at)] = own.shapes(x[here], order)
            if order and k < len(self.frame.sides):
                found[here] *= self.direction(rim) / np.diff(self.frame.breaks)[k]
        return found

    @cached_property
    def by_area(self) -> Float[np.ndarray, "c 3"]:
        """The gradient of the area."""
        own = [self.shapes(rim, nodes.places).T @ nodes.conormal for rim, nodes in enumerate(self.nodes)]
        return np.asarray(np.sum(own, axis=0))

    @property
    def by_area_twice(self) -> Float[np.ndarray, "c 3 c 3"]:
        """The second derivative of the area."""
        film, count = self.film, len(self.control)
        domain, form, jacobi = film.domain.divided(_FINER), np.zeros((count, 3, count, 3)), []
        for k, (rim, nodes, boundary) in enumerate(zip(film.rims, self.nodes, domain.boundaries, strict=True)):
            _, turned, bent = rim_terms(film, nodes)
            speed = np.linalg.norm(rim.curve.derivative(nodes.places), axis=1)
            values, slopes = self.shapes(k, nodes.places), self.shapes(k, nodes.places, 1) / speed[:, None]
            for i, j in np.ndindex(3, 3):
                form[:, i, :, j] += (slopes.T * turned[:, i, j] + values.T * bent[:, i, j]) @ values
            normals = np.nan_to_num(film.array_surface.normal(boundary.vertices))
            u = self.shapes(k, rim.places(boundary.parameters[:-1]))[:, :, None] * normals[:, None]
            jacobi.append(u.reshape(len(u), -1))
        form += boundary_form(film.array_surface, domain.triangulation, np.concatenate(jacobi)).reshape(form.shape)
        return np.asarray((form + form.transpose(2, 3, 0, 1)) / 2)

    def gradient(self, tensions: Float[np.ndarray, " t"]) -> Float[np.ndarray, "c 3"]:
        """The gradient of the energy."""
        gradient = np.array(self.by_area)
        for one, tension, (_, slope, _) in zip(self.frame.cables, tensions.tolist(), self.lengths, strict=True):
            gradient[one.at] += tension * slope
        for ring in self.frame.rings:
            gradient[ring.at, 2] -= ring.edge.force or 0.0
        return gradient

    def step(self, tensions: Float[np.ndarray, " t"]) -> tuple[Float[np.ndarray, "c 3"], Float[np.ndarray, " t"], bool]:
        """Newton's step of control points and of tensions of cables of given length, and whether the film is stable."""
        frame, unknowns, size, matrix = self.frame, self.frame.unknowns, self.control.size, self.by_area_twice
        rows, misses = np.zeros((len(tensions), *self.control.shape)), np.zeros(len(tensions))
        for k, (one, tension) in enumerate(zip(frame.cables, tensions.tolist(), strict=True)):
            length, rows[k, one.at], bend = self.lengths[k]
            matrix[np.ix_(one.at, _XYZ, one.at, _XYZ)] += tension * bend
            misses[k] = length - (one.edge.length or length)
        given = [k for k, one in enumerate(frame.cables) if one.edge.length is not None]
        constraint, misses = rows.reshape(len(tensions), size)[given][:, unknowns], misses[given]
        # a multiple of the constraint, which does not change the step, makes the matrix positive
        stiff = _STIFF * constraint.T * (tensions / [length for length, _, _ in self.lengths])[given]
        gradient = self.gradient(tensions).ravel()[unknowns] + stiff @ misses
        values, vectors = eigh(matrix.reshape(size, size)[np.ix_(unknowns, unknowns)] + stiff @ constraint)
        # away from a minimum, absolute values make the step a descent
        inverse = (vectors / np.maximum(np.abs(values), _LEAST * values[-1])) @ vectors.T
        move, changes = -inverse @ gradient, np.zeros(len(tensions))
        changes[given] = np.linalg.solve(constraint @ inverse @ constraint.T, misses + constraint @ move)
        step = np.zeros(size)
        step[unknowns] = move - inverse @ constraint.T @ changes[given]
        return step.reshape(-1, 3), changes, bool(values[0] > 0)

    def membrane(self, tensions: Float[np.ndarray, " t"], steps: tuple[float, ...]) -> Membrane:
        """The result."""
        frame = self.frame
        held, shapes = np.zeros((len(frame.parts), 3)), {}
        for rim, nodes in enumerate(self.nodes):
            np.add.at(held, self.places(rim, nodes.places)[0], nodes.conormal)
        for one, tension, (length, _, _) in zip(frame.cables, tensions.tolist(), self.lengths, strict=True):
            k, edge = frame.parts.index(one), one.edge
            held[k], shapes[k] = 0, CableShape(cable=edge, tension=tension, length=length, control=self.control[one.at])
        return Membrane(
            film=self.film,
            cables=tuple(shapes[k] for k in frame.order if k in shapes),
            supports=self.control[: len(frame.nodes)],
            is_free=frame.is_free,
            forces=self.gradient(tensions)[: len(frame.nodes)],
            edge_forces=held[frame.order],
            edge_names=tuple(frame.parts[k].name for k in frame.order),
            heights=np.array([self.control[ring.at[0], 2] for ring in frame.rings]),
            steps=steps,
        )
