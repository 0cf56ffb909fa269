"""The output folder of a batch as every process of it sees it: where results go, and who may write them."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.records import RECORD, failure, summary
from spinor_geom.errors import BatchError
from spinor_geom.files import atomic_folder, atomic_path, json_text

RUN = "run.json"
RESULTS, STAGING, ROOM = "files", ".staging", "room"
# A disk that takes no more, or only small files.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@dataclass(frozen=True, kw_only=True)
class Store:
    """An output folder, and the run that has it.

    Attributes:
        output: the folder, absolute.
        token: of the run: a run that was cut off from its folder must not write to it any more.
    """

    output: str
    token: str

    def folder(self, key: str) -> Path:
        """Where the results of a source are.

        Raises:
            BatchError: links lead from there out of the output folder.
        """
        root = Path(self.output, RESULTS)
        folder = root / key
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

    def commit(
        self, source: Source, record: dict[str, Any], files: Mapping[str, Callable[[Path], None]]
    ) -> dict[str, Any]:
        """Writes the results of a source: all of them, or none.

        Returns:
            The summary of the record; of one that says why where only this source's results cannot be written.

        Raises:
            BatchError: another run has the folder now, links lead out of it, or it takes no more files.
        """
        try:
            self._place(source, record, files)
        except OSError as error:
            self._require_room(error)
            record = failure(source.key, f"its results cannot be written ({error}); see what is there", status="fault")
            with suppress(OSError):
                self._place(source, record, {})
        return summary(record)

    def _place(self, source: Source, record: Mapping[str, Any], files: Mapping[str, Callable[[Path], None]]) -> None:
        target = self.folder(source.key)
        with atomic_folder(target, staging=Path(self.output, STAGING)) as folder:
            for name, write in files.items():
                write(folder / name)
            (folder / RECORD).write_text(json_text({**record, "input": stamp(source)}), encoding="utf-8")
            self.require_owner()

    def _require_room(self, error: OSError) -> None:
        """Checks after an error that it is not one of the whole folder.

        Raises:
            BatchError: it is.
        """
        if error.errno not in FULL:
            try:
                with atomic_path(Path(self.output, STAGING, ROOM)):
                    return
            except OSError as found:
                error = found
        raise BatchError(f"{self.output}: cannot be written to ({error.strerror}); make room and resume") from error

    def require_owner(self) -> None:
        """Checks that the folder is still this run's.

        Raises:
            BatchError: it is another's.
        """
        try:
            owner = json.loads(Path(self.output, RUN).read_bytes())["token"]
        except (OSError, ValueError, KeyError) as error:
            raise BatchError(f"{self.output}: {RUN} cannot be read ({error}); the run ends here") from error
        if owner != self.token:
            raise BatchError(f"{self.output}: another run has taken the folder over; this one ends here")


def stamp(source: Source) -> list[int | str]:
    """What tells whether a source has changed, or why it cannot be read."""
    return [source.size, source.modified, source.problem]
