"""What a solved Plateau problem returns, with its evidence."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Complex, Float
from scipy.interpolate import PchipInterpolator

from spinor_geom.domain.plane_domain import Boundary, PlaneDomain
from spinor_geom.errors import SeveralRimsError
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.mesh.curve import BoundaryCurve
from spinor_geom.plateau.evidence import Evidence
from spinor_geom.plateau.misfit import BoundaryResidual
from spinor_geom.plateau.stability import Stability
from spinor_geom.plateau.steps import Clock, Iteration
from spinor_geom.plateau.threads import one_thread
from spinor_geom.shown import Shown, shortened
from spinor_geom.surface.spinor_surface import SpinorSurface

RouteName = Literal[
    "plane", "disk", "vertices", "annulus", "annular network", "circles", "flattened", "network", "trained"
]


@dataclass(frozen=True, kw_only=True, eq=False)
class RimMatch:
    """A loop and the part of ∂Ω that the surface lays on it.

    Attributes:
        loop: the loop, run as the boundary of the surface runs.
        curve: Γ, through all of the loop's points.
        boundary: the part of ∂Ω.
        matching: (n, 2), increasing pairs (t, s): the surface's boundary point at parameter t is matched with Γ(s); it
            covers one turn of both, s may exceed [0, 1).
    """

    loop: BoundaryLoop
    curve: BoundaryCurve
    boundary: Boundary
    matching: Float[np.ndarray, "n 2"]

    def __repr__(self) -> str:
        return f"RimMatch({self.loop!r}, {len(self.matching)} matched places)"

    @cached_property
    def bulge(self) -> float:
        """Largest distance of Γ from the loop's edges, each piece from its own, in mesh units."""
        return self.curve.bulge()

    def points_in_domain(self) -> Complex[np.ndarray, " m"]:
        """The points of ∂Ω that the surface matches with the loop's points, in loop order."""
        return self.boundary.point(self._parameters(self.curve.at_loop))

    def points_between(self, edge: int, count: int) -> Complex[np.ndarray, " count"]:
        """Points inside Ω beside the part of ∂Ω between two neighbouring points of the loop, in order.

        They divide the edge's part of Γ evenly. The distance from ∂Ω is a quarter of that from each to the next in the
        middle and falls towards the ends as a parabola, so that edge and points are a convex polygon.
        """
        ends = np.append(self.curve.at_loop, self.curve.at_loop[0] + 1)[edge : edge + 2]
        share = np.arange(1, count + 1) / (count + 1)
        t = self._parameters(ends[0] + share * (ends[1] - ends[0]))
        velocity = self.boundary.derivative(t)
        length = np.abs(np.diff(self.boundary.point(self._parameters(ends)))) / (count + 1)
        inwards = 1j * velocity / np.abs(velocity)
        return np.asarray(self.boundary.point(t) + share * (1 - share) * length * inwards)

    def _parameters(self, at: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Parameters on ∂Ω of what is matched with Γ(s), −1 < s < 2."""
        t, s = self.matching.T
        # three turns, so that every vertex parameter lies well inside; equal s (nodes slid together) are one knot
        s = np.concatenate([s - 1, s, s + 1])
        t = np.concatenate([t - 1, t, t + 1])
        keep = np.append(True, np.diff(np.maximum.accumulate(s)) > 0)
        return np.asarray(PchipInterpolator(s[keep], t[keep])(at))


# Numbers of the rims of each surface.
Partition: TypeAlias = tuple[tuple[int, ...], ...]

# Rims up to which Douglas's condition is told of every partition: four have 14 that are not all in one.
_MOST_FOR_ALL_PARTITIONS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class RimDisks:
    """The minimal disks over several rims, which a surface between them is set against.

    Attributes:
        count: number of the rims.
        surface_over: finds the surface of least area over one or some of them, by their numbers; None for none.
        clock: of the stage "disks".
    """

    count: int
    surface_over: Callable[[tuple[int, ...]], PlateauSolution | None]
    clock: Clock = field(default_factory=Clock)

    def __repr__(self) -> str:
        return f"RimDisks({self.count} rims)"

    @cached_property
    def all(self) -> tuple[PlateauSolution, ...] | None:
        """A disk over each rim, in the order in which they were given; None where one was not found."""
        with one_thread(), self.clock.stage("disks"):
            disks = [disk for k in range(self.count) if (disk := self.surface_over((k,))) is not None]
        return tuple(disks) if len(disks) == self.count else None

    @cached_property
    def partitions(self) -> dict[Partition, float]:
        """Areas of surfaces of fewer rims each that bound all rims together, by the numbers of the rims of each.

        Of up to four rims all partitions are there that have surfaces; of more all disks, and each disk with a surface
        over all other rims: the number of partitions grows faster than exponentially.
        """
        if self.all is None:
            return {}
        areas: dict[tuple[int, ...], float] = {(number,): disk.area for number, disk in enumerate(self.all)}
        partitions = _partitions(len(areas))
        groups = {group for partition in partitions for group in partition if len(group) > 1}
        with one_thread(), self.clock.stage("disks"):
            joined = {group: self.surface_over(group) for group in sorted(groups)}
        areas.update({group: surface.area for group, surface in joined.items() if surface is not None})
        return {
            partition: sum(areas[group] for group in partition)
            for partition in partitions
            if all(group in areas for group in partition)
        }


def _partitions(count: int) -> list[Partition]:
    """The partitions of rims that Douglas's condition is told of; see `RimDisks.partitions`."""
    if count > _MOST_FOR_ALL_PARTITIONS:
        one_apart = [((k,), tuple(j for j in range(count) if j != k)) for k in range(count)]
        return [tuple((k,) for k in range(count)), *one_apart]
    found: list[Partition] = [()]
    for number in range(count):
        found = [
            (*partition[:place], (*group, number), *partition[place + 1 :])
            for partition in found
            for place, group in enumerate((*partition, ()))
        ]
    return [partition for partition in found if len(partition) > 1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Annulus:
    """What is told of a surface between two rims or more beyond that of a disk.

    Attributes:
        modulus: logarithm of the ratio of the radii of the round annulus that Ω is conformal to; of three rims or more
            the mean modulus 2πm/T, with T the sum of the capacities of the m rims against all others; none where it was
            not needed to find the surface.
        antiperiodic: for each hole of Ω whether p and q change their sign around it.
        period: |Re ∮ φ dz| around a hole, the largest, in mesh units: the gap by which the surface does not close.
        backward: for each loop that was given whether it runs against the boundary of the surface; not the first of
            two.
        order: the numbers of the given loops in the order of the rims.
        rim_disks: the minimal disks over all loops.
    """

    modulus: float | None
    antiperiodic: tuple[bool, ...]
    period: float
    backward: tuple[bool, ...]
    order: tuple[int, ...]
    rim_disks: RimDisks

    def __repr__(self) -> str:
        modulus = "" if self.modulus is None else f", modulus {self.modulus:.6g}"
        return f"Annulus({len(self.order)} rims{modulus}, {self.spin}, period {self.period:.1e})"

    @property
    def spin(self) -> Literal["periodic", "antiperiodic"]:
        """Whether p and q come back to themselves around all holes, or change their sign around one."""
        return "antiperiodic" if any(self.antiperiodic) else "periodic"

    @property
    def reversed(self) -> bool:
        """Whether the loops that were given run against each other: some with the boundary of the surface, some not."""
        return len(set(self.backward)) > 1

    @property
    def disks(self) -> tuple[PlateauSolution, ...] | None:
        """The minimal disks over the loops, in the order of the rims; none where one was not found.

        They are solved when they are first asked for.
        """
        disks = self.rim_disks.all
        return None if disks is None else tuple(disks[number] for number in self.order)

    @property
    def disk_area(self) -> float | None:
        """Area of all disks together."""
        return None if self.disks is None else sum(disk.area for disk in self.disks)

    @property
    def partition_areas(self) -> dict[Partition, float]:
        """`RimDisks.partitions`: what Douglas's condition sets the surface's area against."""
        return self.rim_disks.partitions

    def to_dict(self) -> dict[str, Any]:
        """The figures, JSON-ready."""
        return {
            "modulus": self.modulus,
            "spin": self.spin,
            "antiperiodic": list(self.antiperiodic),
            "period": self.period,
            "reversed": self.reversed,
            "disk_area": self.disk_area,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateauSolution(Shown):
    """A minimal disk over a loop, or a minimal surface of one piece between two or more.

    Attributes:
        rims: the loop, or all, with the parts of ∂Ω that lie on them: the outer boundary of Ω first.
        domain: Ω.
        boundary_residual: distance of the surface's boundary from Γ, of all rims together.
        area: ½∮ r·Im(φ dz), in squared mesh units.
        route: how it was found. "plane": Ω is the region inside the plane loop, p and q are constant. "vertices": of
            the surfaces through rough loops' points the one nearest to a discrete minimal disk, or to that over
            averages of several loops; Γ between the points is the surface's own boundary. "disk", "unfolded",
            "flattened": Douglas's slide on the unit disk, on the unfolded least-area triangulation, or on a flattened
            discrete disk; p and q are a power series or Cauchy's formula. "network": Gauss-Newton for a Cauchy network.
            "trained": training of a complex-valued network.
            "annulus": Douglas's slides of two rims and the modulus between them, "circles" those of more and the moduli
            of a disk with round holes; p and q are Laurent series. "annular network": Gauss-Newton for a Cauchy network
            on a flattened discrete annulus.
        history: the steps.
        solve_timings: wall time of each stage of the solve, in seconds.
        tolerance: RMS residual per mean edge that was asked for.
        converged: whether `boundary_residual.rms_per_edge` is within the tolerance, and `max_per_local_edge` within a
            hundred times as much.
        reason: one sentence: why the solver stopped.
        evidence: the surface, and checks of it, made when they are first read, as the properties below.
        annulus: what is told of surfaces over several rims alone; none for disks.
    """

    rims: tuple[RimMatch, ...]
    domain: PlaneDomain
    boundary_residual: BoundaryResidual
    area: float
    route: RouteName
    history: tuple[Iteration, ...]
    solve_timings: Mapping[str, float]
    tolerance: float
    converged: bool
    reason: str
    evidence: Evidence
    annulus: Annulus | None = None

    def __repr__(self) -> str:
        rims = " + ".join(str(len(rim.loop)) for rim in self.rims)
        state = "converged" if self.converged else f"not converged: {self.reason}"
        residual = f"residual {self.boundary_residual.rms_per_edge:.1e} of an edge"
        return shortened(f"PlateauSolution({rims} points, area {self.area:.6g}, {residual}, {self.route!r}, {state})")

    @property
    def surface(self) -> SpinorSurface:
        """The surface, in the loop's own coordinates."""
        return self.evidence.surface

    @property
    def stability(self) -> Stability:
        """Verdict of the second variation."""
        return self.evidence.stability

    @property
    def area_in_domain(self) -> float:
        """The area by quadrature in Ω, a check of `area` over smooth rims; beside rough ones it is off by percents.

        See `evidence.area_in_domain`.
        """
        return self.evidence.area_in_domain

    @property
    def self_intersections(self) -> int | None:
        """Pairs of triangles that cross in the surface's mesh over Ω's triangulation; 0 where it shows no crossing.

        Every disk over a knotted loop crosses itself. None where the mesh is not finite, so that nothing is known.
        """
        return self.evidence.self_intersections

    @property
    def timings(self) -> dict[str, float]:
        """Wall time of each stage of the solve and of the checks that were read so far, in seconds."""
        disks = {} if self.annulus is None else self.annulus.rim_disks.clock.seconds
        return {**self.solve_timings, **self.evidence.clock.seconds, **disks}

    @property
    def loop(self) -> BoundaryLoop:
        """The loop of a disk; a SeveralRimsError where the surface has several rims."""
        return self._rim.loop

    @property
    def curve(self) -> BoundaryCurve:
        """Γ of a disk; a SeveralRimsError where the surface has several rims."""
        return self._rim.curve

    @property
    def matching(self) -> Float[np.ndarray, "n 2"]:
        """`RimMatch.matching` of a disk; a SeveralRimsError where the surface has several rims."""
        return self._rim.matching

    @property
    def _rim(self) -> RimMatch:
        if len(self.rims) > 1:
            raise SeveralRimsError(rims=len(self.rims))
        return self.rims[0]

    @property
    def is_area_minimum(self) -> bool:
        """Whether the area is a local minimum and, over several rims, below those of `Annulus.partition_areas`.

        That is Douglas's condition. A surface that is stable but has more area than surfaces of fewer rims each is a
        local minimum only. Where the disks are not known the condition counts as not met.
        """
        if self.stability.verdict != "stable":
            return False
        if self.annulus is None:
            return True
        areas = self.annulus.partition_areas.values()
        return bool(areas) and self.area < min(areas)

    def loop_points_in_domain(self) -> Complex[np.ndarray, " m"]:
        """The points of ∂Ω that the surface matches with the loop's points, in loop order, rim after rim."""
        return np.concatenate([rim.points_in_domain() for rim in self.rims])

    def to_dict(self) -> dict[str, Any]:
        """The figures, JSON-ready."""
        residual = self.boundary_residual
        return {
            "vertices": sum(len(rim.loop) for rim in self.rims),
            "area": self.area,
            "area_in_domain": self.area_in_domain,
            "self_intersections": self.self_intersections,
            "residual": {
                **asdict(residual),
                "rms_per_edge": residual.rms_per_edge,
                "max_per_edge": residual.max_per_edge,
                "rms_per_diagonal": residual.rms_per_diagonal,
                "max_per_diagonal": residual.max_per_diagonal,
            },
            "bulge_per_edge": max(rim.bulge for rim in self.rims) / residual.mean_edge,
            "route": self.route,
            "iterations": len(self.history),
            "tolerance": self.tolerance,
            "converged": self.converged,
            "reason": self.reason,
            "stability": asdict(self.stability),
            "annulus": None if self.annulus is None else self.annulus.to_dict(),
            "timings": self.timings,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class NoConnectedSurface:
    """The answer that no minimal surface of one piece spans several rims: it falls apart into surfaces of fewer each.

    Attributes:
        loops: all of them.
        rim_disks: the minimal disks over them.
        reason: one sentence: how it is known.
        history: the steps.
        solve_timings: wall time of each stage of the search, in seconds.
    """

    loops: tuple[BoundaryLoop, ...]
    rim_disks: RimDisks
    reason: str
    history: tuple[Iteration, ...]
    solve_timings: Mapping[str, float]

    def __repr__(self) -> str:
        rims = " + ".join(str(len(loop)) for loop in self.loops)
        return shortened(f"NoConnectedSurface({rims} points: {self.reason})")

    @property
    def disks(self) -> tuple[PlateauSolution, ...] | None:
        """The minimal disks over the loops, solved when they are first asked for; none where one was not found."""
        return self.rim_disks.all

    @property
    def timings(self) -> dict[str, float]:
        """Wall time of each stage of the search, and of the disks where they were asked for, in seconds."""
        return {**self.solve_timings, **self.rim_disks.clock.seconds}

    @property
    def partition_areas(self) -> dict[Partition, float]:
        """`RimDisks.partitions`: of what is left the least has the least area."""
        return self.rim_disks.partitions

    @property
    def area(self) -> float | None:
        """Area of all disks together: of two rims the least area that they bound."""
        return None if self.disks is None else sum(disk.area for disk in self.disks)

    def to_dict(self) -> dict[str, Any]:
        """The figures, JSON-ready."""
        return {
            "vertices": sum(map(len, self.loops)),
            "disk_area": self.area,
            "reason": self.reason,
            "iterations": len(self.history),
            "timings": self.timings,
        }
