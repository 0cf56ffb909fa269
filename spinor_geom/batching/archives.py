"""Tar and zip archives: their members are listed without unpacking; an unsafe member is an error of the whole archive.

As a program, this module is the process that lists archives for `inputs`.
"""

import errno
import json
import lzma
import os
import stat
import struct
import tarfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from spinor_geom.errors import ArchiveError
from spinor_geom.files import MOST_RATIO, NUMBERED, is_bomb, safe_name
from spinor_geom.isolate import Send, serve

SUFFIXES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz")
MOST_ZIP_MEMBERS = 200_000  # zipfile holds the list of members in memory, half a kilobyte each
LONGEST_NAME, LONGEST_HEADER = 4096, 1 << 20  # bytes of a member's name, and of a tar header of variable length
# Raised by the standard library for damaged bytes. A damaged archive may also raise an OSError without an errno.
DAMAGE = (
    OSError,
    EOFError,
    LookupError,
    RuntimeError,
    ValueError,
    lzma.LZMAError,
    struct.error,
    tarfile.TarError,
    zipfile.BadZipFile,
    zlib.error,
)
_COMPRESSIONS = {b"\x1f\x8b": "gz", b"BZh": "bz2", b"\xfd7zXZ\x00": "xz"}  # by the first bytes of the file


@dataclass(frozen=True, kw_only=True)
class Member:
    """A file in an archive."""

    name: str
    size: int  # in bytes, unpacked
    place: int  # in a tar archive, the offset of its first byte in the unpacked archive; in a zip archive, its number


def is_archive(path: str) -> bool:
    """Whether a file's name has the suffix of an archive."""
    return path.lower().endswith(SUFFIXES)


def members(path: Path) -> Iterator[Member]:
    """The files in an archive, in its order. They are safe to use only after the iteration has ended without an error.

    Raises an ArchiveError if the archive is damaged or encrypted, or holds a link, a device, an absolute name, a name
    with "..", a name or header that is too long, or files that unpack to over 200 times their size; and an OSError.
    """
    with _damage_as_archive_error(path):
        yield from (_zip_members if _is_zip(path) else _tar_members)(path)


@contextmanager
def _damage_as_archive_error(path: Path, name: str = "") -> Iterator[None]:
    """Raises an ArchiveError for damaged bytes; errors of the disk are raised unchanged."""
    try:
        yield
    except DAMAGE as error:
        # an offset before the start of the file, as damaged archives have it, gives EINVAL
        if isinstance(error, ArchiveError) or getattr(error, "errno", errno.EINVAL) not in (None, errno.EINVAL):
            raise
        where = f"{path}: {name}: " if name else f"{path}: "
        raise ArchiveError(f"{where}cannot be read as an archive ({error}); check that it is complete") from error


class ArchiveReader:
    """Reads members of archives. The last archive stays open, because members are read one after the other."""

    def __init__(self) -> None:
        self._key: tuple[Path, int, int] | None = None
        self._archive: zipfile.ZipFile | tarfile.TarFile | None = None

    def read(self, path: Path, member: Member) -> bytes:
        """The bytes of a member; ArchiveError if the archive is damaged or has changed, OSError if it is unreadable."""
        with _damage_as_archive_error(path, member.name):
            status = path.stat()
            key = (path, status.st_size, status.st_mtime_ns)
            if self._archive is None or key != self._key:
                self.close()
                self._archive, self._key = (zipfile.ZipFile(path) if _is_zip(path) else _opened_tar(path)), key
            if isinstance(self._archive, zipfile.ZipFile):
                return self._archive.read(self._archive.infolist()[member.place])
            entry = tarfile.TarInfo(member.name)
            entry.size, entry.offset_data = member.size, member.place
            return cast(Any, self._archive.extractfile(entry)).read()  # type: ignore[no-any-return]

    def close(self) -> None:
        """Closes the open archive, if any."""
        if self._archive is not None:
            self._archive.close()
        self._archive = None


def _is_zip(path: Path) -> bool:
    return path.name.lower().endswith(".zip")


def _zip_members(path: Path) -> Iterator[Member]:
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        if len(entries) > MOST_ZIP_MEMBERS:
            raise _refused(path, f"{len(entries)} members", f"split it into parts of at most {MOST_ZIP_MEMBERS}")
        total, packed = 0, path.stat().st_size
        for place, entry in enumerate(entries):
            total += entry.file_size
            kind = stat.S_IFMT(entry.external_attr >> 16)
            _require_safe(path, entry.filename, entry.file_size, entry.compress_size)
            _require_safe(path, entry.filename, total, packed)
            if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise _refused(path, f"'{entry.filename}', a link or device", "pack the files themselves")
            if entry.flag_bits & 1:
                raise _refused(path, f"'{entry.filename}', which is encrypted", "pack it without a password")
            if not entry.is_dir():
                yield Member(name=entry.filename, size=entry.file_size, place=place)


def _tar_members(path: Path) -> Iterator[Member]:
    packed = path.stat().st_size
    with _opened_tar(path) as archive:
        while (entry := archive.next()) is not None:
            _require_safe(path, entry.name, entry.offset_data + entry.size, packed)
            if not (entry.isreg() or entry.isdir()) or entry.issparse():
                raise _refused(path, f"'{entry.name}', a link, device or sparse file", "pack the files themselves")
            if entry.isreg():
                yield Member(name=entry.name, size=entry.size, place=entry.offset_data)
            cast(Any, archive).members.clear()  # tarfile would keep all of them


class _Header(tarfile.TarInfo):
    """A header of a tar archive; an error if it is damaged (for tarfile the end of the archive) or too long."""

    @classmethod
    def frombuf(cls, buf: Any, *arguments: Any) -> Any:
        try:
            return super().frombuf(buf, *arguments)
        except tarfile.HeaderError as error:
            if not buf.strip(b"\0"):  # the end of the archive
                raise
            raise tarfile.ReadError(f"a header is damaged: {error}") from error

    def _proc_member(self, archive: tarfile.TarFile) -> Any:
        if not self.isreg() and self.size > LONGEST_HEADER:
            raise _refused(Path(os.fsdecode(archive.name or "")), f"a header of {self.size} bytes", "do not use it")
        return cast(Any, super())._proc_member(archive)


def _opened_tar(path: Path) -> tarfile.TarFile:
    with path.open("rb") as file:
        start = file.read(8)
    compression = next((kind for magic, kind in _COMPRESSIONS.items() if start.startswith(magic)), "")
    return cast(tarfile.TarFile, cast(Any, tarfile).open(path, f"r:{compression}", tarinfo=_Header))


def _require_safe(path: Path, name: str, size: int, packed: int) -> None:
    if is_bomb(size, packed):
        raise _refused(
            path,
            f"a decompression bomb: up to '{name}' it unpacks to over {MOST_RATIO} times its size",
            "do not use it",
        )
    parts = name.replace("\\", "/").split("/")
    if len(os.fsencode(name)) > LONGEST_NAME:
        raise _refused(path, f"'{name[:60]}…', a name of more than {LONGEST_NAME} bytes", "do not use it")
    if not parts[0] or parts[0].endswith(":") or ".." in parts:
        raise _refused(path, f"'{name}', a path to outside the archive", "do not use it, or repack it")


def _refused(path: Path, what: str, advice: str) -> ArchiveError:
    return ArchiveError(f"{path}: the archive contains {what}; {advice}")


def list_members(job: dict[str, Any], send: Send) -> None:
    """Writes a line of JSON for each mesh file of an archive: its key and the fields of its `Member`.

    The job has the path of the "archive", the "suffixes" of mesh files, the first "parts" of every key, and the
    "listing" to write. Sends "listed" after each member, at the end "others", the number of other files by suffix, or
    a "problem".
    """
    seen: Counter[str] = Counter()
    others: Counter[str] = Counter()
    try:
        with open(job["listing"], "w", encoding="ascii") as file:
            for member in members(Path(job["archive"])):
                if member.name.lower().endswith(tuple(job["suffixes"])):
                    inner = (part for part in member.name.replace("\\", "/").split("/") if part not in ("", "."))
                    key = safe_name([*job["parts"], *inner])
                    seen[key.lower()] += 1  # some file systems ignore case
                    key += f"{NUMBERED}{seen[key.lower()]}" if seen[key.lower()] > 1 else ""
                    entry = {"key": key, "member": member.name, "place": member.place, "size": member.size}
                    file.write(json.dumps(entry) + "\n")
                else:
                    others[Path(member.name).suffix.lower()] += 1
                send({"listed": member.place})
        send({"others": others})
    except ArchiveError as error:
        send({"problem": str(error)})
    except OSError as error:
        send({"problem": f"{job['archive']}: cannot be read ({error.strerror}); check the access rights"})


if __name__ == "__main__":
    serve(list_members)
