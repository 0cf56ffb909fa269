"""What a solution is checked by beyond its residual: computed when it is first asked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from spinor_geom.plateau.certificates import area_in_domain, crossing_faces
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.stability import Stability, assess_stability
from spinor_geom.plateau.threads import one_thread
from spinor_geom.surface.spinor_surface import SpinorSurface


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Checks of a surface, each made when it is first read and timed by itself."""

    surface: SpinorSurface
    is_plane: bool = False  # whether it is a plane region inside a simple boundary, which does not cross itself
    clock: Clock = field(default_factory=Clock)  # of the stages "stability" and "certificates"

    @cached_property
    def stability(self) -> Stability:
        """Verdict of the second variation."""
        with one_thread(), self.clock.stage("stability"):
            return assess_stability(self.surface)

    @cached_property
    def area_in_domain(self) -> float:
        """The area by quadrature over Ω: see `certificates.area_in_domain`."""
        with one_thread(), self.clock.stage("certificates"):
            return area_in_domain(self.surface)

    @cached_property
    def self_intersections(self) -> int | None:
        """Pairs of triangles that cross in the surface's mesh: see `certificates.crossing_faces`."""
        with one_thread(), self.clock.stage("certificates"):
            return 0 if self.is_plane else crossing_faces(self.surface)
