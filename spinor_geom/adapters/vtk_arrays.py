"""The contents of VTK's polygonal data and unstructured grids, checked before VTK's own functions are given them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from jaxtyping import Int, Shaped

from spinor_geom.adapters.contents import malformed, real_numbers
from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.adapters.pyvista_mesh import set_array
from spinor_geom.files import is_bomb

if TYPE_CHECKING:
    import pyvista

MOST_ARRAYS = 1000  # VTK looks for an array by comparing the names of all
# arrays with a role in VTK, and the numbers of columns that it allows
ROLES: dict[str, Callable[[int], bool]] = {
    "Scalars": lambda width: True,
    "Normals": lambda width: width == 3,
    "TCoords": lambda width: width <= 3,
}
KINDS = ("Verts", "Lines", "Polys", "Strips")  # of the cells of polygonal data, in the order of the cell data


def checked_cells(starts: np.ndarray, corners: np.ndarray, *, points: int, place: str) -> Polygons:
    """Cells of any number of points. Raises a MeshFileError if the starts do not fit, or a corner is not a point."""
    if starts[0] or starts[-1] != len(corners) or (np.diff(starts) < 0).any():
        raise malformed(place, "the offsets of the cells do not fit their connectivity", "make the cells anew")
    for corner in np.flatnonzero((corners < 0) | (corners >= points))[:1].tolist():
        cell = int(np.searchsorted(starts, corner, side="right")) - 1
        raise malformed(place, f"cell {cell} has point {corners[corner]} of {points}", "correct the index")
    return Polygons(starts=starts.astype(np.int64), corners=corners.astype(np.int64))


def counted_cells(numbers: np.ndarray, count: int, *, points: int, place: str) -> Polygons:
    """Cells that are stored one after the other, each as the number of its points and their indices."""
    values = numbers.tolist()
    starts, at = [0], 0
    while len(starts) <= count and at < len(values) and values[at] >= 0:
        at += 1 + values[at]
        starts.append(at)
    if len(starts) <= count or at != len(values):
        problem = f"its {len(values)} numbers are not {count} cells, each a count and as many point indices"
        raise malformed(place, problem)
    is_corner = np.ones(len(values), dtype=bool)
    is_corner[starts[:-1]] = False
    return checked_cells(np.array(starts) - np.arange(count + 1), numbers[is_corner], points=points, place=place)


def numbers_of(words: list[bytes], dtype: np.dtype[Any], place: str) -> Shaped[np.ndarray, " n"]:
    """Words as numbers. Raises a MeshFileError if one is not a number, or too large for integers of this type."""
    try:
        with np.errstate(over="ignore"):  # too large real numbers are infinite
            return np.array(real_numbers(words) if dtype.kind == "f" else list(map(int, words)), dtype=dtype)
    except (ValueError, OverflowError) as error:
        raise malformed(place, str(error), "correct the number") from error


def texts_of(texts: list[str], size: int, place: str) -> Shaped[np.ndarray, " n"]:
    """Texts as an array, each of which takes as much memory as the longest. `size` is that of the file, in bytes."""
    if is_bomb(len(texts) * max(map(len, texts), default=0), size):
        raise malformed(place, "its texts have too different lengths", "shorten the longest")
    return np.array(texts, dtype=str)


Arrays: TypeAlias = dict[str, Shaped[np.ndarray, "_ ..."]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """Arrays of values by name, at points, in cells, or of the whole mesh, with text as numpy strings."""

    arrays: Arrays = field(default_factory=dict)
    active: dict[str, str] = field(default_factory=dict)  # the names of the arrays that have one of `ROLES`

    def give(self, target: Any) -> None:
        """Sets the data of a PyVista mesh."""
        if len(self.arrays) > MOST_ARRAYS:
            raise malformed("", f"has {len(self.arrays)} arrays of data, more than {MOST_ARRAYS}", "divide the file")
        for name, values in self.arrays.items():
            set_array(target, name, values)
        for role, name in self.active.items():
            held = self.arrays.get(name)
            if held is not None and held.dtype.kind != "U" and ROLES[role](held.size // max(len(held), 1)):
                getattr(target.VTKObject, f"SetActive{role}")(name)


@dataclass(frozen=True, kw_only=True, eq=False)
class VtkMesh:
    """The contents of a file."""

    points: Shaped[np.ndarray, "n 3"]
    cells: dict[str, Polygons]  # for each of `KINDS` in it, or "Cells" of an unstructured grid
    types: Int[np.ndarray, " c"] | None  # VTK's number for each cell of an unstructured grid
    point_data: Data
    cell_data: Data
    field_data: Data

    def to_pyvista(self) -> pyvista.PolyData | pyvista.UnstructuredGrid:
        """The same mesh in PyVista. Raises a MeshFileError if an array has the wrong number of values."""
        import pyvista

        counts = {"POINT_DATA": len(self.points), "CELL_DATA": sum(map(len, self.cells.values()))}
        for (place, count), data in zip(counts.items(), (self.point_data, self.cell_data), strict=True):
            for name, values in data.arrays.items():
                if len(values) != count:
                    raise malformed(place, f"the array '{name}' has {len(values)} rows for {count} of the mesh")
        points = self.points if self.points.dtype.kind == "f" else self.points.astype(np.float64)
        mesh: Any
        if self.types is None:
            mesh = pyvista.PolyData()
            mesh.points = points
            for kind, cells in self.cells.items():
                if len(cells):
                    getattr(mesh, f"Set{kind}")(pyvista.CellArray.from_arrays(cells.starts, cells.corners))
        else:
            cells = self.cells["Cells"]
            if len(self.types) != len(cells):
                raise malformed("CELL_TYPES", f"has {len(self.types)} types for {len(cells)} cells")
            counted = np.insert(cells.corners, cells.starts[:-1], cells.sizes)
            mesh = pyvista.UnstructuredGrid(counted, self.types.astype(np.uint8), points)
        self.point_data.give(mesh.point_data)
        self.cell_data.give(mesh.cell_data)
        self.field_data.give(mesh.field_data)
        whole: pyvista.PolyData | pyvista.UnstructuredGrid = mesh
        return whole
