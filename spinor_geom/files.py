"""Files that are either completely written or not touched at all, and names without characters that do harm."""

import errno
import hashlib
import json
import math
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# In bytes. A path on Windows has at most 260 characters: this leaves 120 for the folder of the results and their names.
_LONGEST_PART, _LONGEST_NAME = 100, 140
# what unpacks to more bytes than the first may not do so by the second factor: text packs 3 to 20 times
_FREE_SIZE, MOST_RATIO = 1 << 24, 200
SURFACE_SUFFIX = ".safetensors"  # of saved surfaces
MESH_SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb", ".vtp", ".vtk", ".3mf")  # of mesh files that can be read
NUMBERED = "%~"  # what no name has by itself: a % stands before two digits, or at an end
_UNSAFE = re.compile(r"[\x00-\x1f\x7f\\/:*?\"<>|%\ud800-\udfff]|^[. ]|[. ]$")
# devices of Windows, whatever suffix follows
_DEVICE = re.compile(r"(con|conin\$|conout\$|prn|aux|nul|(com|lpt)[0-9¹²³]) *(\.|$)", re.IGNORECASE)


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path to write to, which becomes `path` only when the block ends without an error.

    The temporary file lies in the same folder and has the same suffix. At the end of the block it is flushed to the
    disk (fsync) and renamed over `path` in one step; a file that was there keeps its access rights. After any error, an
    interrupt included, the old file is as it was and the temporary file is gone. A symbolic link stays a link: the file
    it names is replaced. Devices and pipes (`/dev/stdout`) hold nothing to protect and are written to directly.
    It is an OSError where the folder does not exist or may not be written to, the disk is full, `path` is a folder, or
    (on Windows) is read-only or open in another program. Its `filename` is `path`, never the temporary one.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise IsADirectoryError(f"{os.fspath(path)} is a folder; name a file in it")
    if target.exists() and not target.is_file():
        with _naming(path, target):
            yield target
        return
    temporary = target.with_name(f".{target.stem[:32]}.{secrets.token_hex(8)}{target.suffix}")
    with _naming(path, temporary):
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        try:
            yield temporary
            _flush(temporary)
            if target.exists() and os.name != "nt":  # there all that a mode tells is read-only, which forbids to rename
                temporary.chmod(stat.S_IMODE(target.stat().st_mode))
            os.replace(temporary, target)
            _flush_names(target.parent)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def _naming(path: str | os.PathLike[str], written: Path) -> Iterator[None]:
    """An error about the path that is written to, or that names none (a full disk), names the caller's path."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(written)):
            error.filename = os.fspath(path)
        raise


@contextmanager
def atomic_folder(path: str | os.PathLike[str], *, staging: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary folder to write to, which becomes `path` only when the block ends without an error.

    At the end of the block its files are flushed to the disk (fsync), and it is renamed; a folder that was there is
    removed just before. Temporary folders lie in `staging`, on the same disk. It is made where it does not exist, and
    so are the folders above `path`. An OSError tells that one cannot be made, or that the disk is full.
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
    """Writes a nested value as JSON, the file whole or not at all; numbers that JSON cannot hold become null."""
    write_text(path, json_text(value))


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Writes a text file in UTF-8, whole or not at all; ? for bytes of a file's name that are no text."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="replace", newline="\n")


def json_text(value: Any) -> str:
    """A nested value as JSON; numbers that it cannot hold become null."""
    return json.dumps(finite(value), indent=2, allow_nan=False) + "\n"


def finite(value: Any) -> Any:
    """The same nested value with None for every number that JSON cannot hold."""
    if isinstance(value, dict):
        return {key: finite(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def printable(text: str) -> str:
    """Text with ? for what a terminal may obey or cannot show: control characters, and bytes that are no text."""
    return "".join(character if character.isprintable() else "?" for character in text)


def is_bomb(size: int, packed: int) -> bool:
    """Whether a packed file of so many bytes unpacks to a size that no honest one does."""
    return size > _FREE_SIZE and size > MOST_RATIO * packed


def safe_name(parts: Iterable[str]) -> str:
    """A relative path of harmless parts.

    What a file system may take amiss is written as % and two hexadecimal digits a byte, so different names stay
    different; names that are too long end in %~ and a checksum instead of their rest.
    """
    *folders, last = map(_safe_part, parts)
    # folders of results are named after files: one inside the other would be removed with it
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
    """Waits until a folder's list of names is on the disk, where the system can open and flush folders.

    Windows and folders without the right to read refuse to be opened; some network file systems cannot flush them.
    """
    try:
        _flush(folder, os.O_RDONLY)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EPERM, errno.EINVAL, errno.ENOTSUP):
            raise


def _flush(path: Path, access: int = os.O_RDWR) -> None:
    """Waits until a file is on the disk."""
    descriptor = os.open(path, access)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
