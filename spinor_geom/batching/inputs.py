"""The inputs of a batch, one after the other: files, patterns, folders, manifests and archives."""

import csv
import glob
import json
import os
import stat
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from spinor_geom.batching.archives import is_archive
from spinor_geom.batching.settings import Limits
from spinor_geom.errors import BatchError
from spinor_geom.files import MESH_SUFFIXES, regular_file, safe_name
from spinor_geom.isolate import FaultError, Process

MANIFESTS = (".csv", ".jsonl")
# The last part of the keys of inputs that are not mesh files. It has no suffix, so that no mesh file has this key.
PROBLEM = "problem"
LONGEST_LINE = 1 << 20  # of a manifest
MOST_NAMED = 5  # suffixes named in an error


@dataclass(frozen=True, kw_only=True)
class Source:
    """One mesh file of a batch, or an input that cannot be used."""

    key: str  # a safe relative path, unique in the batch, and the name of the folder of its results
    path: str  # the file, or the archive that holds it
    member: str = ""  # its name in the archive, if any
    place: int = 0  # its position in the archive, as in `Member`
    size: int = 0  # in bytes
    modified: int = 0  # in nanoseconds
    problem: str = ""  # why it cannot be used, if that is known before it is read
    is_known_format: bool = True


class Inputs:
    """Iterates over the sources of a batch, in the same order each time.

    Only the given names and the files of one folder or pattern are held in memory.
    """

    def __init__(
        self, inputs: Iterable[str | os.PathLike[str]], *, output: str | os.PathLike[str], limits: Limits
    ) -> None:
        """Checks the inputs, and gives each a unique label. The output folder is not searched.

        `limits` are for the process that lists archives. Raises a BatchError if there are no inputs, one does not
        exist, or a pattern matches nothing.
        """
        self._output, self._limits = os.path.realpath(output), limits
        self._roots: list[tuple[str, str]] = []  # paths and labels
        taken: set[str] = set()
        for entry in inputs:
            given = os.fspath(entry)
            is_pattern = not os.path.lexists(given) and glob.has_magic(given)
            if not (next(_matches(given), None) if is_pattern else os.path.exists(given)):
                problem = "matches no file" if is_pattern else "no such file or folder"
                raise BatchError(f"{given}: {problem}; check the name")
            if os.path.realpath(given) == self._output:
                raise BatchError(f"{given}: is the output folder; choose another for the results")
            name = label = os.path.basename(os.path.abspath(_fixed_part(given) if is_pattern else given)) or "root"
            count = 1
            while label.lower() in taken:  # some file systems ignore case
                count += 1
                label = f"{name}~{count}"
            taken.add(label.lower())
            self._roots.append((os.path.abspath(given), label))
        if not self._roots:
            raise BatchError("no inputs; give mesh files, folders, patterns, manifests or archives")

    def __iter__(self) -> Iterator[Source]:
        """The sources. A file that cannot be used is a source with a problem.

        Raises a BatchError if an input has no sources, or if none of the sources is a mesh file.
        """
        self._lister = Process("spinor_geom.batching.archives")
        others: Counter[str] = Counter()
        has_meshes = False
        try:
            for path, label in self._roots:
                self._others: Counter[str] = Counter()  # files of other formats, by suffix
                is_empty = True
                for source in self._sources_of(path, label):
                    is_empty = False
                    has_meshes |= source.is_known_format
                    yield source
                if is_empty:
                    raise BatchError(f"{path}: {_no_meshes(self._others)}")
                others += self._others
        finally:
            self._lister.end()
        if not has_meshes:
            raise BatchError(_no_meshes(others))

    def _sources_of(self, path: str, label: str) -> Iterator[Source]:
        if not os.path.lexists(path):
            start = _fixed_part(path)
            for found in sorted(name for name in _matches(path) if self._is_wanted(name)):
                if not Path(os.path.realpath(found)).is_relative_to(self._output):
                    yield from self._of_file(found, [label, *os.path.relpath(found, start).split(os.sep)])
        elif os.path.isdir(path):
            yield from self._of_folder(path, label)
        elif path.lower().endswith(MANIFESTS):
            yield from self._of_manifest(Path(path), label)
        else:
            yield from self._of_file(path, [label])

    def _of_folder(self, root: str, label: str) -> Iterator[Source]:
        """All mesh files and archives in a folder and its subfolders, without following links."""
        output = os.path.normpath(os.path.join(root, os.path.relpath(self._output, os.path.realpath(root))))
        waiting = [(root, [label])]
        while waiting:  # no recursion: folders may be nested deeper than Python allows calls to be
            path, parts = waiting.pop()
            if path != root and os.path.islink(path):
                yield _unusable(parts, path, "is a link", "give the file itself")
            elif not os.path.isdir(path):
                yield from self._of_file(path, parts)
            elif path != output:
                try:
                    with os.scandir(path) as entries:
                        names = sorted(
                            entry.name
                            for entry in entries
                            if entry.is_dir(follow_symlinks=False) or self._is_wanted(entry.path)
                        )
                    waiting += [(os.path.join(path, name), [*parts, name]) for name in reversed(names)]
                except OSError as error:
                    problem = f"cannot be read ({error.strerror})"
                    yield _unusable([*parts, PROBLEM], path, problem, "check the access rights")

    def _of_file(self, path: str, parts: Sequence[str]) -> Iterator[Source]:
        try:
            status = os.stat(path)
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            yield _unusable(parts, path, f"cannot be read ({reason})", "check the name and the access rights")
            return
        if not stat.S_ISREG(status.st_mode):
            yield _unusable(parts, path, "is not a regular file", "give a file")
        elif is_archive(path):
            yield from self._of_archive(path, parts, status.st_mtime_ns)
        elif path.lower().endswith(MESH_SUFFIXES):
            yield Source(key=safe_name(parts), path=path, size=status.st_size, modified=status.st_mtime_ns)
        else:
            self._others[Path(path).suffix.lower()] += 1
            advice = f"use one of {', '.join(MESH_SUFFIXES)}"
            yield _unusable(parts, path, "is not a mesh file, manifest or archive", advice, is_known_format=False)

    def _of_archive(self, path: str, parts: Sequence[str], modified: int) -> Iterator[Source]:
        with tempfile.TemporaryDirectory() as folder:
            listing = Path(folder, "listing")
            job = {"archive": path, "suffixes": MESH_SUFFIXES, "parts": parts, "listing": str(listing)}
            reported: dict[str, Any] = {}
            try:
                self._lister.run(job, reported.update, seconds=self._limits.seconds, memory=self._limits.memory)
            except FaultError as fault:
                reported["problem"] = f"{path}: {fault}"
            if "problem" in reported:
                yield Source(key=safe_name([*parts, PROBLEM]), path=path, problem=reported["problem"])
                return
            self._others.update(reported.get("others", {}))
            with listing.open(encoding="ascii") as lines:
                for line in lines:
                    yield Source(path=path, modified=modified, **json.loads(line))

    def _is_wanted(self, name: str) -> bool:
        """Whether a file in a folder is read. Others are counted."""
        if os.path.isdir(name):
            return False
        if name.lower().endswith(MESH_SUFFIXES) or is_archive(name):
            return True
        self._others[Path(name).suffix.lower()] += 1
        return False

    def _of_manifest(self, path: Path, label: str) -> Iterator[Source]:
        """The files named by a manifest, relative to its folder: a CSV column "path", or JSON lines."""
        try:
            with regular_file(path).open(encoding="utf-8-sig", newline="") as file:
                rows = _csv_rows(file) if path.suffix.lower() == ".csv" else _json_rows(file)
                for number, entry in rows:
                    parts = [label, f"{number}"]  # the number makes keys unique: a file may be listed twice
                    if entry:
                        parts += entry.replace("\\", "/").strip("/").split("/")
                        yield from self._of_file(os.path.abspath(path.parent / entry), parts)
                    else:
                        yield _unusable([*parts, PROBLEM], str(path), f"row {number} has no path", "complete it")
        except (OSError, csv.Error, ValueError, RecursionError) as error:
            problem = f"cannot be read as a manifest ({error})"
            yield _unusable([label, PROBLEM], str(path), problem, "give a column 'path'")


def listed(file: IO[str]) -> Iterator[Source]:
    """Sources from a file with a line of JSON for each. Only one iteration at a time works."""
    file.seek(0)
    while line := file.readline():
        yield Source(**json.loads(line))


def _fixed_part(pattern: str) -> str:
    """The folder of a pattern above its first wildcard."""
    parts = Path(pattern).parts
    count = next(number for number, part in enumerate(parts) if glob.has_magic(part))
    return os.path.join(*parts[:count]) if count else "."


def _matches(pattern: str) -> Iterator[str]:
    """Paths that match a pattern, as in a shell: hidden files only if named. ** does not follow links to folders."""
    start = Path(_fixed_part(pattern))
    parts = Path(pattern).parts[0 if start == Path() else len(start.parts) :]
    hidden = any(part.startswith(".") for part in parts)
    # a final ** matches only folders
    for found in start.glob(os.path.join(*parts, *(["*"] if parts[-1] == "**" else []))):
        if hidden or not any(part.startswith(".") for part in found.relative_to(start).parts):
            yield str(found)


def _no_meshes(others: Counter[str]) -> str:
    """An error message that names the formats that were found instead."""
    by_number = sorted(others.items(), key=lambda entry: (-entry[1], entry[0]))
    found = ", ".join(f"{count} {suffix or 'without a suffix'}" for suffix, count in by_number[:MOST_NAMED])
    more = ", ..." if len(others) > MOST_NAMED else ""
    total = others.total()
    among = f" among {total} file{'' if total == 1 else 's'}: {found}{more}" if others else "; there are no files"
    return f"no mesh files{among} (formats: {', '.join(MESH_SUFFIXES)})"


def _csv_rows(file: Iterable[str]) -> Iterator[tuple[int, str]]:
    rows = csv.DictReader(_short_lines(file))
    if "path" not in (rows.fieldnames or ()):
        raise ValueError("its first line has no column 'path'")
    for number, row in enumerate(rows, start=1):
        yield number, (row["path"] or "").strip()


def _json_rows(file: Iterable[str]) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(_short_lines(file), start=1):
        if line.strip():
            row = json.loads(line)
            path = row.get("path") if isinstance(row, dict) else row
            yield number, path if isinstance(path, str) and _is_encodable(path) else ""


def _is_encodable(path: str) -> bool:
    """Whether a file can have this name. JSON can escape lone surrogates, which are invalid in names."""
    try:
        os.fsencode(path)
    except UnicodeEncodeError:
        return False
    return True


def _short_lines(file: Any) -> Iterator[str]:
    while line := file.readline(LONGEST_LINE):
        if len(line) >= LONGEST_LINE:
            raise ValueError("a line is longer than 1 MiB")
        yield line


def _unusable(parts: Sequence[str], path: str, problem: str, advice: str, *, is_known_format: bool = True) -> Source:
    full = f"{path}: {problem}; {advice}"
    return Source(key=safe_name(parts), path=path, problem=full, is_known_format=is_known_format)
