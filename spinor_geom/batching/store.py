"""The output folder of a batch: where results go, who may write them, and what is complete; nothing else survives.

What is known of a file and its loops is its record, in JSON's types. All that may differ between two runs over the same
input stands under the keys "timings". Imports nothing heavy.
"""

import errno
import json
import os
import secrets
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.options import BatchOptions
from spinor_geom.errors import BatchError, MeshFileError
from spinor_geom.files import atomic_folder, atomic_path, json_text, printable, write_json
from spinor_geom.version import program_version

RUN, RECORD, LOCK, LOG = "run.json", "record.json", ".lock", "failures.log"
RESULTS, STAGING, ROOM = "files", ".staging", "room"
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # a disk that takes no more, or only small files
# From good to bad. "open": a loop that was not to be filled. "imperfect": the patch crosses something, or with `strict`
# it is not an exact surface within the tolerance. "failed": a loop without a patch, a file with such a loop, or a file
# that cannot be used. "fault": the file's process died or was ended; a resumed batch tries it again.
STATUSES = ("done", "open", "imperfect", "failed", "fault")
_FIGURES = ("vertices", "faces", "curves", "closed", "complete", "watertight", "intersection_free", "filled")


def failure(key: str, reason: str, *, status: str = "failed") -> dict[str, Any]:
    """The record of a file that has no results."""
    return {
        "source": key,
        "status": status,
        "reason": printable(reason),
        **dict.fromkeys(_FIGURES),
        "notes": [],
        "loops": [],
        "version": program_version(),
        "timings": {},
    }


def summary(record: dict[str, Any]) -> dict[str, Any]:
    """What the driver is told of a file: few bytes, however many loops it has."""
    statuses = [loop["status"] for loop in record["loops"]]
    bad = [loop for loop in record["loops"] if loop["status"] not in ("done", "open")]
    return {
        "key": record["source"],
        "status": record["status"],
        "reason": record["reason"],
        "loops": len(statuses),
        "loops_failed": statuses.count("failed"),
        "first": "" if not bad else f"loop {bad[0]['index']} ({bad[0]['name'] or 'no name'}): {said(bad[0])}",
    }


def said(entry: Mapping[str, Any]) -> str:
    """Why a loop or a file is not done, by its record."""
    return str(entry["reason"] or "; ".join(entry["notes"]))


@dataclass(frozen=True, kw_only=True)
class Store:
    """An output folder, and the run that has it."""

    output: str  # absolute
    token: str  # of the run: one that was cut off from its folder must not write to it any more

    def folder(self, key: str) -> Path:
        """Where the results of a source are; BatchError where links lead from there out of the output folder."""
        folder = Path(self.output, RESULTS, key)
        if not Path(os.path.realpath(folder)).is_relative_to(os.path.realpath(self.output)):
            raise BatchError(f"{folder}: leads out of the output folder; remove the link")
        return folder

    def record(self, key: str) -> dict[str, Any] | None:
        """The record of a source, if there is a whole one."""
        try:
            record = json.loads(Path(self.output, RESULTS, key, RECORD).read_bytes())
        except (OSError, ValueError):
            return None
        return record if isinstance(record, dict) else None

    @property
    def log(self) -> Path:
        """The file of failures."""
        return Path(self.output, LOG)

    def completed(self, source: Source) -> dict[str, Any] | None:
        """The summary of a source whose results are all there, and still those of the source as it is now."""
        record = self.record(source.key)
        if record is None or record.get("status") == "fault":
            return None
        if (record.get("source"), record.get("input")) != (source.key, stamp(source)):
            return None
        folder = Path(self.output, RESULTS, source.key)
        try:
            files = [name for loop in record["loops"] for name in loop["files"].values()]
            files += [record["filled"]] if record["filled"] else []
            return summary(record) if all((folder / name).is_file() for name in files) else None
        except (KeyError, TypeError):
            return None

    def commit(
        self, source: Source, record: dict[str, Any], files: Mapping[str, Callable[[Path], object]]
    ) -> dict[str, Any]:
        """Writes the results of a source, all or none; gives the summary, or one that says why they cannot be written.

        BatchError is raised where another run has the folder now, links lead out of it, or it takes no more files.
        """
        held = (self.record(source.key) or {}).get("source", source.key)
        if held != source.key:
            reason = f"the results of {held} have the same folder on a disk that takes A for a; rename one of the files"
            return summary(failure(source.key, reason))
        try:
            self._place(source, record, files)
        except (OSError, MeshFileError) as error:
            reason = str(error)
            if isinstance(error, OSError):
                self._require_room(error)
                reason = f"its results cannot be written ({error}); see what is there"
            record = failure(source.key, reason, status="fault")
            with suppress(OSError):
                self._place(source, record, {})
        return summary(record)

    def fail(self, source: Source, reason: str, *, status: str = "fault") -> dict[str, Any]:
        """As `commit`, of a source that has no results."""
        return self.commit(source, failure(source.key, reason, status=status), {})

    def _place(self, source: Source, record: Mapping[str, Any], files: Mapping[str, Callable[[Path], object]]) -> None:
        target = self.folder(source.key)
        with atomic_folder(target, staging=Path(self.output, STAGING)) as folder:
            for name, write in files.items():
                write(folder / name)
            (folder / RECORD).write_text(json_text({**record, "input": stamp(source)}), encoding="utf-8")
            try:
                owner = json.loads(Path(self.output, RUN).read_bytes())["token"]
            except (OSError, ValueError, KeyError) as error:
                raise BatchError(f"{self.output}: {RUN} cannot be read ({error}); the run ends here") from error
            if owner != self.token:
                raise BatchError(f"{self.output}: another run has taken the folder over; this one ends here")

    def _require_room(self, error: OSError) -> None:
        """Checks after an error that it is not one of the whole folder, which raises BatchError."""
        if error.errno not in FULL:
            try:
                with atomic_path(Path(self.output, STAGING, ROOM)):
                    return
            except OSError as found:
                error = found
        raise BatchError(f"{self.output}: cannot be written to ({error.strerror}); make room and resume") from error


def stamp(source: Source) -> list[int | str]:
    """What tells whether a source has changed, or why it cannot be read."""
    return [source.size, source.modified, source.problem]


def log_line(one: dict[str, Any]) -> str:
    """A failure as a line: what became of which source, and why."""
    parts = (one["status"], one["key"], one["reason"] or one["first"])
    return "\t".join(printable(" ".join(str(part).split())) for part in parts) + "\n"


@contextmanager
def opened_store(output: str | os.PathLike[str], options: BatchOptions, *, resume: bool) -> Iterator[Store]:
    """An output folder, made or empty or with a run to go on, which no other can have meanwhile; else BatchError."""
    import filelock

    root = Path(os.path.realpath(output))
    try:
        root.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise BatchError(f"{output}: is a file, or lies below one; name a folder") from error
    lock = filelock.FileLock(root / LOCK)
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        raise BatchError(f"{output}: another batch is writing to this folder; wait for it or name another") from None
    try:
        settings = json.loads(json_text({"options": asdict(options), "version": program_version()}))
        _require_same(root, settings, resume=resume)
        store = Store(output=str(root), token=secrets.token_hex(16))
        write_json(root / RUN, {**settings, "token": store.token})
        shutil.rmtree(root / STAGING, ignore_errors=True)  # what a run that was cut off has left half written
        yield store
        shutil.rmtree(root / STAGING, ignore_errors=True)
    finally:
        lock.release()


def _require_same(root: Path, settings: dict[str, Any], *, resume: bool) -> None:
    held = {entry.name for entry in root.iterdir()} - {LOCK, STAGING}
    if held <= {RUN, LOG}:  # a run that did not get as far as to a result has left nothing to be careful with
        return
    if RUN not in held:
        raise BatchError(f"{root}: holds other things ({min(held)}); name a new folder")
    if not resume:
        raise BatchError(f"{root}: holds a batch already; resume it (--resume, resume=True) or name a new folder")
    try:
        before = json.loads((root / RUN).read_bytes())
    except ValueError as error:
        raise BatchError(f"{root / RUN}: is damaged ({error}); name a new folder") from error
    for kind in ("options", "version"):
        if before.get(kind) != settings[kind]:
            raise BatchError(
                f"{root}: was begun with other {'options' if kind == 'options' else 'versions of this program'} "
                f"({before.get(kind)}, not {settings[kind]}); use the same, or name a new folder"
            )
