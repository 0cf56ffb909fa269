"""An adapter for a mesh type of your own: afterwards `fill_hole` takes a Cloth and returns one."""

from dataclasses import dataclass

import numpy as np

import spinor_geom
from spinor_geom.adapters import register
from spinor_geom.mesh.triangle_mesh import MeshExtension


@dataclass
class Cloth:
    """A mesh type of another program: positions (V, 3) and triangles (F, 3)."""

    points: np.ndarray
    triangles: np.ndarray


class ClothAdapter:
    """Converts and extends a Cloth; `types` holds its top-level module and class, joined by a dot."""

    name = "Cloth"
    types = (f"{Cloth.__module__.partition('.')[0]}.Cloth",)

    def to_mesh(self, cloth: Cloth) -> spinor_geom.TriangleMesh:
        """The triangles, with all vertices in their order."""
        return spinor_geom.TriangleMesh(cloth.points, cloth.triangles)

    def extend(self, cloth: Cloth, extension: MeshExtension) -> Cloth:
        """A new Cloth: the old one unchanged, followed by the new vertices and triangles."""
        points = np.concatenate([cloth.points, extension.vertices])
        return Cloth(points, np.concatenate([cloth.triangles, extension.faces]))


register(ClothAdapter())

if __name__ == "__main__":
    box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4]]  # no lid
    cloth = Cloth(box, np.array([[a, *pair] for a, b, c, d in sides for pair in ((b, c), (c, d))]))
    filled, report = spinor_geom.fill_hole(cloth, return_report=True)
    print(f"{type(filled).__name__}: {len(cloth.triangles)} triangles, {len(filled.triangles)} when filled")
    print(f"watertight: {report.watertight}")
