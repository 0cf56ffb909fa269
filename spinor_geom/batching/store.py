"""The output folder of a batch: its lock, and the record and result files of each source.

The record of a source is a JSON file with all results of the source and its loops. Records of two runs over the same
input differ only in the values under "timings".
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
from typing import Any, TypeAlias

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.settings import BatchOptions
from spinor_geom.errors import BatchError, MeshFileError
from spinor_geom.files import atomic_folder, atomic_path, json_text, printable, write_json
from spinor_geom.version import program_version

Writer: TypeAlias = Callable[[Path], object]  # writes one result file to a path

RUN, RECORD, LOCK, LOG = "run.json", "record.json", ".lock", "failures.log"
RESULTS, STAGING = "files", ".staging"
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
# From best to worst. "open": a loop that was not requested. "imperfect": the patch intersects something, or with
# `strict` it is not an exact surface within the tolerance. "failed": a loop without a patch, a file with such a loop,
# or a file that cannot be used. "fault": the file's process crashed or was killed. A resumed batch retries it.
STATUSES = ("done", "open", "imperfect", "failed", "fault")
_FIGURES = ("vertices", "faces", "curves", "closed", "complete", "watertight", "intersection_free")
_FILES = ("filled", "picture", "page")  # of the whole mesh


def failure(key: str, reason: str, *, status: str = "failed") -> dict[str, Any]:
    """The record of a file without results."""
    return {
        "source": key,
        "status": status,
        "reason": printable(reason),
        **dict.fromkeys((*_FIGURES, *_FILES)),
        "notes": [],
        "loops": [],
        "version": program_version(),
        "timings": {},
    }


def summary(record: dict[str, Any]) -> dict[str, Any]:
    """The summary of a record for the engine, without the entries of the loops, which may be numerous."""
    statuses = [loop["status"] for loop in record["loops"]]
    bad = [loop for loop in record["loops"] if loop["status"] not in ("done", "open")]
    return {
        "key": record["source"],
        "status": record["status"],
        "reason": record["reason"],
        "loops": len(statuses),
        "loops_failed": statuses.count("failed"),
        "first": f"loop {bad[0]['index']} ({bad[0]['name'] or 'no name'}): {explanation(bad[0])}" if bad else "",
    }


def explanation(entry: Mapping[str, Any]) -> str:
    """Why a loop or a file is not done, from its record."""
    return str(entry["reason"] or "; ".join(entry["notes"]))


@dataclass(frozen=True, kw_only=True)
class Store:
    """The output folder of one run."""

    output: str  # absolute
    token: str  # identifies the run. It is in run.json too, and a later run in the folder replaces it there

    def folder(self, key: str) -> Path:
        """The folder of a source's results. Raises BatchError if a link leads out of the output folder."""
        folder = Path(self.output, RESULTS, key)
        if not Path(os.path.realpath(folder)).is_relative_to(os.path.realpath(self.output)):
            raise BatchError(f"{folder}: is a link to outside the output folder; remove the link")
        return folder

    def record(self, key: str) -> dict[str, Any] | None:
        """The record of a source, if there is a complete one."""
        try:
            record = json.loads(Path(self.output, RESULTS, key, RECORD).read_bytes())
        except (OSError, ValueError, RecursionError):
            return None
        return record if isinstance(record, dict) else None

    @property
    def log(self) -> Path:
        """The file with a line for each failure."""
        return Path(self.output, LOG)

    def completed(self, source: Source) -> dict[str, Any] | None:
        """The summary of a source whose results are all there and up to date, else None."""
        record = self.record(source.key)
        if record is None or record.get("status") == "fault":
            return None
        if (record.get("source"), record.get("input")) != (source.key, _stamp(source)):
            return None
        folder = Path(self.output, RESULTS, source.key)
        try:
            files = [name for loop in record["loops"] for name in loop["files"].values()]
            files += [record[name] for name in _FILES if record[name]]
            return summary(record) if all((folder / name).is_file() for name in files) else None
        except (KeyError, TypeError):  # edited, or written by another version
            return None

    def commit(self, source: Source, record: dict[str, Any], files: Mapping[str, Writer]) -> dict[str, Any]:
        """Writes the results of a source, all or none, and returns the summary.

        If they cannot be written, the record gives the reason. A BatchError is raised if another run has started in the
        folder, a link leads out of it, or the disk is full.
        """
        owner = (self.record(source.key) or {}).get("source", source.key)
        if owner != source.key:
            why = "as the disk ignores upper and lower case; rename one of the files"
            return summary(failure(source.key, f"{owner} has the same results folder, {why}"))
        try:
            self._write(source, record, files)
        except (OSError, MeshFileError) as error:
            # writers of meshes raise MeshFileError from the error of the disk
            cause = error if isinstance(error, OSError) else error.__cause__
            reason, status = str(error), "failed"  # the format does not hold the mesh
            if isinstance(cause, OSError):
                status = "fault"
                self._require_room(cause)
                reason = f"its results cannot be written ({cause}); check the output folder"
            record = failure(source.key, reason, status=status)
            with suppress(OSError):
                self._write(source, record, {})
        return summary(record)

    def fail(self, source: Source, reason: str, *, status: str = "fault") -> dict[str, Any]:
        """Like `commit`, for a source without results."""
        return self.commit(source, failure(source.key, reason, status=status), {})

    def _write(self, source: Source, record: Mapping[str, Any], files: Mapping[str, Writer]) -> None:
        target = self.folder(source.key)
        with atomic_folder(target, staging=Path(self.output, STAGING)) as folder:
            for name, write in files.items():
                write(folder / name)
            (folder / RECORD).write_text(json_text({**record, "input": _stamp(source)}), encoding="utf-8")
            try:
                owner = json.loads(Path(self.output, RUN).read_bytes())["token"]
            except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
                raise BatchError(f"{self.output}: {RUN} cannot be read ({error}); this run stops") from error
            if owner != self.token:
                raise BatchError(f"{self.output}: another run was started in this folder, and this run has ended")

    def _require_room(self, error: OSError) -> None:
        """Raises a BatchError if nothing can be written to the output folder any more."""
        if error.errno not in FULL:
            try:
                with atomic_path(Path(self.output, STAGING, "room")):
                    return
            except OSError as raised:
                error = raised
        raise BatchError(
            f"{self.output}: cannot be written to ({error.strerror}); free space on the disk and resume"
        ) from error


def _stamp(source: Source) -> list[int | str]:
    """The values that show whether a source, or its problem, has changed."""
    return [source.size, source.modified, source.problem]


def log_line(summary: dict[str, Any]) -> str:
    """A line of the log: status, key and reason of a file."""
    parts = (summary["status"], summary["key"], summary["reason"] or summary["first"])
    return "\t".join(printable(" ".join(str(part).split())) for part in parts) + "\n"


@contextmanager
def opened_store(output: str | os.PathLike[str], options: BatchOptions, *, resume: bool) -> Iterator[Store]:
    """Locks the output folder, which is new, empty, or that of the run to resume. Raises a BatchError otherwise."""
    import filelock

    root = Path(os.path.realpath(output))
    try:
        root.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise BatchError(f"{output}: is a file or below a file; choose a folder") from error
    lock = filelock.FileLock(root / LOCK)
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        raise BatchError(f"{output}: another batch is writing to this folder; wait for it or choose another") from None
    try:
        settings = json.loads(json_text({"options": asdict(options), "version": program_version()}))
        _require_same_run(root, settings, resume=resume)
        store = Store(output=str(root), token=secrets.token_hex(16))
        write_json(root / RUN, {**settings, "token": store.token})
        shutil.rmtree(root / STAGING, ignore_errors=True)  # left by an interrupted run
        yield store
        shutil.rmtree(root / STAGING, ignore_errors=True)
    finally:
        lock.release()


def _require_same_run(root: Path, settings: dict[str, Any], *, resume: bool) -> None:
    names = {entry.name for entry in root.iterdir()} - {LOCK, STAGING}
    if names <= {RUN, LOG}:  # no results yet
        return
    if RUN not in names:
        raise BatchError(f"{root}: contains other files ({min(names)}); choose a new folder")
    if not resume:
        raise BatchError(f"{root}: already contains a batch; resume it (--resume, resume=True) or choose a new folder")
    try:
        before = dict(json.loads((root / RUN).read_bytes()))
    except (ValueError, TypeError, RecursionError) as error:
        raise BatchError(f"{root / RUN}: is damaged ({error}); choose a new folder") from error
    for kind, name in (("options", "options"), ("version", "versions of this program")):
        if before.get(kind) != settings[kind]:
            raise BatchError(
                f"{root}: was started with other {name} ({before.get(kind)}, not {settings[kind]}); "
                "use the same, or choose a new folder"
            )
