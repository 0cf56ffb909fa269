"""The inputs of a batch, one after the other: files, patterns, folders, manifests and archives, never all in memory."""

from __future__ import annotations

import csv
import glob
import heapq
import json
import os
import re
import stat
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from spinor_geom.batching.archives import Member, is_archive, members
from spinor_geom.batching.names import safe_name
from spinor_geom.errors import ArchiveError, BatchError

SUFFIX = ".obj"
MANIFESTS = (".csv", ".jsonl")
# Names that are sorted in memory; more are sorted in temporary files.
SORTED_AT_ONCE = 50_000
# The last part of the key of what is no OBJ file: such a part has no suffix, so that no file's key can be the same.
PROBLEM = "problem"
LONGEST_LINE = 1 << 20  # of a manifest
# Files of so many bytes together are read at once, and their loops solved side by side.
SMALL = 1 << 20


@dataclass(frozen=True, kw_only=True)
class Source:
    """One OBJ file of a batch, or an input that is none.

    Attributes:
        key: its name, and that of its folder of results: a harmless relative path, different for different inputs.
        path: the file, or the archive that it is in.
        member: where it is in the archive.
        size: in bytes.
        modified: the time of its last change, in nanoseconds.
        problem: why it cannot be read, if that is known already.
    """

    key: str
    path: str
    member: Member | None = None
    size: int = 0
    modified: int = 0
    problem: str = ""

    def to_dict(self) -> dict[str, Any]:
        """The source in JSON's types."""
        return asdict(self)

    @classmethod
    def from_dict(cls, entry: dict[str, Any]) -> Source:
        """What `to_dict` gave."""
        member = entry["member"]
        return cls(**{**entry, "member": None if member is None else Member(**member)})


class Inputs:
    """The inputs of a batch, which can be gone through any number of times, always in the same order.

    Raises:
        BatchError: an input does not exist, or a pattern fits nothing.
    """

    def __init__(self, inputs: Iterable[str | os.PathLike[str]], *, output: str | os.PathLike[str]) -> None:
        """Gives every input a name of its own; reads nothing yet.

        Args:
            inputs: files, patterns, folders, manifests, archives; their names are held in memory, what is in them not.
            output: a folder that is not searched: results are no inputs.
        """
        self._output = os.path.realpath(output)
        self._roots: list[tuple[str, str]] = []
        taken: dict[str, int] = {}
        for named in inputs:
            given = os.fspath(named)
            pattern = not os.path.lexists(given) and glob.has_magic(given)
            if not (next(glob.iglob(given, recursive=True), None) if pattern else os.path.exists(given)):
                raise BatchError(f"{given}: {'fits no file' if pattern else 'no such file or folder'}; check the name")
            if os.path.realpath(given) == self._output:
                raise BatchError(f"{given}: is the output folder; name another for the results")
            label = os.path.basename(os.path.abspath(_fixed_part(given) if pattern else given)) or "root"
            count = taken[label] = taken.get(label, 0) + 1
            self._roots.append((os.path.abspath(given), label if count == 1 else f"{label}~{count}"))
        if not self._roots:
            raise BatchError("no inputs; name OBJ files, folders, patterns, manifests or archives")

    def __iter__(self) -> Iterator[Source]:
        """One source after the other; what cannot be read is one with a problem."""
        for path, label in self._roots:
            yield from _expanded(path, label, self._output)


def _expanded(path: str, label: str, output: str) -> Iterator[Source]:
    if not os.path.lexists(path):
        start = _fixed_part(path)
        for found in _sorted(name for name in glob.iglob(path, recursive=True) if _is_wanted(name)):
            if Path(os.path.realpath(found)).is_relative_to(output):
                continue
            yield from _of_file(found, [label, *os.path.relpath(found, start).split(os.sep)])
    elif os.path.isdir(path):
        yield from _of_folder(path, [label], output)
    elif path.lower().endswith(MANIFESTS):
        yield from _of_manifest(Path(path), label)
    else:
        yield from _of_file(path, [label])


def _fixed_part(pattern: str) -> str:
    """The folder of a pattern above its first part that is one."""
    parts = Path(pattern).parts
    count = next(number for number, part in enumerate(parts) if glob.has_magic(part))
    return os.path.join(*parts[:count]) if count else "."


def _is_wanted(name: str) -> bool:
    return (name.lower().endswith(SUFFIX) or is_archive(name)) and not os.path.isdir(name)


def _of_folder(folder: str, parts: Sequence[str], output: str) -> Iterator[Source]:
    """All OBJ files and archives in a folder and those below it; links to folders are not followed."""
    if os.path.realpath(folder) == output:
        return
    names = _sorted(_wanted_names(folder))
    while True:
        try:
            name = next(names)
        except StopIteration:
            return
        except OSError as error:
            yield _problem([*parts, PROBLEM], folder, f"cannot be read ({error.strerror})", "check the access rights")
            return
        path, inner = os.path.join(folder, name), [*parts, name]
        if os.path.isdir(path) and not os.path.islink(path):
            yield from _of_folder(path, inner, output)
        elif os.path.islink(path):
            yield _problem(inner, path, "is a link", "name the file itself")
        else:
            yield from _of_file(path, inner)


def _wanted_names(folder: str) -> Iterator[str]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False) or _is_wanted(entry.path):
                yield entry.name


def _of_file(path: str, parts: Sequence[str]) -> Iterator[Source]:
    """An OBJ file, or those in an archive."""
    try:
        status = os.stat(path)
    except OSError as error:
        yield _problem(parts, path, f"cannot be read ({error.strerror})", "check the name and the access rights")
        return
    if not stat.S_ISREG(status.st_mode):
        yield _problem(parts, path, "is no regular file", "name a file")
    elif is_archive(path):
        try:
            for member in members(Path(path)):
                if member.name.lower().endswith(SUFFIX):
                    inner = re.split(r"[/\\]", member.name)
                    yield Source(
                        key=safe_name([*parts, *(part for part in inner if part not in ("", "."))]),
                        path=path,
                        member=member,
                        size=member.size,
                        modified=status.st_mtime_ns,
                    )
        except ArchiveError as error:
            yield Source(key=safe_name([*parts, PROBLEM]), path=path, problem=str(error))
    elif path.lower().endswith(SUFFIX):
        yield Source(key=safe_name(parts), path=path, size=status.st_size, modified=status.st_mtime_ns)
    else:
        yield _problem(parts, path, "is no OBJ file, manifest or archive", "convert it first")


def _of_manifest(path: Path, label: str) -> Iterator[Source]:
    """The files that a manifest names, relative to its folder: a CSV column or JSON lines with "path"."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = _csv_rows(file) if path.suffix.lower() == ".csv" else _json_rows(file)
            for number, entry in rows:
                if not entry:
                    yield _problem(
                        [label, f"{number}", PROBLEM], str(path), f"row {number} names no path", "complete it"
                    )
                    continue
                named = os.path.abspath(path.parent / entry)
                # a file may be listed twice
                yield from _of_file(named, [label, f"{number}", *entry.replace("\\", "/").strip("/").split("/")])
    except (OSError, csv.Error, ValueError, RecursionError) as error:
        yield _problem([label, PROBLEM], str(path), f"cannot be read as a manifest ({error})", "give a column 'path'")


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
            yield number, path if isinstance(path, str) else ""


def _short_lines(file: Any) -> Iterator[str]:
    while line := file.readline(LONGEST_LINE):
        if len(line) >= LONGEST_LINE:
            raise ValueError("a line is longer than 1 MiB")
        yield line


def _problem(parts: Sequence[str], path: str, problem: str, advice: str) -> Source:
    return Source(key=safe_name(parts), path=path, problem=f"{path}: {problem}; {advice}")


def _sorted(names: Iterable[str]) -> Iterator[str]:
    """Names in order; of a folder with very many of them only a part is in memory at a time."""
    remaining = iter(names)
    with ExitStack() as stack:
        runs: list[Any] = []
        while part := sorted(islice(remaining, SORTED_AT_ONCE)):
            if not runs and len(part) < SORTED_AT_ONCE:
                yield from part
                return
            run = stack.enter_context(tempfile.TemporaryFile("w+", encoding="ascii"))
            runs.append(run)
            run.writelines(json.dumps(name) + "\n" for name in part)
            run.seek(0)
        yield from heapq.merge(*(map(json.loads, run) for run in runs))
