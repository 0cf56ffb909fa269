"""The inputs of a batch, one after the other: files, patterns, folders, manifests and archives, never all in memory."""

import csv
import glob
import json
import os
import re
import stat
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from spinor_geom.batching.archives import is_archive
from spinor_geom.batching.options import Limits
from spinor_geom.errors import BatchError
from spinor_geom.files import MESH_SUFFIXES, safe_name
from spinor_geom.isolate import FaultError, Process

LISTER = "spinor_geom.batching.archives"
MANIFESTS = (".csv", ".jsonl")
# The last part of the key of what is no mesh file: such a part has no suffix, so that no file's key can be the same.
PROBLEM = "problem"
# Halves of characters, which no name has; those that stand for single bytes are others.
HALVES = re.compile("[\ud800-\udc7f\udd00-\udfff]")
LONGEST_LINE = 1 << 20  # of a manifest
CONVERT = f"use one of {', '.join(MESH_SUFFIXES)}"  # the advice for a file of another format
MOST_NAMED = 5  # suffixes of files that are no meshes, in an error
SMALL = 1 << 20  # files of so many bytes together are read at once, and their loops solved side by side


@dataclass(frozen=True, kw_only=True)
class Source:
    """One mesh file of a batch, or an input that is none."""

    key: str  # that of its folder of results, too: a harmless relative path, different for different inputs
    path: str  # the file, or the archive that it is in
    member: str = ""  # its name in the archive, if it is in one
    place: int = 0  # where in the archive, as of `Member`
    size: int = 0  # in bytes
    modified: int = 0  # in nanoseconds
    problem: str = ""  # why it cannot be read, if that is known already


class Inputs:
    """The inputs of a batch, in an order that is always the same.

    In memory are their names, and those in one folder, or that fit one pattern, at a time. The output folder is not
    searched; the limits are for the list of an archive.
    """

    def __init__(
        self, inputs: Iterable[str | os.PathLike[str]], *, output: str | os.PathLike[str], limits: Limits
    ) -> None:
        """Gives every input a name of its own; BatchError where one does not exist, or a pattern fits nothing."""
        self._output, self._limits = os.path.realpath(output), limits
        self._roots: list[tuple[str, str]] = []
        taken: set[str] = set()
        for named in inputs:
            given = os.fspath(named)
            pattern = not os.path.lexists(given) and glob.has_magic(given)
            if not (next(_fitting(given), None) if pattern else os.path.exists(given)):
                raise BatchError(f"{given}: {'fits no file' if pattern else 'no such file or folder'}; check the name")
            if os.path.realpath(given) == self._output:
                raise BatchError(f"{given}: is the output folder; name another for the results")
            wanted = label = os.path.basename(os.path.abspath(_fixed_part(given) if pattern else given)) or "root"
            count = 1
            while label.lower() in taken:  # some file systems see no difference between A and a
                count += 1
                label = f"{wanted}~{count}"
            taken.add(label.lower())
            self._roots.append((os.path.abspath(given), label))
        if not self._roots:
            raise BatchError("no inputs; name mesh files, folders, patterns, manifests or archives")

    def __iter__(self) -> Iterator[Source]:
        """One source after the other; what cannot be read is one with a problem.

        Raises a BatchError, which says what was found, where an input has no sources, or all have no mesh files.
        """
        self._lister = Process(LISTER)
        others: Counter[str] = Counter()
        has_sources = False
        try:
            for path, label in self._roots:
                self._others: Counter[str] = Counter()
                is_empty = True
                for source in self._expanded(path, label):
                    is_empty = False
                    has_sources |= not source.problem.endswith(CONVERT)
                    yield source
                if is_empty:
                    raise BatchError(f"{path}: {_said(self._others)}")
                others += self._others
        finally:
            self._lister.end()
        if not has_sources:
            raise BatchError(_said(others))

    def _expanded(self, path: str, label: str) -> Iterator[Source]:
        if not os.path.lexists(path):
            start = _fixed_part(path)
            for found in sorted(name for name in _fitting(path) if self._is_wanted(name)):
                if not Path(os.path.realpath(found)).is_relative_to(self._output):
                    yield from self._of_file(found, [label, *os.path.relpath(found, start).split(os.sep)])
        elif os.path.isdir(path):
            yield from self._of_folder(path, label)
        elif path.lower().endswith(MANIFESTS):
            yield from self._of_manifest(Path(path), label)
        else:
            yield from self._of_file(path, [label])

    def _of_folder(self, root: str, label: str) -> Iterator[Source]:
        """All mesh files and archives in a folder and those below it; links to folders are not followed."""
        # no links are followed, so there is only one way to it
        output = os.path.normpath(os.path.join(root, os.path.relpath(self._output, os.path.realpath(root))))
        waiting = [(root, [label])]
        while waiting:
            path, parts = waiting.pop()
            if path != root and os.path.islink(path):
                yield _problem(parts, path, "is a link", "name the file itself")
            elif not os.path.isdir(path):
                yield from self._of_file(path, parts)
            elif path != output:
                try:
                    with os.scandir(path) as found:
                        names = [
                            one.name for one in found if one.is_dir(follow_symlinks=False) or self._is_wanted(one.path)
                        ]
                    waiting += [(os.path.join(path, name), [*parts, name]) for name in sorted(names, reverse=True)]
                except OSError as error:
                    problem = f"cannot be read ({error.strerror})"
                    yield _problem([*parts, PROBLEM], path, problem, "check the access rights")

    def _of_file(self, path: str, parts: Sequence[str]) -> Iterator[Source]:
        try:
            status = os.stat(path)
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            yield _problem(parts, path, f"cannot be read ({reason})", "check the name and the access rights")
            return
        if not stat.S_ISREG(status.st_mode):
            yield _problem(parts, path, "is no regular file", "name a file")
        elif is_archive(path):
            yield from self._of_archive(path, parts, status.st_mtime_ns)
        elif path.lower().endswith(MESH_SUFFIXES):
            yield Source(key=safe_name(parts), path=path, size=status.st_size, modified=status.st_mtime_ns)
        else:
            self._others[Path(path).suffix.lower()] += 1
            yield _problem(parts, path, "is no mesh file, manifest or archive", CONVERT)

    def _of_archive(self, path: str, parts: Sequence[str], modified: int) -> Iterator[Source]:
        with tempfile.TemporaryDirectory() as folder:
            listing = Path(folder, "listing")
            job = {"archive": path, "suffixes": MESH_SUFFIXES, "parts": parts, "listing": str(listing)}
            told: dict[str, Any] = {}
            try:
                self._lister.run(job, told.update, seconds=self._limits.seconds, memory=self._limits.memory)
            except FaultError as fault:
                told["problem"] = f"{path}: {fault}"
            if "problem" in told:
                yield Source(key=safe_name([*parts, PROBLEM]), path=path, problem=told["problem"])
                return
            self._others.update(told.get("others", {}))
            with listing.open(encoding="ascii") as lines:
                for line in lines:
                    yield Source(path=path, modified=modified, **json.loads(line))

    def _is_wanted(self, name: str) -> bool:
        """Whether a file in a folder is read; others are counted."""
        if os.path.isdir(name):
            return False
        if name.lower().endswith(MESH_SUFFIXES) or is_archive(name):
            return True
        self._others[Path(name).suffix.lower()] += 1
        return False

    def _of_manifest(self, path: Path, label: str) -> Iterator[Source]:
        """The files that a manifest names, relative to its folder: a CSV column or JSON lines with "path"."""
        try:
            with path.open(encoding="utf-8-sig", newline="") as file:
                rows = _csv_rows(file) if path.suffix.lower() == ".csv" else _json_rows(file)
                for number, entry in rows:
                    own = [label, f"{number}"]  # a file may be listed twice
                    if entry:
                        parts = [*own, *entry.replace("\\", "/").strip("/").split("/")]
                        yield from self._of_file(os.path.abspath(path.parent / entry), parts)
                    else:
                        yield _problem([*own, PROBLEM], str(path), f"row {number} names no path", "complete it")
        except (OSError, csv.Error, ValueError, RecursionError) as error:
            problem = f"cannot be read as a manifest ({error})"
            yield _problem([label, PROBLEM], str(path), problem, "give a column 'path'")


def listed(file: IO[str]) -> Iterator[Source]:
    """Sources from a file with a line of JSON for each; one iteration at a time."""
    file.seek(0)
    while line := file.readline():
        yield Source(**json.loads(line))


def _fixed_part(pattern: str) -> str:
    """The folder of a pattern above its first part that is one."""
    parts = Path(pattern).parts
    count = next(number for number, part in enumerate(parts) if glob.has_magic(part))
    return os.path.join(*parts[:count]) if count else "."


def _fitting(pattern: str) -> Iterator[str]:
    """What fits a pattern, as a shell sees it; ** follows no links to folders, which may lead back."""
    start = Path(_fixed_part(pattern))
    parts = Path(pattern).parts[0 if start == Path() else len(start.parts) :]
    hidden = any(part.startswith(".") for part in parts)
    # the last ** alone would fit folders only
    for found in start.glob(os.path.join(*parts, *(["*"] if parts[-1] == "**" else []))):
        if hidden or not any(part.startswith(".") for part in found.relative_to(start).parts):
            yield str(found)


def _said(others: Counter[str]) -> str:
    """That there is no mesh file, and what there is."""
    named = sorted(others.items(), key=lambda entry: (-entry[1], entry[0]))
    found = ", ".join(f"{count} {suffix or 'without a suffix'}" for suffix, count in named[:MOST_NAMED])
    more = ", ..." if len(others) > MOST_NAMED else ""
    total = others.total()
    among = f" among {total} file{'' if total == 1 else 's'}: {found}{more}" if others else "; there are no files"
    return f"no mesh files{among} (formats: {', '.join(MESH_SUFFIXES)})"


def _csv_rows(file: Iterable[str]) -> Iterator[tuple[int, str]]:
    rows = csv.DictReader(_short_lines(file))
    if "path" not in (rows.fieldnames or ()):
        raise ValueError("its first line names no column 'path'")
    for number, row in enumerate(rows, start=1):
        yield number, (row["path"] or "").strip()


def _json_rows(file: Iterable[str]) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(_short_lines(file), start=1):
        if line.strip():
            row = json.loads(line)
            path = row.get("path") if isinstance(row, dict) else row
            yield number, path if isinstance(path, str) and not HALVES.search(path) else ""


def _short_lines(file: Any) -> Iterator[str]:
    while line := file.readline(LONGEST_LINE):
        if len(line) >= LONGEST_LINE:
            raise ValueError("a line is longer than 1 MiB")
        yield line


def _problem(parts: Sequence[str], path: str, problem: str, advice: str) -> Source:
    return Source(key=safe_name(parts), path=path, problem=f"{path}: {problem}; {advice}")
