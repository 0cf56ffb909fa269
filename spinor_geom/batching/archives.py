"""Tar and zip archives: listed by a process without being unpacked, refused as a whole where something is dishonest."""

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
from types import SimpleNamespace
from typing import Any, BinaryIO, cast

from spinor_geom.errors import ArchiveError
from spinor_geom.files import MOST_RATIO, NUMBERED, is_bomb, safe_name
from spinor_geom.isolate import Tell, serve

SUFFIXES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz")
MOST_ZIP_MEMBERS = 200_000  # the list of a zip archive's members is held in memory: half a kilobyte each
# In bytes: of a member's name, and of what may stand in a tar archive's header of any length.
LONGEST_NAME, LONGEST_HEADER = 4096, 1 << 20
# What the modules raise over bytes that are not as they should be, the first of it with no number of the system.
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

_PACKED = {b"\x1f\x8b": "gz", b"BZh": "bz2", b"\xfd7zXZ\x00": "xz"}  # how packed tar archives begin


@dataclass(frozen=True, kw_only=True)
class Member:
    """A file in an archive."""

    name: str
    size: int  # in bytes, unpacked
    place: int  # in a tar archive the offset of its first byte in the unpacked archive; in a zip its number


def is_archive(path: str | os.PathLike[str]) -> bool:
    """Whether a file's name is that of an archive."""
    return os.fspath(path).lower().endswith(SUFFIXES)


def members(path: Path) -> Iterator[Member]:
    """The files in an archive, in its order; only after the last of them is it known that all can be trusted.

    Raises:
        ArchiveError: the archive is damaged or encrypted; or it holds links, devices, absolute names, names with ..,
            names or headers of many pages, or a file, or files in all, that unpack to more than 200 times their size.
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
        self._key: tuple[str, int, int] | None = None
        self._open: zipfile.ZipFile | tarfile.TarFile | None = None

    def open(self, path: str, member: Member) -> BinaryIO:
        """A member's bytes as a stream from its start.

        An archive that has changed or is damaged is an ArchiveError, here or where the stream is read; else OSError.
        """
        with _damage_of(path, member.name):
            status = os.stat(path)
            key = (path, status.st_size, status.st_mtime_ns)
            if key != self._key:
                self.close()
                self._open = zipfile.ZipFile(path) if path.lower().endswith(".zip") else _opened_tar(path)
                self._key = key
            if isinstance(self._open, zipfile.ZipFile):
                part: Any = self._open.open(self._open.infolist()[member.place])
            else:
                entry = tarfile.TarInfo(member.name)
                entry.size, entry.offset_data = member.size, member.place
                part = cast(tarfile.TarFile, self._open).extractfile(entry)
        checked = _damage_of(path, member.name)
        return cast(BinaryIO, SimpleNamespace(read=checked(part.read), seek=checked(part.seek), close=part.close))

    def close(self) -> None:
        """Closes the archive that is open."""
        if self._open is not None:
            self._open.close()
        self._open = self._key = None


def _zip_members(path: Path) -> Iterator[Member]:
    with zipfile.ZipFile(path) as archive:
        listed = archive.infolist()
        if len(listed) > MOST_ZIP_MEMBERS:
            raise _refused(path, f"{len(listed)} members", f"split it: {MOST_ZIP_MEMBERS} are the most")
        total, packed = 0, path.stat().st_size
        for place, entry in enumerate(listed):
            total += entry.file_size
            kind = stat.S_IFMT(entry.external_attr >> 16)
            _require_honest(path, entry.filename, entry.file_size, entry.compress_size)
            _require_honest(path, entry.filename, total, packed)
            if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise _refused(path, f"'{entry.filename}', a link or device", "pack the files themselves")
            if entry.flag_bits & 1:
                raise _refused(path, f"'{entry.filename}', which is encrypted", "pack it without a password")
            if not entry.is_dir():
                yield Member(name=entry.filename, size=entry.file_size, place=place)


def _tar_members(path: Path) -> Iterator[Member]:
    packed = path.stat().st_size
    with _opened_tar(os.fspath(path)) as archive:
        while (entry := archive.next()) is not None:
            _require_honest(path, entry.name, entry.offset_data + entry.size, packed)
            if not (entry.isreg() or entry.isdir()) or entry.issparse():
                raise _refused(path, f"'{entry.name}', a link, device or sparse file", "pack the files themselves")
            if entry.isreg():
                yield Member(name=entry.name, size=entry.size, place=entry.offset_data)
            cast(Any, archive).members.clear()  # which tarfile never does by itself


class _Header(tarfile.TarInfo):
    """A header of a tar archive: one that is damaged is no end, and none is read that is as long as a mesh."""

    @classmethod
    def frombuf(cls, buf: Any, *arguments: Any) -> Any:
        try:
            return super().frombuf(buf, *arguments)
        except tarfile.HeaderError as error:
            if not buf.strip(b"\0"):  # the archive's end, which tarfile takes a damaged one for, too
                raise
            raise tarfile.ReadError(f"a header is damaged: {error}") from error

    def _proc_member(self, archive: tarfile.TarFile) -> Any:
        if not self.isreg() and self.size > LONGEST_HEADER:
            raise _refused(Path(os.fsdecode(archive.name or "")), f"a header of {self.size} bytes", "do not use it")
        return cast(Any, super())._proc_member(archive)


def _opened_tar(path: str) -> tarfile.TarFile:
    with open(path, "rb") as file:
        start = file.read(8)
    kind = next((kind for magic, kind in _PACKED.items() if start.startswith(magic)), "")
    return cast(tarfile.TarFile, cast(Any, tarfile).open(path, f"r:{kind}", tarinfo=_Header))


def _require_honest(path: Path, name: str, size: int, packed: int) -> None:
    if is_bomb(size, packed):
        raise _refused(path, f"a bomb: up to '{name}' it unpacks to over {MOST_RATIO} times its size", "do not use it")
    parts = name.replace("\\", "/").split("/")
    if len(os.fsencode(name)) > LONGEST_NAME:
        raise _refused(path, f"'{name[:60]}…', a name of more than {LONGEST_NAME} bytes", "do not use it")
    if not parts[0] or parts[0].endswith(":") or ".." in parts:
        raise _refused(path, f"'{name}', a name that leads out of it", "do not use it, or pack it anew")


def _refused(path: Path, what: str, advice: str) -> ArchiveError:
    return ArchiveError(f"{path}: the archive holds {what}; {advice}")


def list_members(job: dict[str, Any], tell: Tell) -> None:
    """Lists an archive: a line of JSON for each wanted member, with its key and the fields of its `Member`.

    The job has "archive", its path; "suffixes" of the names that are wanted; "parts" of their keys, before those of
    their own names; "listing", the file. What is told is "listed" after each member, and at the end how many other
    files there are by suffix ("others"), or the "problem".
    """
    seen: Counter[str] = Counter()
    others: Counter[str] = Counter()
    try:
        with open(job["listing"], "w", encoding="ascii") as file:
            for member in members(Path(job["archive"])):
                if member.name.lower().endswith(tuple(job["suffixes"])):
                    inner = (part for part in member.name.replace("\\", "/").split("/") if part not in ("", "."))
                    key = safe_name([*job["parts"], *inner])
                    seen[key.lower()] += 1  # some file systems see no difference between A and a
                    key += f"{NUMBERED}{seen[key.lower()]}" if seen[key.lower()] > 1 else ""
                    entry = {"key": key, "member": member.name, "place": member.place, "size": member.size}
                    file.write(json.dumps(entry) + "\n")
                else:
                    others[Path(member.name).suffix.lower()] += 1
                tell({"listed": member.place})
        tell({"others": others})
    except ArchiveError as error:
        tell({"problem": str(error)})
    except OSError as error:
        tell({"problem": f"{job['archive']}: cannot be read ({error.strerror}); check the access rights"})


if __name__ == "__main__":
    serve(list_members)
