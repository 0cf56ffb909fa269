"""The driver's side of an output folder: the lock, what the run is, what of it is complete, and its log."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.options import BatchOptions
from spinor_geom.batching.records import summary
from spinor_geom.batching.store import RUN, STAGING, Store, stamp
from spinor_geom.errors import BatchError
from spinor_geom.files import write_json
from spinor_geom.version import program_version

LOCK, LOG = ".lock", "failures.log"


class Journal:
    """What is done in an output folder, as its files tell: nothing else has to survive a crash."""

    def __init__(self, store: Store, log: Path) -> None:
        """Takes a folder that this run has the lock of."""
        self.store, self.log = store, log

    def completed(self, source: Source) -> dict[str, Any] | None:
        """The summary of a source whose results are all there, and still those of the source as it is now."""
        record = self.store.record(source.key)
        if record is None or record.get("status") == "fault" or record.get("input") != stamp(source):
            return None
        try:
            return summary(record)
        except (KeyError, TypeError):
            return None

    def log_failure(self, one: dict[str, Any]) -> None:
        """Adds a line to the log."""
        with self.log.open("a", encoding="utf-8") as file:
            file.write(log_line(one))


def log_line(one: dict[str, Any]) -> str:
    """A failure as a line: what became of which source, and why."""
    return (
        "\t".join(" ".join(str(part).split()) for part in (one["status"], one["key"], one["reason"] or one["first"]))
        + "\n"
    )


@contextmanager
def opened_journal(output: str | os.PathLike[str], options: BatchOptions, *, resume: bool) -> Iterator[Journal]:
    """The journal of an output folder, which no other run can have at the same time.

    Args:
        output: the folder; is made if it does not exist.
        options: of the run.
        resume: whether a run that was begun there goes on; else the folder must be empty.

    Raises:
        BatchError: another run has the folder, or holds something already, or the run there has other options.
        OSError: the folder cannot be made or written to.
    """
    import filelock

    root = Path(os.path.realpath(output))
    root.mkdir(parents=True, exist_ok=True)
    lock = filelock.FileLock(root / LOCK)
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        raise BatchError(f"{output}: another batch is writing to this folder; wait for it or name another") from None
    try:
        settings = {"options": options.to_dict(), "version": program_version()}
        _require_same(root, settings, resume=resume)
        store = Store(output=str(root), token=secrets.token_hex(16))
        write_json(root / RUN, {**settings, "token": store.token})
        # what a run that was cut off has left half written
        shutil.rmtree(root / STAGING, ignore_errors=True)
        yield Journal(store, root / LOG)
        shutil.rmtree(root / STAGING, ignore_errors=True)
    finally:
        lock.release()


def _require_same(root: Path, settings: dict[str, Any], *, resume: bool) -> None:
    held = {entry.name for entry in root.iterdir()} - {LOCK, STAGING}
    # a run that did not get as far as to a result has left nothing to be careful with
    if held <= {RUN, LOG}:
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
