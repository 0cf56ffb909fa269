"""Mesh files: OBJ, PLY, STL, OFF and GLB, read without loss and written with patches appended; others by libraries."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from spinor_geom.adapters.contents import FileContents, malformed, nonfinite_rows
from spinor_geom.adapters.glb import encode_glb, names_in_glb, read_glb
from spinor_geom.adapters.library_files import LIBRARIES, encode_3mf, encode_vtk, read_3mf, read_vtk
from spinor_geom.adapters.obj import encode_obj, read_obj
from spinor_geom.adapters.off import encode_off, read_off
from spinor_geom.adapters.ply import encode_ply, names_in_ply, read_ply
from spinor_geom.adapters.polygon_faces import Polygons, close_seams
from spinor_geom.adapters.stl import encode_stl, read_stl
from spinor_geom.adapters.vertex_data import grown_attributes
from spinor_geom.errors import (
    MeshError,
    MeshFileError,
    NonFiniteVertexError,
    UnknownMeshTypeError,
    require,
    require_type,
)
from spinor_geom.files import atomic_path
from spinor_geom.mesh.triangle_mesh import MeshExtension, TriangleMesh, Within
from spinor_geom.shown import Shown, shortened

# how each is read, where a MeshFileError names the place that cannot be, and written
FORMATS: dict[str, tuple[Callable[[bytes], FileContents], Callable[[FileContents], bytes]]] = {
    ".obj": (read_obj, encode_obj),
    ".ply": (read_ply, encode_ply),
    ".stl": (read_stl, encode_stl),
    ".off": (read_off, encode_off),
    ".glb": (read_glb, encode_glb),
    ".vtp": (partial(read_vtk, suffix=".vtp"), partial(encode_vtk, suffix=".vtp")),
    ".vtk": (partial(read_vtk, suffix=".vtk"), partial(encode_vtk, suffix=".vtk")),
    ".3mf": (read_3mf, encode_3mf),
}
# which attributes a new file of a format that names them can hold, with their names there
_NAMES: dict[str, Callable[[FileContents], Mapping[str, object]]] = {".ply": names_in_ply, ".glb": names_in_glb}
# the only attributes that the other formats have a place for
_PLACES = {".obj": ("color", "uv", "normal"), ".off": ("color",), ".stl": (), ".3mf": ()}


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshFile(Shown):
    """A mesh file in memory: what it holds, its triangles, and what was appended to it.

    Written in the format it was read from, a file keeps everything that was in it byte for byte (in GLB: every
    element; in VTK's formats and 3MF: what their libraries read), and new elements follow the old ones. Written in
    another format it keeps vertices, faces, curves and those attributes that the format has a place for.

    Attributes:
        path: where it was read from, or None.
        contents: vertices, polygons, attributes and curves, old and new.
        mesh: the triangles: polygons split, and closed along texture and normal seams.
        face_polygons: (F,) int64, the number of the polygon that each triangle of `mesh` comes from.
        read_sizes: how many vertices and faces the file had when it was read; those that follow were appended.
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
        """Split the polygons and close the seams; without `read_sizes` nothing counts as appended."""
        wrong = nonfinite_rows(contents.vertices)
        if len(wrong):
            raise NonFiniteVertexError(vertex=int(wrong[0]), place=contents.first_nonfinite)
        triangles, polygons = contents.polygons.triangulated(contents.vertices)
        faces, kept = close_seams(triangles, contents.representatives)
        mesh = TriangleMesh(contents.vertices, faces, vertex_attributes=contents.attributes, labels=contents.labels)
        return cls(
            path=path,
            contents=contents,
            mesh=mesh,
            face_polygons=polygons[kept],
            read_sizes=read_sizes or (len(contents.vertices), len(contents.polygons)),
        )

    @property
    def polygons(self) -> Polygons:
        """The faces as the file has them, quads and polygons whole."""
        return self.contents.polygons

    @property
    def polylines(self) -> tuple[Int[np.ndarray, " _"], ...]:
        """The curves in the file, (k,) vertex indices each; a closed one ends with the vertex it begins with."""
        return self.contents.polylines

    def extended(self, extension: MeshExtension) -> MeshFile:
        """The file with new vertices and faces after its own; this object stays as it is. Raises as `extend`."""
        old = self.contents
        first = len(old.vertices)
        contents = replace(
            old,
            vertices=np.concatenate([old.vertices, extension.vertices]),
            polygons=old.polygons.followed_by(extension.faces),
            face_loops=np.append(old.loop_of_faces, extension.face_loops),
            attributes=grown_attributes(old.attributes, extension, vertices=first),
            representatives=np.append(old.representatives, np.arange(first, first + len(extension.vertices))),
        )
        return MeshFile.of_contents(contents, path=self.path, read_sizes=self.read_sizes)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was changed on the way from the file, a sentence each."""
        return self.contents.notes

    def merged(self, within: Within = 0.0) -> MeshFile:
        """The file with vertices of equal position merged, as soups need; `notes` counts them.

        `within` is the largest distance of such vertices, as for `TriangleMesh.merged`.

        Of each group the vertex of lowest index stays, with its attributes. Polygons lose corners that now repeat the
        one before, those of fewer than three corners (needles) are left out; curves stay whole. Such a file no longer
        follows the one that was read: it is written anew, without materials and what else is not in `contents`.
        """
        mesh, new_index = TriangleMesh(
            self.contents.vertices,
            self.contents.polygons.triangulated(self.contents.vertices)[0],
            vertex_attributes=self.contents.attributes,
        ).merged(within)
        polygons = self.contents.polygons.renumbered(new_index).without_repeats()
        before, after = len(new_index), len(mesh.vertices)
        needles = len(self.polygons) - len(polygons)
        moved = float(np.linalg.norm(mesh.vertices[new_index] - self.contents.vertices, axis=1).max(initial=0.0))
        up_to = f" up to {moved:.2g}" if moved else ""
        notes = [f"vertices of equal position{up_to} were merged: {before} became {after}"] if after < before else []
        notes += [f"faces left out as two of their corners are one: {needles}"] if needles else []
        contents = replace(
            self.contents,
            vertices=mesh.vertices,
            polygons=polygons,
            attributes=mesh.vertex_attributes,
            representatives=np.arange(len(mesh.vertices)),
            face_loops=None,
            polylines=tuple(new_index[curve] for curve in self.contents.polylines),
            notes=(*self.notes, *notes),
            suffix="",
        )
        return MeshFile.of_contents(contents, path=self.path)

    def write(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """Write the file, in the format that the suffix of `path` names.

        The file appears complete or not at all, and after an error an old file of that name is as it was.

        Returns:
            A sentence for each attribute that was left out because the format has no place for it, or cannot write its
            name or its width.

        Raises:
            MeshFileError: no known format, or the file cannot be written.
            MissingPackageError: the library of the format is not installed.
        """
        target = Path(path)
        suffix = known_suffix(target)
        data = self._encoded(suffix)
        try:
            with atomic_path(target) as temporary:
                temporary.write_bytes(data)
        except OSError as error:
            raise MeshFileError(f"{target}: cannot be written ({error}); check the folder", path=target) from error
        return tuple(f"{target}: {said}" for said in self.left_out(suffix))

    def left_out(self, suffix: str) -> tuple[str, ...]:
        """A sentence for each attribute that a file of a format (such as ".ply") cannot hold."""
        if self._follows(suffix):
            return ()
        if suffix in _NAMES:
            kept = tuple(_NAMES[suffix](self.contents))
            why = "cannot hold its name, a second of that name, or so many columns; rename it"
        else:
            kept, why = _PLACES.get(suffix, tuple(self.contents.attributes)), "have no place for it"
        advice = f"left out: {suffix} files {why}"
        return tuple(f"the attribute {name!r} is {advice}" for name in self.contents.attributes if name not in kept)

    def _follows(self, suffix: str) -> bool:
        """Whether a file of a format is the one that was read, and what was appended."""
        return self.contents.appended is not None and self.contents.suffix == suffix

    def _encoded(self, suffix: str) -> bytes:
        if self.contents.appended is None or not self._follows(suffix):
            return FORMATS[suffix][1](self.contents)
        vertices, faces = self.read_sizes
        new = self.contents.polygons.corners[self.contents.polygons.starts[faces] :].reshape(-1, 3)
        return self.contents.appended(
            MeshExtension(
                vertices=self.contents.vertices[vertices:],
                faces=new,
                face_loops=self.contents.loop_of_faces[faces:],
                vertex_attributes={name: values[vertices:] for name, values in self.contents.attributes.items()},
            )
        )


def read_mesh(path: str | os.PathLike[str]) -> MeshFile:
    """Read a mesh file.

    OBJ faces are read by position, so texture seams leave no trace; in PLY, OFF, GLB and VTK's formats, vertices that a
    renderer's format split along texture or normal seams are closed up again in `MeshFile.mesh`. STL, which cannot
    share vertices, is read with those of equal position, up to single precision, merged as by `MeshFile.merged`. No
    other file is opened.

    Args:
        path: a file whose suffix is .obj, .ply, .stl, .off, .glb, .vtp, .vtk or .3mf, in any case.

    Raises:
        ArgumentTypeError: `path` is no path.
        MeshFileError: no such file, no known format, or malformed; names the file and the place in it.
        NonFiniteVertexError: a coordinate is NaN or infinite.
        MissingPackageError: the library that reads this format (.vtp, .vtk, .3mf) is not installed.
    """
    takes = "the path of a mesh file (fill_hole and to_mesh take meshes of every type)"
    require_type(path, (str, os.PathLike), function="read_mesh", takes=takes)
    source = Path(path)
    if source.is_dir():
        raise MeshFileError(f"{source}: is a folder; name a file in it", path=source)
    suffix = known_suffix(source)
    with naming(source):
        try:
            data = source.read_bytes()
        except OSError as error:
            problem = f"cannot be read ({error.strerror or error})"
            raise malformed("", problem, "check the name and the access rights") from error
        return mesh_of_bytes(data, suffix, path=source)


def mesh_of_bytes(data: bytes, suffix: str, *, path: Path | None = None) -> MeshFile:
    """What `read_mesh` gives for a file of these bytes; its errors, which do not name the file."""
    require_bytes(data)
    file = MeshFile.of_contents(FORMATS[suffix][0](data), path=path)
    if suffix == ".stl":
        file = file.merged("rounding")
    require_elements(file.contents)
    return file


def require_bytes(data: bytes) -> None:
    """A MeshFileError for a file without bytes."""
    if not data:
        raise malformed("", "is empty", "check that the file is complete")


def require_elements(contents: FileContents) -> None:
    """A MeshFileError for a file of points alone."""
    if len(contents.polygons) == 0 and not contents.polylines:
        raise malformed("", "has vertices but no faces and no curves", "give a file with a surface in it")


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Errors of what is read inside name the file, before the place in it."""
    try:
        yield
    except NonFiniteVertexError as error:
        place = ", ".join(filter(None, (str(path), error.fields["place"])))
        raise NonFiniteVertexError(vertex=error.fields["vertex"], place=place) from None
    except (MeshFileError, MeshError, UnknownMeshTypeError) as error:
        place = error.fields.get("place", "")
        raise MeshFileError(f"{path}{', ' if place else ': '}{error}", path=path, place=place) from error


class MeshFileAdapter:
    """`MeshFile`, and paths of mesh files."""

    name = f"the path of a mesh file ({', '.join(FORMATS)}), or the MeshFile that read_mesh gives"
    types = ("spinor_geom.MeshFile", "pathlib.PurePath", "builtins.str")

    def to_mesh(self, obj: MeshFile | str | os.PathLike[str]) -> TriangleMesh:
        """The triangles of the file; a MeshFileError if it is missing or malformed."""
        return _opened(obj).mesh

    def extend(self, obj: Any, extension: MeshExtension) -> MeshFile:
        """The file with the extension appended, as a `MeshFile`; nothing is written."""
        return _opened(obj).extended(extension)

    def merged(self, obj: Any, within: Within) -> MeshFile:
        """The file with vertices merged, as by `MeshFile.merged`; nothing is written."""
        return _opened(obj).merged(within)


def _opened(obj: MeshFile | str | os.PathLike[str]) -> MeshFile:
    return obj if isinstance(obj, MeshFile) else read_mesh(obj)


def known_suffix(path: Path) -> str:
    """The suffix of a file in small letters; raises, as `read_mesh`, where there is no such format or library."""
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        problem = f"'{path.suffix}' is no known format"
        raise MeshFileError(f"{path}: {problem}; use one of {', '.join(FORMATS)}", path=path, place="")
    for package in LIBRARIES.get(suffix, ()):
        require(package, extra="formats")
    return suffix
