"""Tar and zip archives: their members are listed without unpacking.

As a program, this module is the process that lists archives for `inputs`.
"""

import errno
import json
import lzma
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


@dataclass(frozen=True, kw_only=True)
class Member:
    """A file in an archive."""

    name: str
    size: int  # in bytes, unpacked
    place: int  # in a tar archive, the offset of its first byte when unpacked, in a zip archive its number
    is_regular: bool = True  # else a link, a device or a sparse file, which cannot be read


def is_archive(path: str) -> bool:
    """Whether a file's name has the suffix of an archive."""
    return path.lower().endswith(SUFFIXES)


def members(path: Path) -> Iterator[Member]:
    """The files in an archive, in its order. They are safe to use only after the iteration has ended without an error.

    Raises an ArchiveError if the archive is damaged or unpacks to over 200 times its size, and an OSError.
    """
    packed = path.stat().st_size
    with _damage_as_archive_error(path), _opened(path) as archive:
        for unpacked, member in (_zip_members if isinstance(archive, zipfile.ZipFile) else _tar_members)(archive):
            if is_bomb(unpacked, packed):
                raise ArchiveError(
                    f"{path}: the archive is a decompression bomb: up to '{member.name}' it unpacks to over "
                    f"{MOST_RATIO} times its size; do not use it"
                )
            yield member


@contextmanager
def _damage_as_archive_error(path: Path, name: str = "") -> Iterator[None]:
    """Raises an ArchiveError for damaged bytes. Errors of the disk are raised unchanged."""
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
        """The bytes of a member. Raises an ArchiveError for a damaged or changed archive, and an OSError."""
        with _damage_as_archive_error(path, member.name):
            status = path.stat()
            key = (path, status.st_size, status.st_mtime_ns)
            if self._archive is None or key != self._key:
                self.close()
                self._archive, self._key = _opened(path), key
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


def _opened(path: Path) -> zipfile.ZipFile | tarfile.TarFile:
    if path.name.lower().endswith(".zip"):
        return zipfile.ZipFile(path)
    return tarfile.open(path, tarinfo=_Header)


def _zip_members(archive: Any) -> Iterator[tuple[int, Member]]:
    """The unpacked size up to the end of each file, and the file."""
    unpacked = 0
    for place, entry in enumerate(archive.infolist()):
        unpacked += entry.file_size
        if not entry.is_dir():
            yield unpacked, Member(name=entry.filename, size=entry.file_size, place=place)


def _tar_members(archive: Any) -> Iterator[tuple[int, Member]]:
    """As `_zip_members`, with all headers."""
    while (entry := archive.next()) is not None:
        if not entry.isdir():
            is_regular = entry.isreg() and not entry.issparse()
            member = Member(name=entry.name, size=entry.size, place=entry.offset_data, is_regular=is_regular)
            yield entry.offset_data + entry.size, member
        archive.members.clear()  # tarfile would keep all of them


class _Header(tarfile.TarInfo):
    """A header of a tar archive. Raises an error if it is damaged. To tarfile that is the end of the archive."""

    @classmethod
    def frombuf(cls, buf: Any, *arguments: Any) -> Any:
        try:
            return super().frombuf(buf, *arguments)
        except tarfile.HeaderError as error:
            if not buf.strip(b"\0"):  # the end of the archive
                raise
            raise tarfile.ReadError(f"a header is damaged: {error}") from error


def list_members(job: dict[str, Any], send: Send) -> None:
    """Writes a line of JSON for each mesh file of an archive: the fields of its `Source` that describe it.

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
                    if not member.is_regular:
                        what = f"{job['archive']}: {member.name}: is a link, a device or a sparse file"
                        entry["problem"] = f"{what}; pack the file itself"
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
