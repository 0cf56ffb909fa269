"""Mesh files of all formats: read, extended, and written."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import UV, FileContents, is_held_in_single_precision, malformed
from spinor_geom.adapters.glb import encode_glb, glb_offset, names_in_glb, read_glb, stored_in_glb
from spinor_geom.adapters.library_files import encode_vtk, read_vtk
from spinor_geom.adapters.obj import read_obj
from spinor_geom.adapters.obj_writing import OWN_GROUP, encode_obj, material_library
from spinor_geom.adapters.off import encode_off, read_off
from spinor_geom.adapters.ply import encode_ply, names_in_ply, read_ply
from spinor_geom.adapters.polygon_faces import Polygons, close_seams
from spinor_geom.adapters.stl import encode_stl, read_stl, stored_in_stl
from spinor_geom.adapters.textures import Appearance, Companions, Texture, Textured, write_beside
from spinor_geom.adapters.threemf import encode_3mf, read_3mf
from spinor_geom.adapters.vertex_data import append_attributes
from spinor_geom.errors import MeshError, MeshFileError, NonFiniteVertexError, PrecisionError, require, require_type
from spinor_geom.files import atomic_path, regular_file, safe_name, together
from spinor_geom.mesh.array_checks import nonfinite_rows, with_finite_rows
from spinor_geom.mesh.topology import coincident_vertices
from spinor_geom.mesh.triangle_mesh import MeshExtension, Stored, TriangleMesh, Within, require_finite
from spinor_geom.shown import Shown, shortened


class Format(NamedTuple):
    """How files of one format are read and written."""

    read: Callable[[bytes], FileContents]
    encode: Callable[[FileContents], bytes]
    names: Callable[[FileContents], Collection[str]]  # the attributes that a new file can hold
    packages: tuple[str, ...] = ()  # required besides those of the project
    holds_nan: bool = True  # whether positions may be NaN or infinite
    stored: Callable[[FileContents], Stored | None] = lambda contents: None  # the positions in a new file, if rounded


_attributes = attrgetter("attributes")
TEXTURED = (".obj", ".ply", ".glb")  # formats of new files with a texture
FORMATS = {
    ".obj": Format(read_obj, encode_obj, lambda contents: ("color", "uv", "normal")),
    ".ply": Format(read_ply, encode_ply, names_in_ply),
    ".stl": Format(read_stl, encode_stl, lambda contents: (), stored=stored_in_stl),
    ".off": Format(read_off, encode_off, lambda contents: ("color",)),
    ".glb": Format(read_glb, encode_glb, names_in_glb, holds_nan=False, stored=stored_in_glb),
    **{
        name: Format(partial(read_vtk, suffix=name), partial(encode_vtk, suffix=name), _attributes, ("pyvista",), nan)
        for name, nan in ((".vtp", False), (".vtk", True))
    },
    ".3mf": Format(read_3mf, encode_3mf, lambda contents: (), holds_nan=False),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshFile(Shown):
    """A mesh file in memory: its contents, its triangles, and appended elements.

    If it is written in the format that was read, all bytes are kept (GLB: all elements; VTK's formats: what its library
    reads; 3MF: the meshes and their positions), and new elements follow the old ones. In another format, vertices,
    faces, curves and the attributes that the format supports are kept.

    Attributes:
        path: the file that was read, or None.
        contents: vertices, polygons, attributes and curves, old and new.
        mesh: the triangles: polygons split, and closed along texture and normal seams.
        face_polygons: (F,) int64, the index of the polygon of each triangle of `mesh`.
        read_sizes: the numbers of vertices and faces that were read. Those that follow were appended.
    """

    path: Path | None
    contents: FileContents
    mesh: TriangleMesh
    face_polygons: Int[np.ndarray, " f"]
    read_sizes: tuple[int, int]

    def __repr__(self) -> str:
        name = "" if self.path is None else f"{self.path.name!r}, "
        return shortened(f"MeshFile({name}{len(self.mesh.vertices)} vertices, {len(self.mesh.faces)} triangles)")

    @classmethod
    def of_contents(
        cls, contents: FileContents, *, path: Path | None, read_sizes: tuple[int, int] | None = None
    ) -> MeshFile:
        """Splits the polygons and closes the seams. Without `read_sizes` nothing counts as appended."""
        triangles, polygons = contents.polygons.triangulated(contents.vertices)
        require_finite(
            contents.vertices, contents.polygons.corners, contents.polygons.starts, contents.nonfinite_places
        )
        faces, kept = close_seams(triangles, contents.representatives)
        attributes, labels, stored = contents.attributes, contents.labels, contents.stored
        return cls(
            path=path,
            contents=contents,
            mesh=TriangleMesh(contents.vertices, faces, vertex_attributes=attributes, labels=labels, stored=stored),
            face_polygons=polygons[kept],
            read_sizes=read_sizes or (len(contents.vertices), len(contents.polygons)),
        )

    @property
    def polygons(self) -> Polygons:
        """The faces of the file, with undivided quads and polygons."""
        return self.contents.polygons

    def extended(self, extension: MeshExtension) -> MeshFile:
        """A new file with vertices and faces appended. Raises as `extend`."""
        old = self.contents
        first = len(old.vertices)
        contents = replace(
            old,
            vertices=np.concatenate([old.vertices, extension.vertices]),
            polygons=old.polygons.followed_by(extension.faces),
            polygon_names=None,
            face_loops=np.append(old.loop_of_faces, extension.face_loops),
            attributes=append_attributes(old.attributes, extension, vertices=first),
            representatives=np.append(old.representatives, np.arange(first, first + len(extension.vertices))),
        )
        return MeshFile.of_contents(contents, path=self.path, read_sizes=self.read_sizes)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on changes after reading."""
        return self.contents.notes

    def merged(self, within: Within = 0.0) -> MeshFile:
        """A new file with vertices of equal position merged, for files whose faces do not share vertices.

        Of each group the vertex of lowest index is kept, with its attributes. Corners of polygons that are equal to the
        one before are removed, and so are polygons of fewer than three corners. `notes` has their numbers. Curves do
        not change. Materials and other data outside `contents` are not written. `within` is the largest distance of
        merged vertices, as for `TriangleMesh.merged`.
        """
        mesh, new_index = TriangleMesh(
            self.contents.vertices,
            self.polygons.triangulated(self.contents.vertices)[0],
            vertex_attributes=self.contents.attributes,
        ).merged(within)
        polygons = self.polygons.renumbered(new_index).without_repeats()
        before, after = len(new_index), len(mesh.vertices)
        degenerate = len(self.polygons) - len(polygons)
        pairs = np.stack([mesh.vertices[new_index], self.contents.vertices])
        pairs = pairs[:, np.isfinite(pairs[1]).all(axis=1)]
        moved = float(np.linalg.norm(pairs[0] - pairs[1], axis=1).max(initial=0.0))
        up_to = f" up to {moved:.2g}" if moved else ""
        notes = [f"vertices of equal position{up_to} were merged: {before} became {after}"] if after < before else []
        notes += [f"degenerate faces were removed after merging: {degenerate}"] if degenerate else []
        contents = replace(
            self.contents,
            vertices=mesh.vertices,
            polygons=polygons,
            attributes=mesh.vertex_attributes,
            representatives=np.arange(len(mesh.vertices)),
            face_loops=None,
            polylines=tuple(new_index[curve] for curve in self.contents.polylines),
            notes=(*self.notes, *notes),
            corner_uv=None,
            tint=None,
            suffix="",
        )
        return MeshFile.of_contents(contents, path=self.path)

    def as_stored(self, suffix: str) -> MeshFile:
        """The file with the positions that a file of a format (such as ".stl") has, so that what is filled is written.

        Raises a PrecisionError if single precision does not hold the mesh.
        """
        stored = None if suffix not in FORMATS or self._follows(suffix) else FORMATS[suffix].stored(self.contents)
        if stored is None:
            return self
        vertices = stored(self.contents.vertices, np.zeros(0, dtype=np.int64))
        contents = replace(self.contents, vertices=vertices, stored=stored)
        return MeshFile.of_contents(contents, path=self.path, read_sizes=self.read_sizes)

    def write(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """Writes the file in the format of the suffix of `path`. After an error an old file of that name is unchanged.

        Returns:
            A sentence for each attribute that the format cannot hold, and for positions that are stored otherwise.

        Raises:
            MeshFileError: no known format, or the file cannot be written.
            PrecisionError: single precision (.stl, .glb) does not hold the mesh.
            MissingPackageError: the library of the format is not installed.
        """
        target = Path(path)
        suffix = known_suffix(target)
        file, notes = self._with_uv_for(suffix)
        told, files, texture = file._appearance_in(suffix)
        notes = [*file._left_out(suffix), *told, *notes]
        if texture is not None:
            name = safe_name([target.stem]) + PurePosixPath(texture.name).suffix
            texture = replace(texture, name=name)
            data = encoded(replace(file.contents, appearance=Appearance(texture=texture)), suffix)
            if suffix != ".glb":
                files = {name: texture.data}
            if suffix == ".obj":
                files[f"{safe_name([target.stem])}.mtl"] = material_library(texture)
        else:
            data = file._encoded(suffix)
        try:
            with together():
                with atomic_path(target) as temporary:
                    temporary.write_bytes(data)
                for name, content in files.items():
                    notes += write_beside(target.parent, name, content)
        except OSError as error:
            raise MeshFileError(f"{target}: cannot be written ({error}); check the folder", path=target) from error
        return tuple(f"{target}: {note}" for note in notes)

    def _appearance_in(self, suffix: str) -> tuple[list[str], dict[str, bytes], Texture | None]:
        """For a file of a format: what is lost of the materials, files to copy, and the texture for a new file."""
        appearance, follows = self.contents.appearance, self._follows(suffix)
        added = len(self.polygons) > self.read_sizes[1]
        why = "some vertices have several"
        notes = [
            f"the new faces have no {what}: {why}" if follows else f"the {what} are left out: {why}"
            for what in self.contents.several
            if (added or not follows) and not (follows and what == UV and self.contents.corner_uv is not None)
        ]
        if appearance is None:
            return notes, {}, None
        named = Companions.of(self.path and self.path.parent, appearance)
        if follows:
            return notes + named.notes, named.files, None
        texture = appearance.texture or named.texture
        if texture is not None and texture.media_type and suffix in TEXTURED and "uv" in self.contents.attributes:
            return notes + named.without(appearance.others), {}, texture
        reason = "only a single image of colours can be converted"
        if suffix not in TEXTURED:
            reason = f"{suffix} files hold none"
        elif "uv" not in self.contents.attributes:
            reason = "vertices have no texture coordinates of their own"
        return [*notes, *named.notes, f"the materials and textures are left out: {reason}"], {}, None

    def textured(self, largest: int) -> Textured | None:
        """The only texture, and its coordinates at the corners of the triangles of `mesh`, or None without a texture.

        Raises a MeshFileError if there are several, or an image was not read, and as `Texture.pixels`.
        """
        contents, appearance = self.contents.split(), self.contents.appearance
        if appearance is None or contents.attributes.get("uv", np.zeros((0, 0))).shape[1] < 2:
            return None
        named = Companions.of(self.path and self.path.parent, appearance)
        texture = appearance.texture or named.texture
        if texture is None:
            if not named.colours and not appearance.has_several:
                return None
            problem = "; ".join(named.notes)
            raise MeshFileError(problem or "only a single texture can be shown; join the images into one")
        triangles, _ = contents.polygons.triangulated(contents.vertices)
        _, kept = close_seams(triangles, contents.representatives)
        return texture.pixels(largest), contents.attributes["uv"][triangles[kept], :2]

    def _with_uv_for(self, suffix: str) -> tuple[MeshFile, list[str]]:
        """The file with texture coordinates of corners at vertices, if a format needs that, and sentences about it."""
        if self.contents.corner_uv is None or suffix not in TEXTURED:
            return self, []
        note = f"each new face has the colour of the nearest old vertex, because some have several {UV}"
        notes = [note] * (len(self.polygons) > self.read_sizes[1])
        return self if self._follows(suffix) else replace(self, contents=self.contents.split()), notes

    def left_out(self, suffix: str) -> tuple[str, ...]:
        """A sentence for each attribute that a file of a format (such as ".ply") cannot hold, and as for `write`."""
        if suffix not in FORMATS:
            return ()
        file, notes = self._with_uv_for(suffix)
        return (*file._left_out(suffix), *file._appearance_in(suffix)[0], *notes)

    def _left_out(self, suffix: str) -> tuple[str, ...]:
        if self._follows(suffix):
            return ()
        kept = FORMATS[suffix].names(self.contents)
        why = f"left out: {suffix} files do not support it, its name, or its number of columns"
        notes = [f"the attribute {name!r} is {why}" for name in self.contents.attributes if name not in kept]
        if sum(bool(name) and not OWN_GROUP.search(name) for name in self.contents.names) > 1:
            notes.append("the names of objects and groups are left out")
        if not FORMATS[suffix].holds_nan and len(nonfinite_rows(self.contents.vertices)):
            notes.append(f"NaN and infinite positions are those of other vertices: {suffix} files hold no such numbers")
        added = self.contents.vertices[self.read_sizes[0] :]
        stored = FORMATS[suffix].stored(self.contents) if len(added) else None
        if stored is not None and not np.array_equal(stored(added, np.zeros(0, dtype=np.int64)), added):
            notes.append(
                "the new vertices were rounded to 32-bit numbers after the search for intersections: fill what "
                f"MeshFile.as_stored({suffix!r}) returns for a report on the rounded ones"
            )
        if suffix == ".glb" and (offset := glb_offset(self.contents)).any():
            place = ", ".join(f"{x:.17g}" for x in offset.tolist())
            notes.append(f"the positions are relative to ({place}), the translation of the node, for lack of digits")
        return tuple(notes)

    def _follows(self, suffix: str) -> bool:
        """Whether a file of this format is written as the file that was read, with new elements appended."""
        return self.contents.appended is not None and self.contents.suffix == suffix

    def _encoded(self, suffix: str) -> bytes:
        if self.contents.appended is None or not self._follows(suffix):
            return encoded(self.contents, suffix)
        vertices, faces = self.read_sizes
        new = self.contents.polygons.corners[self.contents.polygons.starts[faces] :].reshape(-1, 3)
        data = self.contents.appended(
            MeshExtension(
                vertices=self.contents.vertices[vertices:],
                faces=new,
                face_loops=self.contents.loop_of_faces[faces:],
                vertex_attributes={name: values[vertices:] for name, values in self.contents.attributes.items()},
            )
        )
        old = self.contents.vertices[:vertices]
        with np.errstate(over="ignore"):
            may_be_single = np.array_equal(old.astype(np.float32), old, equal_nan=True)
        # only then may the file's own numbers, if they are no text, be too short for the new vertices
        is_short = self.contents.stored and may_be_single
        if is_short and not is_held_in_single_precision(self.contents, self.contents.vertices):
            held, wanted = (
                len(np.unique(coincident_vertices(file.vertices)[file.polygons.corners]))
                for file in (FORMATS[suffix].read(data), self.contents)
            )
            if held < wanted:
                raise PrecisionError(suffix=suffix)
        return data


def encoded(contents: FileContents, suffix: str) -> bytes:
    """The bytes of a new file of a format. Raises as `MeshFile.write`."""
    if not FORMATS[suffix].holds_nan:
        contents = replace(contents, vertices=with_finite_rows(contents.vertices, contents.polygons.corners))
    return FORMATS[suffix].encode(contents.with_colors(linear=suffix == ".glb"))


def read_mesh(path: str | os.PathLike[str]) -> MeshFile:
    """Reads a mesh file.

    `MeshFile.mesh` is closed along texture and normal seams: OBJ faces are read by position, and in PLY, OFF, GLB and
    VTK's formats vertices of equal position are joined along seams. STL, which cannot share vertices, is read with
    vertices merged that are equal up to single precision. No other file is opened.

    Args:
        path: a file whose suffix is .obj, .ply, .stl, .off, .glb, .vtp, .vtk or .3mf, in any case.

    Raises:
        ArgumentTypeError: `path` is not a path.
        MeshFileError: no such file, no known format, or malformed. It names the file and the place.
        NonFiniteVertexError: a coordinate of a vertex that a face uses is NaN or infinite.
        MissingPackageError: the library that reads this format (.vtp, .vtk) is not installed.
    """
    takes = "the path of a mesh file (fill_hole and to_mesh take meshes of every type)"
    require_type(path, (str, os.PathLike), function="read_mesh", takes=takes)
    source = Path(path)
    if source.is_dir():
        raise MeshFileError(f"{source}: is a folder; give the path of a file", path=source)
    suffix = known_suffix(source)
    with path_in_errors(source):
        try:
            data = regular_file(source).read_bytes()
        except OSError as error:
            problem = f"cannot be read ({error.strerror or error})"
            raise malformed("", problem, "check the name and the access rights") from error
        return mesh_of_contents(contents_of_bytes(data, suffix), suffix, path=source)


def mesh_of_contents(contents: FileContents, suffix: str, *, path: Path | None = None) -> MeshFile:
    """The file with these contents, the vertices of STL merged. Raises a MeshFileError without faces and curves."""
    file = MeshFile.of_contents(contents, path=path)
    file = file.merged("rounding") if suffix == ".stl" else file
    if len(file.polygons) == 0 and not contents.polylines:
        raise malformed("", "has vertices but no faces and no curves", "give a file with faces")
    return file


def contents_of_bytes(data: bytes, suffix: str) -> FileContents:
    """The contents of a file. Raises a MeshFileError if it is malformed or empty."""
    if not data:
        raise malformed("", "is empty")
    return FORMATS[suffix].read(data)


@contextmanager
def path_in_errors(path: Path) -> Iterator[None]:
    """Adds the path to errors that are raised inside."""
    try:
        yield
    except NonFiniteVertexError as error:
        place = ", ".join(filter(None, (str(path), error.fields["place"])))
        raise NonFiniteVertexError(vertex=error.fields["vertex"], face=error.fields["face"], place=place) from None
    except (MeshFileError, MeshError) as error:
        place = error.fields.get("place", "")
        raise MeshFileError(f"{path}{', ' if place else ': '}{error}", path=path, place=place) from error


def write_triangles(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    path: str | os.PathLike[str],
    attributes: Mapping[str, Float[np.ndarray, "v _"]] | None = None,
) -> tuple[str, ...]:
    """Writes triangles to a new file in the format of its suffix. Returns and raises as `MeshFile.write`."""
    contents = FileContents(
        vertices=np.asarray(vertices),
        polygons=Polygons.of_triangles(np.asarray(faces)),
        attributes=attributes or {},
        representatives=np.arange(len(vertices)),
    )
    return MeshFile.of_contents(contents, path=None).write(path)


class MeshFileAdapter:
    """`MeshFile`, and paths of mesh files."""

    name = f"the path of a mesh file ({', '.join(FORMATS)}), or the MeshFile that read_mesh returns"
    types = ("spinor_geom.MeshFile", "pathlib.PurePath", "builtins.str")

    def to_mesh(self, obj: MeshFile | str | os.PathLike[str]) -> TriangleMesh:
        """The triangles of the file. Raises a MeshFileError if it is missing or malformed."""
        return _opened(obj).mesh

    def extend(self, obj: Any, extension: MeshExtension) -> MeshFile:
        """The file with the extension appended, as a `MeshFile`. Nothing is written."""
        return _opened(obj).extended(extension)

    def merged(self, obj: Any, within: Within) -> MeshFile:
        """The file with vertices merged, as by `MeshFile.merged`. Nothing is written."""
        return _opened(obj).merged(within)

    def textured(self, obj: Any, largest: int) -> Textured | None:
        """The only texture of the file. Raises as `MeshFile.textured`."""
        return _opened(obj).textured(largest)


def _opened(obj: MeshFile | str | os.PathLike[str]) -> MeshFile:
    return obj if isinstance(obj, MeshFile) else read_mesh(obj)


def known_suffix(path: Path) -> str:
    """The suffix of a file in lower case. Raises as `read_mesh` if its format or library is unknown or missing."""
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        problem = f"'{path.suffix}' is not a supported format"
        raise MeshFileError(f"{path}: {problem}; use one of {', '.join(FORMATS)}", path=path, place="")
    for package in FORMATS[suffix].packages:
        require(package, extra="render")
    return suffix
