"""Moves the inner vertices of a patch so that it continues the mean curvature of the mesh around it.

The patch is stationary for ∫H² + ℓ²|∇H|², with the metric held fixed, among the surfaces through the rim that
have the mesh's tangents there: Δ(H − ℓ²ΔH) = 0. Spheres, cylinders and planes are continued exactly. It is the most
likely surface if H is a random field with correlation length ℓ, which is measured around the hole: the curvature of a
smooth mesh continues far into the patch, that of a rough one does not.

Where H varies around the hole, the metric is longer across ridges and valleys (`collar.stretch_across_creases`): the
patch bends more easily across them, and H varies more, than along them, so that ridges of the mesh are continued. On
spheres, cylinders and planes H is constant, and the metric is that of the surface.

Sources: Schneider & Kobbelt (2001), Geometric fairing of irregular meshes for free-form surface design, for ΔH = 0;
Clarenz, Diewald & Rumpf (2000), Anisotropic geometric diffusion in surface processing, for such metrics.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array

from spinor_geom.arrays import TINY
from spinor_geom.deadline import is_out_of_time
from spinor_geom.errors import OutOfTimeError, SingularMatrixError
from spinor_geom.fill.collar import Collar, stretch_across_creases
from spinor_geom.mesh.operators import Bending, BendingForm, factor_symmetric, side_lengths
from spinor_geom.meshing.embed import Patch

# Measured, here and in `continuation`, on 111 holes: 70 generated ones, and rims of scans and of defective meshes.
STEP_TOLERANCE = 0.01  # convergence: largest displacement in the next step, in mean edges. 0.005 takes 12 % more steps
SMALLEST_ANGLE = 10.0  # degrees. With 20 it takes 1.5 times as long, and as many patches keep angles below 10
# A patch with edges stretched by more than this is remeshed. With 4 the ends of two fingers bend by 7.6° across the rim
# instead of 5.9°. 1.4 takes 14 % more steps for the same smallest angles.
_MOST_STRETCHED = 2.0
_APPROACH = 4  # steps between two remeshings
_MOST_STEPS = 40  # with 20 two more rims that fold do not converge. None takes 80
# A factorisation is reused if each step is at most half of the last one: the simplified Newton method still converges
# then (0.25 takes 37 % more time). Newton's method ends below the least damping factor: 0.025 takes 14 % more steps,
# 0.1 takes 7 % fewer, for the same shapes.
_QUICK, _LEAST_DAMPING = 0.5, 0.05

Order: TypeAlias = Literal["curvature", "thin plate"]
Positions: TypeAlias = Float[np.ndarray, "v 3"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Faired:
    """A patch with moved vertices. The figures are as in `Continuation`."""

    patch: Patch
    steps: int
    next_step: float
    stretch: float  # largest ratio of an edge's lengths after and before
    order: Order = "curvature"
    lowered: str = ""
    is_coarse: bool = False
    crease: Int[np.ndarray, " k"] | None = None  # boundary vertices on a crease that goes on through the patch

    @property
    def converged(self) -> bool:
        """Whether the next step is within the tolerance."""
        return self.next_step <= STEP_TOLERANCE

    @property
    def is_thin(self) -> bool:
        """Whether a triangle has an angle below 10° that is not between two rim edges."""
        return self.patch.angles.smallest_free < SMALLEST_ANGLE

    @property
    def is_good(self) -> bool:
        """Whether it has converged without thin or stretched triangles."""
        return self.converged and not self.is_thin and self.stretch <= _MOST_STRETCHED

    @property
    def defect(self) -> str:
        """Why the patch is not used as it is: not converged or folded. Empty if it is used."""
        if not self.converged:
            return f"did not converge: the next step would move a vertex by {self.next_step:.2g} of an edge"
        return "is folded" if self.patch.angles.folds else ""


def thin_plate(patch: Patch, collar: Collar) -> Faired:
    """Minimises ∫|Δx|², with the Laplacian of the patch: a linear problem. Raises as `factor_symmetric`."""
    equations = _Equations(patch, collar)
    x = equations.smoothed()
    return replace(_faired(patch, x[: equations.free], 0, 0.0), order="thin plate")


def minimised_curvature(patch: Patch, collar: Collar) -> Faired:
    """Minimises ∫H² + ℓ²|∇H|² by Newton's method, damped so that its steps get smaller.

    Raises:
        SingularMatrixError: triangles of the patch are degenerate.
        OutOfTimeError: the time limit was reached before there was a result.
    """
    equations = _Equations(patch, collar)
    x, steps, left = equations.solved()
    return _faired(patch, x[: equations.free], steps, left)


def approached(patch: Patch, collar: Collar) -> Faired:
    """A patch after some steps of Newton's method of at most one edge, towards a minimum that is far away.

    Raises as `minimised_curvature`.
    """
    equations = _Equations(patch, collar)
    x, left = equations.approached()
    return _faired(patch, x[: equations.free], _APPROACH, left)


def _faired(patch: Patch, inner: Float[np.ndarray, "k 3"], steps: int, next_step: float) -> Faired:
    vertices = np.concatenate([patch.vertices[: patch.boundary_size], inner])
    before, after = (side_lengths(v, np.asarray(patch.faces)) for v in (patch.vertices, vertices))
    stretch = float((after / np.maximum(before, TINY)).max())
    moved = replace(patch, vertices=vertices)
    if not np.isfinite(moved.area):  # vertices so far away are errors of rounding of an almost singular matrix
        raise SingularMatrixError(size=len(inner))
    return Faired(patch=moved, steps=steps, next_step=next_step, stretch=stretch)


class _Equations:
    """The Euler–Lagrange equations at the inner vertices of a patch. Arrays have these first, then the collar's."""

    def __init__(self, patch: Patch, collar: Collar) -> None:
        m, self.inside = collar.boundary_size, len(patch.vertices)
        self.free = self.inside - m
        numbers = np.concatenate([np.arange(m) + self.free, np.arange(self.free)])
        self._faces = np.concatenate([numbers[patch.faces], collar.faces + self.free])
        self._start = np.concatenate([patch.vertices[m:], collar.vertices])
        bends = np.concatenate([np.ones(self.free, dtype=bool), collar.bends])
        self._bends = bends[: self.inside]
        self._beyond = collar.curvature
        self._squared_length = collar.length**2
        self._collar = collar
        # ∇H is defined on faces with three vertices where H is defined
        known = bends[self._faces].all(axis=1)
        self._known = None if known.all() else known

    @cached_property
    def _stretch(self) -> Float[np.ndarray, "f 3 3"] | None:
        """`stretch_across_creases` for the third fundamental form of the mesh, continued into the patch."""
        n, collar = self.free, self._collar
        if not collar.variation:
            return None
        starts, rows, values = Bending.of(self._start, self._faces).matrix
        columns, rows = np.repeat(np.arange(len(starts) - 1), np.diff(starts)), rows[: starts[-1]]
        # each form is a mean of its neighbours', and so has no negative curvatures
        values = np.where(rows == columns, 0.0, np.minimum(values[: len(rows)], 0.0))
        values -= np.where(rows == columns, np.bincount(columns, values)[columns], 0.0)
        own, form = csc_array((values, rows, starts), (len(starts) - 1,) * 2), collar.third_form.reshape(-1, 9)
        pull = own @ np.concatenate([np.zeros((n, 9)), form])
        inner = factor_symmetric(own[:n, :n]).solve(-pull[:n])
        return stretch_across_creases(np.concatenate([inner, form]).reshape(-1, 3, 3), self._faces, collar.variation)

    def smoothed(self) -> Positions:
        """Minimises ∫|Δx|² over the free vertices, with the Laplacian of the positions at the start."""
        x, n = self._start, self.free
        bending = Bending.of(x, self._faces)
        form = self._form(x, bending, 0.0)
        laplacian, kept = bending.laplacian, x.copy()
        kept[:n] = 0
        pull = laplacian @ (form.weights[:, None] * (laplacian @ kept))
        return np.concatenate([factor_symmetric(form.stiffness).solve(-pull[:n] / 2), x[n:]])

    def approached(self) -> tuple[Positions, float]:
        """Positions after some steps of at most one edge, and the length of the last step in local edges."""
        x, n, length = self._start, self.free, np.inf
        for _ in range(_APPROACH):
            form, residual = self._at(x)
            step = -factor_symmetric(form.stiffness).solve(residual)
            length = float((np.abs(step) / np.sqrt(form.bending.areas[:n])).max())
            x = x.copy()
            x[:n] += step[:, None] / max(length, 1.0) * form.bending.normals[:n]
            if is_out_of_time():
                break
        return x, length

    def solved(self) -> tuple[Positions, int, float]:
        """Newton's method: the last positions, the number of steps, and the next step's length.

        Steps are along the normals, damped by Deuflhard's restricted monotonicity test. The length is the largest
        displacement of a vertex, in mean edges.

        Source: Deuflhard (2004), Newton Methods for Nonlinear Problems.
        """
        x, n, steps, damping = self._start, self.free, 0, 1.0
        form, residual = self._at(x)
        edge = float(np.sqrt(form.bending.areas[:n].mean()))
        factor = factor_symmetric(form.stiffness)
        step = -factor.solve(residual)
        length = float(np.sqrt(np.mean(step**2)))
        while np.abs(step).max() > STEP_TOLERANCE * edge:
            if steps == _MOST_STEPS or damping < _LEAST_DAMPING or is_out_of_time():
                break
            moved = x.copy()
            moved[:n] += damping * step[:, None] * form.bending.normals[:n]
            there, residual = self._at(moved)
            following = -factor.solve(residual)
            following_length = float(np.sqrt(np.mean(following**2)))
            # at least a quarter of the predicted decrease. An eighth gives the same. With a half 12 patches fail
            if not following_length < (1 - damping / 4) * length:
                damping /= 2
                continue
            steps += 1
            if damping < 1 or following_length > _QUICK * length:
                with suppress(OutOfTimeError):  # the steps with the old factors converge more slowly
                    factor = factor_symmetric(there.stiffness)
                    following = -factor.solve(residual)
                    following_length = float(np.sqrt(np.mean(following**2)))
            x, form, step, length, damping = moved, there, following, following_length, 1.0
        left = float(np.abs(step).max() / edge)
        if left <= STEP_TOLERANCE:
            x = x.copy()
            x[:n] += step[:, None] * form.bending.normals[:n]
        return x, steps, left

    def _form(self, x: Positions, bending: Bending, squared_length: float) -> BendingForm:
        weights, inside = np.zeros(len(x)), self.inside
        weights[:inside] = self._bends / bending.areas[:inside]
        known = bending
        if self._known is not None and squared_length:
            stretch = None if self._stretch is None else self._stretch[self._known]
            known = Bending.of(x, self._faces[self._known], stretch)
        return BendingForm(
            bending=bending, free=self.free, weights=weights, squared_length=squared_length, gradient=known.matrix
        )

    def _at(self, x: Positions) -> tuple[BendingForm, Float[np.ndarray, " k"]]:
        """The operator of H, and L(H + ℓ²LH/A) at the free vertices."""
        bending = Bending.of(x, self._faces, self._stretch)
        form = self._form(x, bending, self._squared_length)
        curvature = np.where(self._bends, bending.curvature[: self.inside], 0.0)
        return form, form.of(np.concatenate([curvature, self._beyond]))
