"""Charts: parametrised exact surfaces, and distances of points and meshes from them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.spatial import cKDTree

from spinor_geom.domain.polygons import lattice_inside
from spinor_geom.measures import HausdorffDistance, SurfaceSamples, distances_to_mesh, mesh_samples

SurfaceFunction = Callable[[Complex[np.ndarray, "*pts"]], Float[np.ndarray, "*pts 3"]]
TangentFunction = Callable[[Complex[np.ndarray, "*pts"]], Float[np.ndarray, "*pts 2 3"]]

_STARTS, _MOST_STEPS = 3000, 60  # starting points and steps of Gauss-Newton's method for the nearest point
_BLOCK = 1 << 14  # points that are projected together


@dataclass(frozen=True, kw_only=True, eq=False)
class Chart:
    """A piece of a surface over a polygon in the plane z = x + iy, and its images under symmetries.

    The formulas must also be valid in a neighbourhood of the polygon.
    """

    position: SurfaceFunction  # r(z)
    tangents: TangentFunction  # r_x and r_y
    outline: Complex[np.ndarray, " m"]  # the polygon, counter-clockwise, with many vertices along curved sides
    symmetries: tuple[Float[np.ndarray, "3 3"], ...] = (np.eye(3),)  # orthogonal matrices

    def samples(self, count: int) -> SurfaceSamples:
        """About `count` points of the surface over a triangular lattice, each with its share of the surface area."""
        wanted = -(-count // len(self.symmetries))
        z, cell = self.lattice(wanted), self._spacing(wanted)
        points, areas, t = self.position(z), self.stretch(z), self.tangents(z)
        return SurfaceSamples(
            points=np.concatenate([points @ m.T for m in self.symmetries]),
            areas=np.tile(areas, len(self.symmetries)) * cell**2 * 3**0.5 / 2,
            # the distance from the lattice is at most the circumradius of a lattice triangle
            spacing=float(np.linalg.norm(t, axis=2).max() * cell / 3**0.5),
        )

    def hausdorff(
        self, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], *, samples: int = 20_000
    ) -> HausdorffDistance:
        """Symmetric Hausdorff distance as by `hausdorff_distance`. `forward` is from the mesh to the surface."""
        here, there = mesh_samples(vertices, faces, samples), self.samples(samples)
        backward = there.summary(distances_to_mesh(there.points, vertices, faces))
        return HausdorffDistance(forward=here.summary(self.distances(here.points)), backward=backward)

    def lattice(self, count: int) -> Complex[np.ndarray, " k"]:
        """About `count` points of a triangular lattice inside the polygon."""
        # shifted, so that no row lies along a straight side, where tangents may be infinite
        spacing = self._spacing(count)
        shift = (0.3 + 0.4j) * spacing
        return lattice_inside(self.outline + shift, spacing) - shift

    def _spacing(self, count: int) -> float:
        v = self.outline
        area = 0.5 * float(np.imag(np.conj(v) * np.roll(v, -1)).sum())
        return float((area / count * 2 / 3**0.5) ** 0.5)

    def stretch(self, z: Complex[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Area element |r_x × r_y|: surface area per area in the plane."""
        t = self.tangents(z)
        return np.asarray(np.linalg.norm(np.cross(t[:, 0], t[:, 1]), axis=1))

    def distances(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distances of points from the surface. Nearest points may lie slightly outside the polygon.

        Gauss-Newton's method starts from the nearest of 3000 points. Steps are shortened until the distance falls.
        """
        blocks = np.array_split(points, -(-len(points) // _BLOCK)) if len(points) else [points]
        images = [np.concatenate([self._distances(block @ m) for block in blocks]) for m in self.symmetries]
        return np.asarray(np.min(images, axis=0))

    @cached_property
    def _starts(self) -> tuple[Complex[np.ndarray, " k"], cKDTree, Float[np.ndarray, "c 3"]]:
        """Starting points, a k-d tree of their positions, and the positions of corners without tangents."""
        z = np.concatenate([self.lattice(_STARTS), self.outline])
        with np.errstate(all="ignore"):
            regular = np.isfinite(self.tangents(z)).all(axis=(1, 2))
        return z[regular], cKDTree(self.position(z[regular])), self.position(z[~regular])

    def _distances(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        starts, tree, corners = self._starts
        distance, nearest = tree.query(points)
        z, best, share = starts[nearest], np.asarray(distance), np.ones(len(points))
        active = np.arange(len(points))
        for _ in range(_MOST_STEPS):
            if not len(active):
                break
            here = z[active]
            with np.errstate(all="ignore"):  # NaN distances are never smaller
                trial = here + share[active] * _gauss_newton_step(
                    self.tangents(here), points[active] - self.position(here)
                )
                reached = np.linalg.norm(points[active] - self.position(trial), axis=1)
            nearer: Bool[np.ndarray, " n"] = reached < best[active]
            gain = np.where(nearer, best[active] - reached, np.inf)
            z[active] = np.where(nearer, trial, here)
            best[active] = np.where(nearer, reached, best[active])
            share[active] = np.where(nearer, np.minimum(2 * share[active], 1.0), share[active] / 4)
            # stop where the gain is rounding error, or the step became too short
            active = active[(share[active] > 1e-4) & ~(nearer & (gain <= 1e-15 * (1 + best[active])))]
        if len(corners):
            best = np.minimum(best, cKDTree(corners).query(points)[0])
        return best


def _gauss_newton_step(
    tangents: Float[np.ndarray, "n 2 3"], residual: Float[np.ndarray, "n 3"]
) -> Complex[np.ndarray, " n"]:
    """The step in the plane whose image under the tangents is nearest to the residual."""
    x, y = tangents[:, 0], tangents[:, 1]
    xx, xy, yy = (np.einsum("nk,nk->n", a, b) for a, b in ((x, x), (x, y), (y, y)))
    dx, dy = np.einsum("nk,nk->n", x, residual), np.einsum("nk,nk->n", y, residual)
    det = xx * yy - xy**2
    return np.asarray(((yy * dx - xy * dy) + 1j * (xx * dy - xy * dx)) / det)


def null_tangents(phi: Complex[np.ndarray, "*pts 3"]) -> Float[np.ndarray, "*pts 2 3"]:
    """Tangents r_x = Re φ and r_y = −Im φ."""
    return np.stack([phi.real, -phi.imag], axis=-2)
