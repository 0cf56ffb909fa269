"""Computes the previews of a session, and saves, in processes of their own: the window stays responsive.

This module is also the main program of these processes.
"""

from __future__ import annotations

import math
import pickle
import tempfile
import warnings
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from itertools import count
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from spinor_geom.adapters import MeshFile
from spinor_geom.edit.session import Job, Kind, Loops, Preview, Session
from spinor_geom.errors import SpinorGeomError
from spinor_geom.fill.fill_hole import fill_hole
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.fill.filling import Filling
from spinor_geom.isolate import Event, FaultError, Process, Send, serve
from spinor_geom.plateau.threads import one_thread

_PROCESSES = 2  # one slow loop does not keep the others waiting
_RESTART = 1.0  # seconds after which a job that is not wanted any more is ended: about the start of a process


class Filler:
    """A process that computes previews or saves, one job at a time.

    Attributes:
        job: the preview that is computed, or the path that is saved to, or None if there is no job.
        stage: what the process does, in words.
        begin: when the job began, a time of `monotonic`.
    """

    def __init__(self) -> None:
        self.job: Job | Path | None = None
        self.stage, self.begin, self.event = "", 0.0, Event()
        self._process, self._thread = Process(__name__), ThreadPoolExecutor(1)
        self._future: Future[str] | None = None

    def start(self, job: Job | Path | None, message: Mapping[str, Any]) -> None:
        """Sends a job to the process. Without one the process starts and reads the mesh."""
        self.job, self.stage, self.begin, self.event = job, "", monotonic(), Event()
        self._future = self._thread.submit(self._process.run, message, self._hear, seconds=math.inf)

    def _hear(self, event: Event) -> None:
        self.stage, self.event = event.get("stage", self.stage), event

    @property
    def is_busy(self) -> bool:
        """Whether a job is running, or done and not taken."""
        return self._future is not None

    def take(self) -> FaultError | None:
        """Frees the process after a job, and returns the fault if it died."""
        assert self._future is not None
        fault, self._future, self.job = self._future.exception(), None, None
        if fault is not None and not isinstance(fault, FaultError):
            raise fault
        return fault

    @property
    def is_done(self) -> bool:
        """Whether a job is done and not taken."""
        return self._future is not None and self._future.done()

    def cancel(self) -> None:
        """Ends the process. The next job starts another."""
        self._process.close()
        self._process, self._future, self.job = Process(__name__), None, None


class Work:
    """Computes what a session lacks, in two processes.

    Attributes:
        message: the outcome of the last save, or what the window answers to a key.
        saved: the choices that were saved last.
    """

    def __init__(self, session: Session, mesh: MeshFile, filling: Filling, on_saved: Send) -> None:
        """Starts a process. `filling` is that of the mesh, and `on_saved` gets an event after each successful save."""
        self._session, self._on_saved = session, on_saved
        self._folder = tempfile.TemporaryDirectory()  # what the processes read and write
        self._source = Path(self._folder.name, "source")
        self._source.write_bytes(pickle.dumps((mesh, filling)))
        self._paths: dict[Preview, Path] = {}
        self._numbers = count()
        self.fillers = [Filler() for _ in range(_PROCESSES)]
        self.message = ""
        self.saved: Mapping[Loops, Kind] = {}
        self.fillers[0].start(None, {"source": str(self._source)})

    def step(self) -> bool:
        """Takes what is done, ends what is not wanted any more, and starts jobs. Returns whether anything changed."""
        is_changed = False
        for filler in self.fillers:
            job = filler.job
            if filler.is_done:
                self._take(filler)
                is_changed = True
            elif isinstance(job, Job) and not self._session.is_wanted(job) and monotonic() > filler.begin + _RESTART:
                filler.cancel()
                self._session.finish(job, None)
            if not filler.is_busy and (next_job := self._session.next_job()) is not None:
                filler.start(next_job, self._message(next_job))
                is_changed = True
        return is_changed

    def _message(self, job: Job) -> dict[str, Any]:
        before = [str(self._paths[preview]) for preview in job.before.previews]
        target = self._source.with_name(f"preview {next(self._numbers)}")
        return {"source": str(self._source), "loops": job.loops, "kind": job.kind, "before": before, "to": str(target)}

    def _take(self, filler: Filler) -> None:
        job, event = filler.job, filler.event
        fault = filler.take()
        if isinstance(job, Path):
            self.message = f"not saved: {fault}" if fault else event["told"]
            if "command" in event:
                self.saved = self._saving
                self._on_saved(event)
        elif isinstance(job, Job):
            if fault:
                reason = f"loop {job.loops[0]} was left open: {fault}"
                nowhere = np.array([[np.inf] * 3, [-np.inf] * 3])
                preview = Preview(loops=job.loops, chosen=job.kind, sentences=(reason,), reach=nowhere)
            else:
                path = Path(event["done"])
                preview = pickle.loads(path.read_bytes())
                self._paths[preview] = path
            self._session.finish(job, preview)

    @property
    def is_saving(self) -> bool:
        """Whether a save is running."""
        return any(isinstance(filler.job, Path) for filler in self.fillers)

    def save(self, output: Path, command: str) -> None:
        """Fills the mesh as chosen and writes it. `command` does the same."""
        filler = next((filler for filler in self.fillers if not filler.is_busy), self.fillers[-1])
        self._end(filler)
        self._saving = self._session.choices
        message = {"source": str(self._source), "output": str(output), "command": command, **self._session.options}
        filler.start(output, message)

    def cancel(self) -> None:
        """Ends all jobs. Loops without a patch stay open."""
        self.message = "not saved: cancelled" if self.is_saving else self.message
        for filler in self.fillers:
            if filler.job is not None:
                self._end(filler)
        self._session.cancel()

    def close(self) -> None:
        """Ends the processes."""
        for filler in self.fillers:
            filler.cancel()
        self._folder.cleanup()

    def _end(self, filler: Filler) -> None:
        job = filler.job
        if filler.is_busy:
            filler.cancel()
        if isinstance(job, Job):
            self._session.finish(job, None)


@cache
def _read(path: str) -> Any:
    return pickle.loads(Path(path).read_bytes())


def work(job: dict[str, Any], send: Send) -> None:
    """Does a job of `Work`. Sends "stage" while it runs, then "done", or "told" and "saved"."""
    mesh, filling = _read(job["source"])
    if "output" in job:
        send(_saved(mesh, job, send))
    elif "loops" in job:
        path, preview = Path(job["to"]), _preview(filling, job, send)
        path.write_bytes(pickle.dumps(preview))
        send({"done": str(path)})


def _preview(filling: Filling, job: dict[str, Any], send: Send) -> Preview:
    before = [_read(path).patch for path in job["before"]]
    options = FillOptions(continuity=job["kind"], on_stage=lambda _, stage: send({"stage": stage}))
    with one_thread():
        outcome, patch = filling.preview(job["loops"], before, options)
    return Preview.of(tuple(job["loops"]), job["kind"], outcome, patch, filling.patched.reach)


def _saved(mesh: MeshFile, job: dict[str, Any], send: Send) -> Event:
    output, done = Path(job["output"]), count(1)
    try:
        filled, result = fill_hole(
            mesh.as_stored(output.suffix.lower()),
            job["loop"],
            bridge=job["bridge"],
            continuity={int(index): kind for index, kind in job["continuity"].items()},
            return_report=True,
            on_loop=lambda _, requested: send({"stage": f"loop {next(done)} of {requested}"}),
        )
        output.parent.mkdir(parents=True, exist_ok=True)
        notes = filled.write(output)
    except (SpinorGeomError, OSError) as error:
        return {"told": f"not saved: {error}"}
    return {
        "told": f"saved to {output}: {result.summary}",
        "command": job["command"],
        "notes": [*notes, *result.shortcomings],
        "is_good": result.closed and result.intersection_free,
    }


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # standard error is not shown, and previews have the sentences
    serve(work)
