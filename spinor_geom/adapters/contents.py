"""The contents of a mesh file in any format, and functions that the formats share."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int, Real

from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.adapters.textures import Appearance
from spinor_geom.errors import MeshFileError
from spinor_geom.mesh.topology import coincident_vertices, referenced_vertices
from spinor_geom.mesh.triangle_mesh import MeshExtension, Stored

BYTE_ORDER_MARK = b"\xef\xbb\xbf"  # what some editors put before UTF-8 text
LONGEST_PROBLEM = 240  # characters
COMMENT = rb"(?<!1\.)#[^\n]*"  # but not in 1.#QNAN
# as C libraries write NaN and infinity
_NO_NUMBER = re.compile(rb"^[+-]?(1\.#[A-Z]+0*|nan\([0-9A-Z]*\))$", re.IGNORECASE)
UV = "texture coordinates"
MOST_CHANGE = 1e-3  # of an edge, by rounding to single precision, relative to its length
Value = TypeVar("Value")
METRES = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
"""The units of 3MF files, in metres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FileContents:
    """The contents of a mesh file."""

    vertices: Float[np.ndarray, "v 3"]  # in the file's order
    polygons: Polygons  # the faces of the file, as indices of its own vertices
    # "color" in the file's own scale, "normal", "uv" (origin at the lower left), others by their names in the file
    attributes: Mapping[str, Float[np.ndarray, "v _"]] = field(default_factory=dict)
    labels: frozenset[str] = frozenset()  # names of the attributes whose values are classes
    color_scale: float = 1.0  # full intensity in "color": 1, 255 or 65535
    has_linear_colors: bool = False  # whether "color" is proportional to light, as in GLB, and not in sRGB
    # factors of the colours of the vertices that were read, proportional to light, by materials, or None without any
    tint: Float[np.ndarray, "n 3"] | None = None
    # the vertex that represents the position of each: itself, except at texture and normal seams
    representatives: Int[np.ndarray, " v"]
    # the index of the loop that each polygon fills, also in an earlier fill if the file says so, or −1. None: all −1
    face_loops: Int[np.ndarray, " p"] | None = None
    # curves beside faces, of vertex indices. A closed one repeats its first
    polylines: tuple[Int[np.ndarray, " _"], ...] = ()
    names: tuple[str, ...] = ()  # of objects and groups, as "object/group"
    polygon_names: Int[np.ndarray, " p"] | None = None  # for each polygon an index into `names`, or None without names
    polyline_names: tuple[str, ...] = ()  # for each curve the name of its first piece
    appearance: Appearance | None = None  # materials and textures, or None if the file has none
    several: tuple[str, ...] = ()  # "texture coordinates" or "normals", where a vertex has several, so no attribute
    # texture coordinates where a vertex has several, and the index into them of each corner of the faces that were read
    corner_uv: tuple[Float[np.ndarray, "n k"], Int[np.ndarray, " c"]] | None = None
    unit: str = ""  # of lengths, one of `METRES`, if the format has units
    # the places of vertices that are NaN or infinite, as "line 12", by index, as far as they are known
    nonfinite_places: Mapping[int, str] = field(default_factory=dict)
    stored: Stored | None = None  # the positions that new vertices get in the file
    is_text_stl: bool = False  # whether an STL file is to be written as text, with all digits
    notes: tuple[str, ...] = ()  # sentences on changes after reading
    suffix: str = ""  # the format that was read, as ".obj", or "" where the contents were changed
    # the bytes of the file that was read, with new elements after its own
    appended: Callable[[MeshExtension], bytes] | None = None

    @property
    def loop_of_faces(self) -> Int[np.ndarray, " p"]:
        """The index of each polygon's loop, −1 for those that fill none."""
        return np.full(len(self.polygons), -1) if self.face_loops is None else self.face_loops

    @classmethod
    def without_faces(cls, vertices: np.ndarray, *polylines: np.ndarray) -> FileContents:
        """Points and curves alone."""
        none = Polygons.of_triangles(np.zeros((0, 3), dtype=np.int64))
        return cls(vertices=vertices, polygons=none, representatives=np.arange(len(vertices)), polylines=polylines)

    @property
    def srgb(self) -> Float[np.ndarray, "v 3"] | None:
        """The colours of the vertices in sRGB, 0 to 1, with those of their materials, or None without colours."""
        colors = self.attributes.get("color")
        if (colors is None or colors.shape[1] < 3) and self.tint is None:
            return None
        shown = np.ones((len(self.vertices), 3)) if colors is None else np.clip(colors[:, :3] / self.color_scale, 0, 1)
        if self.tint is None:
            return srgb_of(shown) if self.has_linear_colors else shown
        shown[: len(self.tint)] *= self.tint
        return srgb_of(shown)

    def with_colors(self, *, linear: bool) -> FileContents:
        """The contents with "color" proportional to light, or in sRGB. A fourth column, opacity, is not changed."""
        if linear == self.has_linear_colors or "color" not in self.attributes:
            return self
        colors = self.attributes["color"] / self.color_scale
        colors[:, :3] = (linear_of if linear else srgb_of)(colors[:, :3])
        attributes = {**self.attributes, "color": colors * self.color_scale}
        return replace(self, attributes=attributes, has_linear_colors=linear)

    def split(self) -> FileContents:
        """The contents with the attribute "uv" in place of `corner_uv`: its vertices have one "uv" each.

        A vertex that has several keeps its index for one of them and is repeated after the others. All corners of a
        new face have the texture coordinates of the old vertex nearest to its centre, so that it has one colour.
        """
        if self.corner_uv is None:
            return self
        (table, own), corners = self.corner_uv, self.polygons.corners
        if len(corners) > len(own):
            new = corners[len(own) :].reshape(-1, 3)
            own = np.append(own, np.repeat(nearest_rows(own, corners[: len(own)], self.vertices, new), 3))
        pairs, pair_of = np.unique(corners * len(table) + own, return_inverse=True)
        vertex, row = np.divmod(pairs, len(table))
        repeated = np.diff(vertex, prepend=-1) == 0
        place = np.where(repeated, len(self.vertices) - 1 + np.cumsum(repeated), vertex)
        source = np.append(np.arange(len(self.vertices)), vertex[repeated])
        uv = np.zeros((len(source), table.shape[1]))
        uv[place] = table[row]
        return replace(
            self,
            vertices=self.vertices[source],
            polygons=Polygons(corners=place[pair_of], starts=self.polygons.starts),
            attributes={**{name: values[source] for name, values in self.attributes.items()}, "uv": uv},
            representatives=self.representatives[source],
            several=tuple(what for what in self.several if what != UV),
            corner_uv=None,
        )


def nearest_rows(
    rows: Int[np.ndarray, "c *k"], corners: Int[np.ndarray, " c"], vertices: Float[np.ndarray, "v 3"], new: np.ndarray
) -> Int[np.ndarray, "n *k"]:
    """For each new triangle (n, 3) what `rows` has for the corner of old faces that is nearest to its centre."""
    from scipy.spatial import KDTree  # slow to import

    used, first = np.unique(corners, return_index=True)
    nearest = KDTree(vertices[used]).query(vertices[new].mean(axis=1))[1]
    return np.asarray(rows[first[nearest]])


def malformed(place: str, problem: str, advice: str = "check that the file is complete") -> MeshFileError:
    """The error for a file that cannot be read: the place, as "line 12", what is wrong, and what to do."""
    if len(problem) > LONGEST_PROBLEM:
        problem = f"{problem[: LONGEST_PROBLEM // 2]} ... {problem[-LONGEST_PROBLEM // 2 :]}"
    return MeshFileError(f"{place}{': ' if place else ''}{problem}; {advice}", place=place)


def text_rows(*tables: Real[np.ndarray, "n _"]) -> list[str]:
    """Tables side by side as text, a line for each row, with all digits."""
    columns = [list(map(repr, column.tolist())) for table in tables for column in table.T]
    return list(map(" ".join, zip(*columns, strict=True)))


def srgb_of(linear: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Colours proportional to light, 0 to 1, in sRGB."""
    return np.asarray(np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055))


def linear_of(srgb: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """The inverse of `srgb_of`."""
    return np.asarray(np.where(srgb <= 0.04045, srgb / 12.92, (np.maximum(srgb, 0) / 1.055 + 0.055 / 1.055) ** 2.4))


def color_scale_of(values: np.ndarray) -> float:
    """Full intensity in colours given as real numbers: 1, or 255 if one of them is larger than 1."""
    return 255.0 if np.fmax.reduce(values, axis=None, initial=0.0) > 1.0 else 1.0


def real_numbers(words: Sequence[bytes]) -> list[float]:
    """Words as numbers. Raises a ValueError if one is not a number, or has underscores (which `float` allows)."""
    if b"_" in b"".join(words):
        raise ValueError("underscore")
    try:
        return list(map(float, words))
    except ValueError:
        return [float(_NO_NUMBER.sub(b"nan", word)) for word in words]


def convert_words(
    words: Sequence[bytes],
    convert: Callable[[Sequence[bytes]], list[Value]],
    error: Callable[[int, str], MeshFileError],
) -> list[Value]:
    """Words converted all at once. If that fails, raises `error` of the index and the text of the first wrong word."""
    try:
        return convert(words)
    except ValueError:
        number = first_unreadable(words, convert)
        raise error(number, words[number].decode("utf-8", "replace")) from None


def first_unreadable(items: Sequence[Value], convert: Callable[[list[Value]], object]) -> int:
    """The index of the first item that cannot be converted by itself."""

    def fails(item: Value) -> bool:
        try:
            convert([item])
        except (ValueError, OverflowError):
            return True
        return False

    return next(number for number, item in enumerate(items) if fails(item))


def is_held_in_single_precision(contents: FileContents, positions: Float[np.ndarray, "v 3"]) -> bool:
    """Whether single precision holds the vertices of a mesh's faces at some positions.

    Different vertices must stay different, and each edge must change by at most `MOST_CHANGE` of its length. Edges of
    new faces may change more if the vertices of all others do not change: their mesh was in single precision before.
    Raises as `single_precision`.
    """
    corners = contents.polygons.corners
    is_old = np.repeat(contents.loop_of_faces < 0, contents.polygons.sizes)
    used, old = (
        np.flatnonzero(referenced_vertices(some, vertices=len(positions))) for some in (corners, corners[is_old])
    )
    single_precision(positions[used])  # raises
    with np.errstate(over="ignore"):
        rounded = positions.astype(np.float32).astype(np.float64)
    # new vertices at one position may have been rounded before
    new = np.setdiff1d(contents.representatives[corners], contents.representatives[corners[is_old]])
    wanted = len(np.unique(coincident_vertices(positions[old]))) + len(new)
    if len(np.unique(coincident_vertices(rounded[used]))) < wanted:
        return False
    following = np.arange(1, len(corners) + 1)
    following[contents.polygons.starts[1:] - 1] = contents.polygons.starts[:-1]
    if not is_old.all() and np.array_equal(rounded[corners[is_old]], positions[corners[is_old]]):
        return True
    # as fractions of the longest edge, because squares of lengths may overflow
    edges = positions[corners] - positions[corners[following]]
    longest = np.abs(edges).max(initial=0.0) or 1.0
    change = (rounded[corners] - rounded[corners[following]] - edges) / longest
    return bool((np.linalg.norm(change, axis=1) <= MOST_CHANGE * np.linalg.norm(edges / longest, axis=1)).all())


def single_precision(values: np.ndarray) -> np.ndarray:
    """Finite numbers rounded to float32, for formats without float64. Raises a MeshFileError if one is too large."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest > float(np.finfo(np.float32).max):
        raise MeshFileError(
            f"a number of magnitude {largest:.3g} is too large for the 32-bit numbers of this format; "
            "write .obj, .ply or .off, or scale the mesh"
        )
    return values.astype(np.float32)
