"""3MF: all meshes of a package, at all positions in its build. Colours and materials are not read."""

from __future__ import annotations

import io
import posixpath
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias
from urllib.parse import unquote
from xml.parsers.expat import ExpatError, ParserCreate
from xml.sax.saxutils import quoteattr
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.adapters.contents import METRES, FileContents, first_unreadable, malformed
from spinor_geom.adapters.glb import MOST_ROWS, ROWS_OF_A_PRIMITIVE
from spinor_geom.adapters.polygon_faces import Polygons
from spinor_geom.errors import MeshFileError
from spinor_geom.files import MOST_RATIO, is_bomb
from spinor_geom.mesh.topology import linked
from spinor_geom.mesh.triangle_mesh import MeshExtension

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"
ROOT = "3D/3dmodel.model"
DEFAULT_UNIT = "millimeter"
DEEPEST = 100  # objects inside objects
MOST_NOTES = 5
IDENTITY = np.eye(4)[:, :3]
TYPES = {
    "rels": "application/vnd.openxmlformats-package.relationships+xml",
    "model": "application/vnd.ms-package.3dmanufacturing-3dmodel+xml",
}

_Key: TypeAlias = tuple[str, str]  # the model part of an object, and its id there
_Placed: TypeAlias = tuple[_Key, Float[np.ndarray, "4 3"]]


@dataclass(kw_only=True, eq=False)
class _Object:
    """An object of a model part: a mesh, or other objects at positions."""

    name: str
    words: list[str] = field(default_factory=list)  # the coordinates of its vertices
    corners: list[str] = field(default_factory=list)  # of its triangles
    components: list[_Placed] = field(default_factory=list)
    vertices: Float[np.ndarray, "v 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    faces: Int[np.ndarray, "f 3"] = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Instance:
    """A mesh at one position in the build. Its vertices follow each other in the scene."""

    key: _Key
    mesh: _Object
    transform: Float[np.ndarray, "4 3"]  # of rows: position @ transform[:3] + transform[3]
    start: int  # index of its first vertex in the scene

    @property
    def stop(self) -> int:
        """One more than the index of its last vertex in the scene."""
        return self.start + len(self.mesh.vertices)

    @property
    def vertices(self) -> Float[np.ndarray, "v 3"]:
        """The positions of its vertices in the scene."""
        with np.errstate(over="ignore", invalid="ignore"):  # a position that is not finite is reported later
            return np.asarray(self.mesh.vertices @ self.transform[:3] + self.transform[3])

    def oriented(self, faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f 3"]:
        """Faces in the scene's orientation, or back: reversed if the transform mirrors."""
        return faces[:, ::-1] if np.linalg.det(self.transform[:3]) < 0 else faces


class _Package:
    """The model parts of a 3MF file. Those that others refer to (`p:path`) are read on first use."""

    def __init__(self, data: bytes) -> None:
        try:
            self._zip = ZipFile(io.BytesIO(data))
        except (BadZipFile, ValueError, NotImplementedError) as error:
            raise malformed("", f"is not a ZIP archive ({error})") from error
        entries = self._zip.infolist()
        if is_bomb(sum(entry.file_size for entry in entries), len(data)):
            raise malformed("", f"unpacks to over {MOST_RATIO} times its size", "do not use it")
        self._entries = {entry.filename.lstrip("/").lower(): entry for entry in entries}
        self.unit = DEFAULT_UNIT
        self.items: list[_Placed] = []
        self.parts: dict[str, dict[str, _Object]] = {}
        self.notes: list[str] = []
        found = [name for name in self._entries if name == self._root() or name.endswith(ROOT.lower())]
        if not found:
            raise malformed("", f"has no model part {ROOT}")
        self.root = found[0]
        self.objects(self.root)

    def _root(self) -> str:
        """The name of the first model part by the relationships of the package, or "" where they do not name one."""
        targets: list[str] = []

        def start(name: str, attributes: dict[str, str]) -> None:
            if attributes.get("Type", "").endswith("/3dmodel"):
                targets.append(attributes.get("Target", ""))

        if "_rels/.rels" in self._entries:
            _parse("_rels/.rels", self._bytes("_rels/.rels"), start)
        return unquote(targets[0]).lstrip("/").lower() if targets else ""

    def _bytes(self, part: str) -> bytes:
        entry = self._entries[part]
        if entry.flag_bits & 1 or entry.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
            raise malformed(part, "is encrypted, or compressed by another method than Deflate", "unpack and pack it")
        try:
            return self._zip.read(entry)
        except (BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError) as error:
            raise malformed(part, f"cannot be unpacked ({error})") from error

    def objects(self, part: str) -> dict[str, _Object]:
        """The objects of a model part by their ids, none if the package has no such part."""
        if part not in self.parts:
            self.parts[part] = {}
            if part in self._entries:
                self._read(part)
        return self.parts[part]

    def _read(self, part: str) -> None:
        objects, is_root = self.parts[part], part == self.root

        def placed(attributes: dict[str, str]) -> _Placed:
            paths = [value for name, value in attributes.items() if name.rpartition(":")[2] == "path"]
            other = self._part(paths[0], part) if paths else part
            return (other, attributes["objectid"]), _transform(part, attributes.get("transform"))

        own, in_mesh = _Object(name=""), False

        def start(name: str, attributes: dict[str, str]) -> None:
            nonlocal own, in_mesh
            kind = name.rpartition(":")[2]
            if kind == "vertex" and in_mesh:
                own.words += (attributes["x"], attributes["y"], attributes["z"])
            elif kind == "triangle" and in_mesh:
                own.corners += (attributes["v1"], attributes["v2"], attributes["v3"])
            elif kind not in ("vertices", "triangles"):
                in_mesh = kind == "mesh"  # slices have vertices, too
                if kind == "object":
                    own = objects.setdefault(attributes["id"], _Object(name=attributes.get("name", "")))
                elif kind == "component":
                    own.components.append(placed(attributes))
                elif kind == "item" and is_root:
                    self.items.append(placed(attributes))
                elif kind == "model" and is_root:
                    self.unit = attributes.get("unit", DEFAULT_UNIT)

        _parse(part, self._bytes(part), start)
        for number, mesh in objects.items():
            place = f"{part}, object {number}"
            mesh.vertices = _numbers(place, mesh.words, np.dtype(np.float64))
            mesh.faces = _numbers(place, mesh.corners, np.dtype(np.int64))
            wrong = np.flatnonzero(((mesh.faces < 0) | (mesh.faces >= len(mesh.vertices))).any(axis=1))
            if len(wrong):
                problem = f"triangle {wrong[0]} has the vertices {mesh.faces[wrong[0]].tolist()}"
                raise malformed(place, f"{problem}, but there are {len(mesh.vertices)}", "correct the indices")

    def _part(self, path: str, referring: str) -> str:
        """The part that a path in another part means: from the root of the package, or from the folder of that part."""
        name = unquote(path).lower()
        beside = posixpath.normpath(posixpath.join(posixpath.dirname(referring), name)).lstrip("/")
        return next((part for part in (name.lstrip("/"), beside) if part in self._entries), name.lstrip("/"))

    def instances(self, most_rows: int) -> list[_Instance]:
        """The meshes at all their positions, in the order of the build, then meshes that the build does not use."""
        found: list[_Instance] = []
        rows, missing, seen = most_rows, list[str](), set[_Key]()

        def add(placed: _Placed) -> None:
            nonlocal rows
            stack = [(placed, 0)]
            while stack:
                (key, transform), depth = stack.pop()
                part, number = key
                mesh = self.objects(part).get(number)
                if mesh is None:
                    missing.append(f"object {number} of {part}")
                    continue
                seen.add(key)
                rows -= ROWS_OF_A_PRIMITIVE + len(mesh.vertices) + len(mesh.faces)
                if rows < 0 or depth > DEEPEST:
                    problem = f"with it the build has over {most_rows:,} rows, or objects over {DEEPEST} levels deep"
                    raise malformed(f"{part}, object {number}", problem, "write each mesh once")
                if len(mesh.faces):
                    start = found[-1].stop if found else 0
                    found.append(_Instance(key=key, mesh=mesh, transform=transform, start=start))
                shift = transform * [[0], [0], [0], [1]]
                stack += [((inner, own @ transform[:3] + shift), depth + 1) for inner, own in reversed(mesh.components)]

        for item in self.items:
            add(item)
        for number, mesh in self.objects(self.root).items():
            if (self.root, number) not in seen and len(mesh.faces):
                add(((self.root, number), IDENTITY))
        sizes = np.abs(np.linalg.det(np.array([one.transform[:3] for one in found]).reshape(-1, 3, 3)))
        if not (sizes > 0).all():
            part, number = found[int(np.argmin(sizes > 0))].key
            raise malformed(f"{part}, object {number}", "its transform is singular", "correct the transform")
        self.notes += [f"{what} does not exist, and is left out" for what in dict.fromkeys(missing[:MOST_NOTES])]
        return found


def _parse(part: str, data: bytes, start: Callable[[str, dict[str, str]], None]) -> None:
    """Calls `start` with the name and the attributes of each XML element. Raises a MeshFileError for malformed XML."""

    def refuse(*_: object) -> None:
        raise malformed(part, "has a document type definition, which 3MF forbids", "do not use it")

    parser = ParserCreate()
    parser.StartElementHandler, parser.StartDoctypeDeclHandler = start, refuse
    try:
        parser.Parse(data, True)
    except MeshFileError:
        raise
    except KeyError as error:
        problem = f"an element lacks the attribute {error}"
        raise malformed(f"{part}, line {parser.CurrentLineNumber}", problem, "correct the file") from error
    except (ExpatError, LookupError, ValueError) as error:  # the last two for encodings that are not known
        raise malformed(part, f"is not valid XML ({error})") from error


def _numbers(place: str, words: list[str], dtype: np.dtype[Any]) -> np.ndarray:
    """Words as (n, 3) numbers."""
    convert = float if dtype.kind == "f" else int

    def converted(items: Sequence[str]) -> np.ndarray:
        if "_" in "".join(items):
            raise ValueError("underscore")
        return np.array(list(map(convert, items)), dtype=dtype)

    try:
        return converted(words).reshape(-1, 3)
    except (ValueError, OverflowError):
        wrong = words[first_unreadable(words, converted)]
        raise malformed(place, f"'{wrong}' is not a number of a mesh", "correct it") from None


def _transform(part: str, text: str | None) -> Float[np.ndarray, "4 3"]:
    if text is None:
        return IDENTITY
    numbers = _numbers(part, text.split(), np.dtype(np.float64))
    if len(numbers) != 4:
        raise malformed(part, f"the transform '{text}' has not 12 numbers", "correct the transform")
    return numbers


def read_3mf(data: bytes) -> FileContents:
    """All meshes of a 3MF file, at all positions in its build, with those in other model parts of the package.

    A mesh that the build uses several times is read for each of its positions, up to `MOST_ROWS` rows in total. Meshes
    of the root part that the build does not use are at their own coordinates.
    """
    package = _Package(data)
    instances = package.instances(max(MOST_ROWS, len(data)))
    if not instances:
        raise malformed("", "; ".join(["has no triangles", *package.notes]), "give a file with a surface in it")
    vertices = np.concatenate([one.vertices for one in instances])
    faces = np.concatenate([one.oriented(one.mesh.faces + one.start) for one in instances])
    unit = package.unit if package.unit in METRES else DEFAULT_UNIT
    return FileContents(
        vertices=vertices,
        polygons=Polygons.of_triangles(faces),
        representatives=np.arange(len(vertices)),
        unit=unit,
        notes=tuple(package.notes),
        suffix=".3mf",
        appended=partial(_appended, data, vertices, instances, unit),
    )


def encode_3mf(contents: FileContents) -> bytes:
    """A new 3MF file of one mesh: positions and triangles, closed along seams, in millimetres unless it has a unit."""
    triangles, _ = contents.polygons.renumbered(contents.representatives).triangulated(contents.vertices)
    mesh = _object_text("1", "", contents.vertices, triangles)
    return _package_bytes([mesh], [_item_text("1", IDENTITY)], contents.unit or DEFAULT_UNIT)


def _appended(
    data: bytes, vertices: Float[np.ndarray, "v 3"], instances: Sequence[_Instance], unit: str, extension: MeshExtension
) -> bytes:
    """A new file of the meshes at their positions, each with its patches.

    A patch belongs to the mesh of its first vertex. Vertices of other meshes are copied. A mesh without a patch is
    written once for all of its positions.
    """
    if len(extension.faces) == 0:
        return data
    corners = extension.faces
    vertices = np.concatenate([vertices, extension.vertices])
    labels = linked(np.concatenate([corners[:, :2], corners[:, 1:]]), len(vertices))
    _, first = np.unique(labels, return_index=True)
    starts = [one.start for one in instances]
    owner = np.searchsorted(starts, first[labels[corners[:, 0]]], side="right") - 1
    order = np.argsort(owner, kind="stable")
    bounds = np.searchsorted(owner[order], np.arange(len(instances) + 1))
    objects: list[str] = []
    items: list[str] = []
    written: dict[_Key, str] = {}
    for one, begin, end in zip(instances, bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        number = written.get(one.key, str(len(objects) + 1)) if begin == end else str(len(objects) + 1)
        if begin == end:
            written[one.key] = number
        if number == str(len(objects) + 1):
            own, faces = one.mesh.vertices, one.mesh.faces
            if begin < end:
                new = corners[order[begin:end]]
                others = np.setdiff1d(new, np.arange(one.start, one.stop))
                is_own = (new >= one.start) & (new < one.stop)
                index = np.where(is_own, new - one.start, len(own) + np.searchsorted(others, new))
                back = (vertices[others] - one.transform[3]) @ np.linalg.inv(one.transform[:3])
                own, faces = np.concatenate([own, back]), np.concatenate([faces, one.oriented(index)])
            objects.append(_object_text(number, one.mesh.name, own, faces))
        items.append(_item_text(number, one.transform))
    return _package_bytes(objects, items, unit)


def _object_text(number: str, name: str, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> str:
    points = '<vertex x="%r" y="%r" z="%r"/>\n' * len(vertices) % tuple(vertices.ravel().tolist())
    triangles = '<triangle v1="%d" v2="%d" v3="%d"/>\n' * len(faces) % tuple(faces.ravel().tolist())
    named = f" name={quoteattr(name)}" if name else ""
    return (
        f'<object id="{number}" type="model"{named}>\n<mesh>\n<vertices>\n{points}</vertices>\n'
        f"<triangles>\n{triangles}</triangles>\n</mesh>\n</object>\n"
    )


def _item_text(number: str, transform: Float[np.ndarray, "4 3"]) -> str:
    moved = (
        "" if np.array_equal(transform, IDENTITY) else f' transform="{" ".join(map(repr, transform.ravel().tolist()))}"'
    )
    return f'<item objectid="{number}"{moved}/>\n'


def _package_bytes(objects: Sequence[str], items: Sequence[str], unit: str) -> bytes:
    """The bytes of a package with one model part."""
    start = '<?xml version="1.0" encoding="UTF-8"?>\n'
    defaults = "".join(f'<Default Extension="{name}" ContentType="{kind}"/>' for name, kind in TYPES.items())
    target = f'Target="/{ROOT}" Id="rel0" Type="{CORE.replace("core/2015/02", "2013/01")}/3dmodel"'
    texts = {
        "[Content_Types].xml": f'<Types xmlns="{PACKAGE}/content-types">{defaults}</Types>\n',
        "_rels/.rels": f'<Relationships xmlns="{PACKAGE}/relationships"><Relationship {target}/></Relationships>\n',
        ROOT: f'<model unit="{unit}" xmlns="{CORE}">\n<resources>\n{"".join(objects)}</resources>\n'
        f"<build>\n{''.join(items)}</build>\n</model>\n",
    }
    written = io.BytesIO()
    with ZipFile(written, "w") as packed:
        for name, text in texts.items():
            packed.writestr(ZipInfo(name), (start + text).encode("utf-8"), ZIP_DEFLATED)
    return written.getvalue()
