"""Textures and material libraries that mesh files refer to, from their own folder only.

The names come from strangers' files. A name is followed only to a regular file of limited size in the folder of the
mesh file or below it, without links, and only if it has the suffix of a material library or an image.
"""

from __future__ import annotations

import io
import os
import re
import stat
import warnings
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import Float, UInt8

from spinor_geom.errors import MeshFileError, require
from spinor_geom.files import atomic_path, safe_name

if TYPE_CHECKING:
    import PIL.Image

# an image, and coordinates in it of the corners of triangles (f, 3, 2), with the origin at the lower left
Textured: TypeAlias = tuple[UInt8[np.ndarray, "h w 3"], Float[np.ndarray, "f 3 2"]]
_SHOWN = ("PNG", "JPEG", "BMP", "GIF", "TGA", "WEBP")  # other readers of Pillow report damaged files in other ways
LIBRARY, IMAGES = ".mtl", (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".gif", ".webp", ".dds", ".exr")
EMBEDDED = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}  # in GLB, with their media types
MOST_BYTES = 1 << 30  # of all files of one mesh
MOST_FILES = 256  # that are looked for
# the keyword, options such as "-s 1 1 1" or "-clamp on", and the name, which may have spaces and quotes
_IMAGE = re.compile(
    r"(map_\w+|bump|disp|decal|refl|norm)\s+((?:-\w+\s+(?:(?:on|off|[rgbmlz]|sphere|cube_\w+|[-+.\d]+(?:e[-+]?\d+)?)\s+)*)*)(.+)",
    re.IGNORECASE,
)
_COLOUR_IMAGE, _MATERIAL = "map_kd", re.compile(r"newmtl\s+(.+)", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True, eq=False)
class Texture:
    """An image of colours for the whole mesh. `name` is that of its file."""

    data: bytes
    name: str

    @property
    def media_type(self) -> str | None:
        """As in `EMBEDDED`, or None if GLB files do not hold images of this format."""
        return EMBEDDED.get(PurePosixPath(self.name).suffix.lower())

    def pixels(self, largest: int) -> UInt8[np.ndarray, "h w 3"]:
        """The image with at most `largest` pixels on its longer side.

        Raises a MeshFileError if it is none of `_SHOWN`, damaged or very large.
        """
        require("PIL", extra="render")
        from PIL import Image

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged files
            warnings.simplefilter("error", Image.DecompressionBombWarning)  # a small file may unpack to gigabytes
            try:
                image = Image.open(io.BytesIO(self.data), formats=_SHOWN).convert("RGB")
            except (
                OSError,
                ValueError,
                SyntaxError,
                Image.DecompressionBombError,
                Image.DecompressionBombWarning,
            ) as error:
                known = ", ".join(_SHOWN)
                raise MeshFileError(
                    f"the image {self.name[:80]!r} is damaged, too large, or none of {known}; convert it to PNG"
                ) from error
        return pixels_of(image, largest)


def pixels_of(image: PIL.Image.Image, largest: int) -> UInt8[np.ndarray, "h w 3"]:
    """An image with at most `largest` pixels on its longer side."""
    image = image.convert("RGB")
    image.thumbnail((largest, largest))
    return np.asarray(image)


@dataclass(frozen=True, kw_only=True, eq=False)
class Appearance:
    """What a mesh file says about materials: files that it refers to, or the only texture, which is inside."""

    names: tuple[str, ...] = ()
    materials: tuple[str, ...] = ()  # of the libraries, those that the mesh uses, or none for all
    texture: Texture | None = None
    has_several: bool = False  # whether textures are inside that no other format of ours holds
    others: tuple[str, ...] = ()  # properties of the materials besides the texture


@dataclass(kw_only=True, eq=False)
class Companions:
    """Files beside a mesh file, by name, and a sentence for each that was not read."""

    folder: Path
    files: dict[str, bytes] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    colours: set[str] = field(default_factory=set)  # names of the images of colours
    tried: set[str] = field(default_factory=set)  # names that were looked for
    others: set[str] = field(default_factory=set)  # properties of the materials besides images of colours

    @classmethod
    def of(cls, folder: Path | None, appearance: Appearance) -> Companions:
        """The material libraries and images that a mesh file in a folder names, and those that the libraries name.

        Without a folder, as for bytes that were read, there are none.
        """
        materials, found = set(appearance.materials), cls(folder=folder or Path())
        if folder is None and appearance.names:
            found.notes.append("the files that it refers to are not copied: its folder is not known")
        for name in appearance.names if folder is not None else ():
            found._add(name, (LIBRARY, *IMAGES))
            if PurePosixPath(name).suffix.lower() in IMAGES:
                found.colours.add(_slashes(name))
        for library in [name for name in found.files if name.lower().endswith(LIBRARY)]:
            inside = PurePosixPath(library).parent
            text = found.files[library].decode("utf-8", "replace")
            material, plain = "", set[str]()
            for line in map(str.strip, text.splitlines()):
                is_used = not materials or material in materials
                if match := _MATERIAL.fullmatch(line):
                    material = match[1]
                    plain |= {material} if not materials or material in materials else set()
                elif match := _IMAGE.fullmatch(line):
                    image = str(inside / _slashes(match[3]))
                    found._add(image, IMAGES)
                    if match[1].lower() != _COLOUR_IMAGE:
                        found.others |= {match[1]} if is_used else set()
                    elif is_used:
                        found.colours.add(image)
                        found.others |= {match[2].strip()} - {""}
                        plain.discard(material)
            found.others |= {f"the colour of {name}" for name in plain}
        return found

    @property
    def texture(self) -> Texture | None:
        """The only image of colours."""
        if len(self.colours) != 1 or not self.colours <= self.files.keys():
            return None
        (name,) = self.colours
        return Texture(data=self.files[name], name=name)

    def without(self, others: tuple[str, ...]) -> list[str]:
        """A sentence on what is lost where only the image of colours is kept, besides other properties, or none."""
        lost = [one[:40] for one in sorted({*others, *self.others})]
        more = f", and {len(lost) - 5} more" if len(lost) > 5 else ""
        words = f"only the image of colours is kept of the materials, not {', '.join(lost[:5])}{more}"
        return [words] if lost else []

    def _add(self, name: str, suffixes: tuple[str, ...]) -> None:
        name = _slashes(name)
        if name in self.tried or len(self.tried) > MOST_FILES:
            return
        self.tried.add(name)
        if len(self.tried) > MOST_FILES:
            self.notes.append(f"the file refers to more than {MOST_FILES} files; the others were not copied")
            return
        try:
            self.files[name] = _read(self.folder, name, suffixes, MOST_BYTES - sum(map(len, self.files.values())))
        except _RefusedError as refused:
            self.notes.append(f"{name[:80]!r}, which the file refers to, was not copied: {refused}")


class _RefusedError(Exception):
    """Why a file is not read."""


def _slashes(name: str) -> str:
    """A name with slashes instead of backslashes, without quotes around it and parts that are a dot."""
    text = name.strip().strip('"').replace("\\", "/")
    return text if text.startswith("/") else str(PurePosixPath(text))


def _read(folder: Path, name: str, suffixes: tuple[str, ...], most: int) -> bytes:
    """The bytes of a regular file in a folder or below it, at most `most`. Raises a `_RefusedError` otherwise."""
    parts = PurePosixPath(name).parts
    if name.startswith("/") or ".." in parts or ":" in name or any(part.startswith(".") for part in parts):
        raise _RefusedError("its name leads outside the folder of the file, or to a hidden file")
    if not name.lower().endswith(suffixes) or safe_name(parts) != name:
        raise _RefusedError("its name is not that of a material library or an image on all systems")
    real = Path(os.path.realpath(folder))
    place = real.joinpath(*parts)
    if Path(os.path.realpath(place)) != place:
        raise _RefusedError("it is a link")
    try:
        flags = sum(getattr(os, flag, 0) for flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
        with open(os.open(place, os.O_RDONLY | flags), "rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise _RefusedError("it is not a regular file")
            if status.st_size > most:
                raise _RefusedError(f"all files together have more than {MOST_BYTES >> 20} MiB")
            return file.read(most)
    except OSError as error:
        raise _RefusedError(f"it cannot be read ({error.strerror})") from error


def write_beside(folder: Path, name: str, content: bytes) -> list[str]:
    """Writes a file that a mesh refers to, unless there is another one, which a sentence tells."""
    real = Path(os.path.realpath(folder))
    place = real.joinpath(*PurePosixPath(name).parts)
    if Path(os.path.realpath(place)) != place:
        return [f"{name} was not copied: a link beside the output leads elsewhere"]
    if place.exists():
        if place.is_file() and place.stat().st_size == len(content) and place.read_bytes() == content:
            return []
        return [f"{name} was not copied: another file of this name is beside the output"]
    place.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(place) as temporary:
        temporary.write_bytes(content)
    return []
