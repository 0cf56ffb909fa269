"""The output folder of a batch as every process of it sees it: where results go, and who may write them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.records import RECORD
from spinor_geom.errors import BatchError
from spinor_geom.files import atomic_folder, write_json

RUN = "run.json"
RESULTS, STAGING = "files", ".staging"


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

    def commit(self, source: Source, record: Mapping[str, Any], files: Mapping[str, Callable[[Path], None]]) -> None:
        """Writes the results of a source: all of them, or none.

        Raises:
            BatchError: another run has the folder now, or links lead out of it.
            OSError: the disk is full, or may not be written to.
        """
        target = self.folder(source.key)
        with atomic_folder(target, staging=Path(self.output, STAGING)) as folder:
            for name, write in files.items():
                write(folder / name)
            write_json(folder / RECORD, {**record, "input": stamp(source)})
            self.require_owner()

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


def stamp(source: Source) -> list[int]:
    """What tells whether a source has changed."""
    return [source.size, source.modified]
