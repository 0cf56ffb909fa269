"""Tar and zip archives: listed without being unpacked, refused as a whole where something in them is dishonest."""

from __future__ import annotations

import bz2
import errno
import gzip
import lzma
import os
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

from spinor_geom.errors import ArchiveError

SUFFIXES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz")
# A member of more bytes than this may not be so many times larger than it is packed: text packs 3 to 20 times.
FREE_SIZE, MOST_RATIO = 1 << 24, 200
# The list of a zip archive's members is held in memory: half a kilobyte each.
MOST_ZIP_MEMBERS = 200_000
# In bytes: of a member's name, and of what may stand in a tar archive's header of any length.
LONGEST_NAME, LONGEST_HEADER = 4096, 1 << 20
LONG_HEADERS = (
    tarfile.GNUTYPE_LONGNAME,
    tarfile.GNUTYPE_LONGLINK,
    tarfile.XHDTYPE,
    tarfile.XGLTYPE,
    tarfile.SOLARIS_XHDTYPE,
)
# What the modules raise over bytes that are not as they should be, the first of it with no number of the system.
DAMAGE = (
    OSError,
    EOFError,
    LookupError,
    NotImplementedError,
    RuntimeError,
    ValueError,
    lzma.LZMAError,
    struct.error,
    tarfile.TarError,
    zipfile.BadZipFile,
    zlib.error,
)

_OPENERS: tuple[tuple[bytes, Callable[[str], Any]], ...] = (
    (b"\x1f\x8b", gzip.GzipFile),
    (b"BZh", bz2.BZ2File),
    (b"\xfd7zXZ\x00", lzma.LZMAFile),
)


@dataclass(frozen=True, kw_only=True)
class Member:
    """A file in an archive.

    Attributes:
        name: in the archive.
        size: in bytes, unpacked.
        place: in a tar archive the offset of its first byte in the unpacked archive; in a zip its number.
    """

    name: str
    size: int
    place: int


def is_archive(path: str | os.PathLike[str]) -> bool:
    """Whether a file's name is that of an archive."""
    return os.fspath(path).lower().endswith(SUFFIXES)


def members(path: Path) -> Iterator[Member]:
    """The files in an archive, in its order; only after the last of them is it known that all can be trusted.

    Raises:
        ArchiveError: the archive is damaged or encrypted; or it holds links, devices, absolute names, names with ..,
            names or headers of many pages, or files that unpack to more than 200 times their size.
        OSError: it cannot be read.
    """
    with _damage_of(path):
        yield from (_zip_members if path.name.lower().endswith(".zip") else _tar_members)(path)


@contextmanager
def _damage_of(path: str | os.PathLike[str], name: str = "") -> Iterator[None]:
    """Turns what modules raise over damaged archives into an error that says where; those of the disk stay."""
    try:
        yield
    except DAMAGE as error:
        # an ArchiveError is a ValueError; a place before the file's start is an invalid argument
        if isinstance(error, ArchiveError) or getattr(error, "errno", errno.EINVAL) not in (None, errno.EINVAL):
            raise
        where = f"{os.fspath(path)}: {name}: " if name else f"{os.fspath(path)}: "
        raise ArchiveError(f"{where}cannot be read as an archive ({error}); check that it is complete") from error


class ArchiveReader:
    """Opens members of one archive after the other, and keeps the last archive open: members follow one another."""

    def __init__(self) -> None:
        """Opens nothing yet."""
        self._key: tuple[str, int, int] | None = None
        self._open: zipfile.ZipFile | BinaryIO | None = None

    def open(self, path: str, member: Member) -> BinaryIO:
        """A member's bytes as a stream from its start.

        Raises:
            ArchiveError: the archive has changed or is damaged; so may reads of the stream.
            OSError: it cannot be read.
        """
        with _damage_of(path, member.name):
            status = os.stat(path)
            key = (path, status.st_size, status.st_mtime_ns)
            if key != self._key:
                self.close()
                self._open = zipfile.ZipFile(path) if path.lower().endswith(".zip") else _unpacked(path)
                self._key = key
            if isinstance(self._open, zipfile.ZipFile):
                part: Any = self._open.open(self._open.infolist()[member.place])
            else:
                part = _Part(cast(BinaryIO, self._open), member)
                part.seek(0)
            return cast(BinaryIO, _Checked(part, path, member.name))

    def close(self) -> None:
        """Closes the archive that is open."""
        if self._open is not None:
            self._open.close()
        self._open = self._key = None


class _Checked:
    """A member as a stream whose damage is told where it is met."""

    def __init__(self, part: Any, path: str, name: str) -> None:
        self._part, self._path, self._name = part, path, name

    def read(self, size: int = -1) -> bytes:
        with _damage_of(self._path, self._name):
            return bytes(self._part.read(size))

    def seek(self, place: int) -> int:
        with _damage_of(self._path, self._name):
            return int(self._part.seek(place))

    def close(self) -> None:
        self._part.close()


class _Part:
    """A member of a tar archive as a stream, which may be read again from its start."""

    def __init__(self, file: BinaryIO, member: Member) -> None:
        self._file, self._member, self._place = file, member, 0

    def read(self, size: int = -1) -> bytes:
        left = self._member.size - self._place
        data = self._file.read(left if size < 0 else min(size, left))
        if not data and left and size:
            raise EOFError("the archive ends in this member")
        self._place += len(data)
        return data

    def seek(self, place: int) -> int:
        self._place = place
        return self._file.seek(self._member.place + place) - self._member.place

    def close(self) -> None:
        """The archive stays open."""


def _zip_members(path: Path) -> Iterator[Member]:
    with zipfile.ZipFile(path) as archive:
        listed = archive.infolist()
        if len(listed) > MOST_ZIP_MEMBERS:
            raise _refused(path, f"{len(listed)} members", f"split it: {MOST_ZIP_MEMBERS} are the most")
        for place, entry in enumerate(listed):
            kind = stat.S_IFMT(entry.external_attr >> 16)
            _require_plain_name(path, entry.filename)
            if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise _refused(path, f"'{entry.filename}', a link or device", "pack the files themselves")
            if entry.flag_bits & 1:
                raise _refused(path, f"'{entry.filename}', which is encrypted", "pack it without a password")
            _require_ratio(path, entry.filename, entry.file_size, entry.compress_size)
            if not entry.is_dir():
                yield Member(name=entry.filename, size=entry.file_size, place=place)


def _tar_members(path: Path) -> Iterator[Member]:
    with _unpacked(os.fspath(path)) as unpacked, _stream(unpacked, path) as archive:
        for entry in archive:
            _require_plain_name(path, entry.name)
            if not (entry.isreg() or entry.isdir()) or entry.issparse():
                raise _refused(path, f"'{entry.name}', a link, device or sparse file", "pack the files themselves")
            if entry.isreg():
                yield Member(name=entry.name, size=entry.size, place=entry.offset_data)
            cast(Any, archive).members.clear()  # which tarfile never does by itself


def _stream(unpacked: BinaryIO, path: Path) -> tarfile.TarFile:
    stream = cast(BinaryIO, _Counted(unpacked, path))
    return tarfile.open(os.fspath(path), mode="r|", fileobj=stream, tarinfo=_Header)


class _Header(tarfile.TarInfo):
    """A header of a tar archive: one that is damaged is no end, and none is read that is as long as a mesh."""

    @classmethod
    def frombuf(cls, buf: Any, *arguments: Any) -> Any:
        try:
            return super().frombuf(buf, *arguments)
        except tarfile.HeaderError as error:
            if not buf.strip(b"\0"):  # the archive's end
                raise
            # which tarfile takes this for, too
            raise tarfile.ReadError(f"a header is damaged: {error}") from error

    def _proc_member(self, archive: tarfile.TarFile) -> Any:
        if self.type in LONG_HEADERS and self.size > LONGEST_HEADER:
            raise _refused(Path(os.fsdecode(archive.name or "")), f"a header of {self.size} bytes", "do not use it")
        return cast(Any, super())._proc_member(archive)


def _unpacked(path: str) -> BinaryIO:
    with open(path, "rb") as file:
        start = file.read(8)
    opener: Callable[..., Any] = next((opener for magic, opener in _OPENERS if start.startswith(magic)), open)
    return cast(BinaryIO, opener(path, "rb"))


class _Counted:
    """A stream that stops where it has given much more than the file that it comes from holds."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._file, self._path, self._packed, self._given = file, path, path.stat().st_size, 0

    def read(self, size: int) -> bytes:
        data = self._file.read(size)
        self._given += len(data)
        _require_ratio(self._path, "the whole", self._given, self._packed)
        return data


def _require_ratio(path: Path, name: str, size: int, packed: int) -> None:
    if size > FREE_SIZE and size > MOST_RATIO * packed:
        raise _refused(path, f"a bomb: {name} unpacks to over {MOST_RATIO} times its size", "do not use it")


def _require_plain_name(path: Path, name: str) -> None:
    parts = name.replace("\\", "/").split("/")
    if len(os.fsencode(name)) > LONGEST_NAME:
        raise _refused(path, f"'{name[:60]}…', a name of more than {LONGEST_NAME} bytes", "do not use it")
    if not parts[0] or parts[0].endswith(":") or ".." in parts:
        raise _refused(path, f"'{name}', a name that leads out of it", "do not use it, or pack it anew")


def _refused(path: Path, what: str, advice: str) -> ArchiveError:
    return ArchiveError(f"{path}: the archive holds {what}; {advice}")
