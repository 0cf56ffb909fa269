"""Files that are written completely or not at all, and file names that are safe on all systems."""

import errno
import hashlib
import json
import math
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Literal

# In bytes. A path on Windows has at most 260 characters. 120 are left for the output folder and the names in it.
_LONGEST_PART, _LONGEST_NAME = 100, 140
# A compressed file may unpack to _FREE_SIZE bytes, or to MOST_RATIO times its size. Text is compressed 3 to 20 times.
_FREE_SIZE, MOST_RATIO = 1 << 24, 200
SURFACE_SUFFIX = ".safetensors"  # of saved surfaces
MESH_SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb", ".vtp", ".vtk", ".3mf")  # of mesh files that can be read
_group: ContextVar[list[tuple[Path, Path]] | None] = ContextVar("files of `together`", default=None)
# of files whose third axis is upwards. In GLB it is the second one, and in most other mesh files
Z_UP = (SURFACE_SUFFIX, ".stl", ".3mf", ".step", ".stp", ".igs", ".iges", ".brep")
NUMBERED = "%~"  # in no other safe name: there two hexadecimal digits or nothing follow a %
_UNSAFE = re.compile(r"[\x00-\x1f\x7f\\/:*?\"<>|%\ud800-\udfff]|^[. ]|[. ]$")
# devices of Windows, whatever suffix follows
_DEVICE = re.compile(r"(con|conin\$|conout\$|prn|aux|nul|(com|lpt)[0-9¹²³]) *(\.|$)", re.IGNORECASE)


def up_axis(path: str | os.PathLike[str] | None) -> Literal["y", "z"]:
    """The axis that is upwards in a file, by its suffix, or y without a file."""
    return "z" if path is not None and Path(path).suffix.lower() in Z_UP else "y"


def regular_file(path: str | os.PathLike[str]) -> Path:
    """The path of a file to be read. Raises an OSError for a folder, a device or a pipe, which may have no end."""
    if not stat.S_ISREG(os.stat(path).st_mode):
        raise OSError(errno.EINVAL, "it is not a regular file", os.fspath(path))
    return Path(path)


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path to write to, which is renamed to `path` if the context ends without an error.

    The temporary file is in the same folder, has the same suffix and is flushed to the disk (fsync). A replaced file's
    access rights are kept. Inside `together` the file is renamed later. After an error or interrupt the old file is
    unchanged and the temporary file is removed. If `path` is a symbolic link, its target is replaced. Devices and pipes
    (`/dev/stdout`) are written to directly.

    Raises:
        OSError: the folder does not exist or is not writable, the disk is full, `path` is a folder, or (on Windows) it
            is read-only or open in another program. Its `filename` is `path`, never the temporary one.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise IsADirectoryError(f"{os.fspath(path)} is a folder; give the path of a file")
    if target.exists() and not target.is_file():
        with _naming(path, target):
            yield target
        return
    temporary, group = _beside(target), _group.get()
    with _naming(path, temporary):
        try:
            os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
            yield temporary
            _flush(temporary)
            if target.exists() and os.name != "nt":  # the only mode there, read-only, prevents renaming
                temporary.chmod(stat.S_IMODE(target.stat().st_mode))
            if group is None:
                _replace([(temporary, target)])
            else:
                group.append((temporary, target))
        finally:
            if group is None or (temporary, target) not in group:
                temporary.unlink(missing_ok=True)


@contextmanager
def together() -> Iterator[None]:
    """The files that `atomic_path` writes inside are renamed when the context ends without an error: all or none.

    After an error or interrupt, also during the renaming, all old files are unchanged.

    Raises:
        OSError: as `atomic_path`.
    """
    if _group.get() is not None:  # the outer group renames
        yield
        return
    group: list[tuple[Path, Path]] = []
    token = _group.set(group)
    try:
        yield
        _replace(group)
    finally:
        _group.reset(token)
        for temporary, _ in group:
            temporary.unlink(missing_ok=True)


def _beside(target: Path) -> Path:
    """A new hidden name in the same folder, with the same suffix."""
    return target.with_name(f".{target.stem[:32]}.{secrets.token_hex(8)}{target.suffix}")


def _replace(files: Sequence[tuple[Path, Path]]) -> None:
    """Renames written files to their targets, all or none."""
    old: dict[Path, Path | None] = {}  # where the replaced file of each target is
    try:
        for temporary, target in files:
            with _naming(target, temporary):
                if len(files) > 1 and target not in old:
                    old[target] = _copied(target) if target.exists() else None
                os.replace(temporary, target)
        for folder in {target.parent for _, target in files}:
            _flush_names(folder)
    except BaseException:
        for target, copy in old.items():
            if copy is None:
                target.unlink(missing_ok=True)
            else:
                os.replace(copy, target)
        raise
    finally:
        for copy in old.values():
            if copy is not None:
                copy.unlink(missing_ok=True)


def _copied(target: Path) -> Path:
    """Another name of a file, or a copy where the disk has no links."""
    copy = _beside(target)
    try:
        os.link(target, copy)
    except OSError:
        shutil.copy2(target, copy)
    return copy


@contextmanager
def _naming(path: str | os.PathLike[str], written: Path) -> Iterator[None]:
    """Sets the file name of an OSError that has none (a full disk) or the temporary path to `path`."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(written)):
            error.filename = os.fspath(path)
        raise


@contextmanager
def atomic_folder(path: str | os.PathLike[str], *, staging: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary folder in `staging`, which is renamed to `path` if the context ends without an error.

    Its files are flushed to the disk (fsync) before. An old folder at `path` is removed. `staging`, on the same disk,
    and the parents of `path` are created if necessary. Raises an OSError if the disk is full or a folder cannot be
    created.
    """
    target, temporary = Path(path), Path(staging) / secrets.token_hex(8)
    temporary.mkdir(parents=True)
    try:
        yield temporary
        for file in temporary.iterdir():
            _flush(file)
        _flush_names(temporary)
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists():
            shutil.rmtree(target)
        os.rename(temporary, target)
        _flush_names(target.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_json(path: str | os.PathLike[str], value: Any) -> None:
    """Writes a nested value as JSON, completely or not at all. NaN and infinity become null."""
    write_text(path, json_text(value))


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Writes a text file in UTF-8, completely or not at all, with ? for undecodable bytes of file names."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace", newline="\n")


def json_text(value: Any) -> str:
    """A nested value as JSON. NaN and infinity become null."""
    return json.dumps(finite(value), indent=2, allow_nan=False) + "\n"


def finite(value: Any) -> Any:
    """The same nested value with None for NaN and infinity."""
    if isinstance(value, dict):
        return {key: finite(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def printable(text: str) -> str:
    """Text with ? for undecodable bytes and for control characters, which a terminal would execute."""
    if text.isprintable():  # true for nearly all, and a hundred times as fast
        return text
    return "".join(character if character.isprintable() else "?" for character in text)


def is_bomb(size: int, packed: int) -> bool:
    """Whether a compressed file of `packed` bytes is a decompression bomb. `size` is the unpacked size."""
    return size > _FREE_SIZE and size > MOST_RATIO * packed


def safe_name(parts: Iterable[str]) -> str:
    """A relative path that is valid and harmless on all systems.

    Unsafe characters become % and two hexadecimal digits per byte, so different names stay different. The end of a name
    that is too long becomes %~ and a checksum.
    """
    *folders, last = map(_safe_part, parts)
    # the folder of the results of a mesh file has its name. An input folder of that name must differ
    name = "/".join([*(f"{part}%" if part.lower().endswith(MESH_SUFFIXES) else part for part in folders), last])
    return name if len(os.fsencode(name)) <= _LONGEST_NAME else _shortened(name, _LONGEST_PART)


def _safe_part(part: str) -> str:
    safe = _UNSAFE.sub(lambda found: _escaped(found.group()), part) or "%"
    if _DEVICE.match(safe):
        safe = _escaped(safe[0]) + safe[1:]
    return safe if len(os.fsencode(safe)) <= _LONGEST_PART else _shortened(safe, _LONGEST_PART - 20)


def _escaped(characters: str) -> str:
    return "".join(f"%{byte:02X}" for byte in os.fsencode(characters))


def _shortened(name: str, length: int) -> str:
    digest = hashlib.sha256(os.fsencode(name)).hexdigest()[:16]
    start = os.fsencode(name.replace("/", "%2F"))[:length].decode("utf-8", "ignore")
    return f"{start}{NUMBERED}{digest}"


def _flush_names(folder: Path) -> None:
    """Flushes a folder's list of names to the disk, where that is possible.

    Windows cannot open folders, other systems only with read permission. Some network file systems cannot flush them.
    """
    try:
        _flush(folder, os.O_RDONLY)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EPERM, errno.EINVAL, errno.ENOTSUP):
            raise


def _flush(path: Path, access: int = os.O_RDWR) -> None:
    """Flushes a file to the disk."""
    descriptor = os.open(path, access)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
