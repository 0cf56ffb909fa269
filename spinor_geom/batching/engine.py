"""Batches: lists the inputs, submits blocks of them to the workers, and counts the results."""

from __future__ import annotations

import json
import os
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import asdict, dataclass, field, fields
from itertools import chain
from pathlib import Path
from tempfile import TemporaryFile
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

from spinor_geom.batching.inputs import Inputs, Source, listed
from spinor_geom.batching.settings import BatchOptions, Limits, What
from spinor_geom.batching.store import Store, log_line, opened_store
from spinor_geom.batching.workers import Workers, open_workers, run_block
from spinor_geom.errors import BatchError, OptionError, require, require_count, require_positive
from spinor_geom.fill.fill_options import TIME_LIMIT, Bridge, ContinuityName, Islands

if TYPE_CHECKING:
    from distributed import Client
    from distributed.deploy import Cluster

# Files in a block, and bytes of a block of several files: their loops are solved together.
MOST_FILES, MOST_BYTES = 64, 1 << 20
WAITING = 2  # blocks submitted for each worker
# A process is killed if it sends no event for SILENCE seconds (for reading a file and for steps that do not check the
# time) plus STAGES time limits (each stage of a loop may take one).
SILENCE, STAGES = 60.0, 10.0


@dataclass(frozen=True, kw_only=True)
class BatchProgress:
    """The progress of a batch.

    Attributes:
        files: finished sources, including those that were complete before a resumed run.
        files_failed: the finished sources for which `spinor-geom fill` would not exit with 0.
        files_total: all sources.
        files_before: sources that were complete before a resumed run.
        loops: loops of the finished sources.
        loops_failed: requested loops of these that have no patch.
        seconds: since the start.
    """

    files: int = 0
    files_failed: int = 0
    files_total: int = 0
    files_before: int = 0
    loops: int = 0
    loops_failed: int = 0
    seconds: float


@dataclass(frozen=True, kw_only=True)
class BatchResult:
    """The output of a batch.

    Attributes:
        output: the folder. Its subfolder "files" holds a folder for each source, with its record and meshes.
        progress: numbers of files and loops, done and failed.
        table: CSV file with a row for each loop.
        page: HTML summary with pictures.
        log: text file with a line for each file that is not done.
    """

    output: Path
    progress: BatchProgress
    table: Path
    page: Path
    log: Path

    @property
    def complete(self) -> bool:
        """Whether every requested loop of every file is closed and no patch intersects anything.

        With `strict`, also whether all patches are exact surfaces within the tolerance.
        """
        return not self.progress.files_failed


def batch(
    inputs: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    *,
    what: What = "fill",
    format: str | None = None,
    loop: Literal["all"] | int | Sequence[int] = "all",
    bridge: Bridge | None = None,
    islands: Islands = "ignore",
    continuity: ContinuityName = "C0",
    merge: bool | float = False,
    keep_largest: bool = False,
    max_perimeter: float | None = None,
    edge_length: float | Literal["auto"] = "auto",
    tolerance: float = 1e-3,
    time_limit: float = TIME_LIMIT,
    strict: bool = False,
    closing: float = 1e-3,
    compare: bool = False,
    pictures: bool = False,
    workers: int | None = None,
    scheduler: str | Cluster | Client | None = None,
    device: str | None = None,
    resume: bool = False,
    memory_limit: int = 4 << 30,
    retries: int = 2,
    on_progress: Callable[[BatchProgress], None] | None = None,
) -> BatchResult:
    """Fills the holes of many mesh files as `fill_hole` does, and writes the results to a folder.

    Surfaces over closed curves of OBJ files (`l` elements) are computed too. A file that cannot be filled, or that
    crashes its process, does not stop the batch: its record, the table and the log have the reason. An interrupted run
    continues with `resume=True`. The results do not depend on interruptions or on the number of workers: files are
    equal byte for byte, records and pages except for timings (on one kind of processor, and unless a loop reaches the
    time limit).

    Args:
        inputs: mesh files of every format that `read_mesh` reads, folders (with all subfolders), patterns, manifests
            (.csv with a column "path", .jsonl), and archives (.zip, .tar, compressed or not), which are read without
            being unpacked. All are listed before the first is solved, in a temporary file.
        output: the folder to write to, new or empty unless a run is resumed.
        what: "fill" writes the triangulation of each loop and, for files with faces, the filled mesh. "surface" writes
            the triangulation and the spinor surface, for `SpinorSurface.load`. "loops" writes the loops only.
        format: of the meshes: "obj", "ply", "stl", "off", "glb", "vtp", "vtk", "3mf" or "npz", or None for that of
            each input ("obj" for "loops").
        loop: as for `fill_hole`, for every file. A file without such a loop fails.
        bridge: as for `fill_hole`, for every file.
        islands: as for `fill_hole`.
        continuity: as for `fill_hole`, one for all loops. Curves always get minimal surfaces.
        merge: as for `fill_hole`. Curves keep their points.
        keep_largest: as for `fill_hole`, for every file.
        max_perimeter: as for `fill_hole`.
        edge_length: `target_edge_length` of `fill_hole`.
        tolerance: as for `fill_hole`.
        time_limit: as for `fill_hole`, in seconds. A process that solves or lists an archive is ended, and its file
            fails, if it sends no message for a minute plus ten times this limit.
        strict: counts a file as not done if a loop has no exact surface within the tolerance.
        closing: the ends of open curves are joined if the gap is at most this many mean edge lengths.
        compare: also compares each surface with a discrete minimal surface.
        pictures: draws each filled mesh while the batch runs, and writes a page with its loops and a scene to turn.
            The page of the batch shows the pictures, each with a link to its page.
        workers: processes that solve on this machine, by default one for each core that this process may use.
        scheduler: a Dask cluster to use instead: the address of its scheduler, the cluster, or a client, whose TLS
            settings are used. All machines must see inputs and output under the same names.
        device: the torch device of the batched linear algebra, such as "cuda", or None for the CPU, without torch.
            Results are reproducible byte for byte on the CPU only.
        resume: continues the run in the output folder with the files that are not complete.
        memory_limit: of each process that solves, and of the one that lists archives, in bytes.
        retries: how often a file is tried again after its process died. For workers of a cluster that died, the
            setting `distributed.scheduler.allowed-failures` holds instead.
        on_progress: is called after each file.

    Returns:
        Paths of the results, and numbers of files and loops.

    Raises:
        OptionError: an option has a value that is not allowed.
        BatchError: an input does not exist or holds no mesh files, the output folder belongs to another run or cannot
            be written to, or the scheduler cannot be reached.
        MissingPackageError: for a cluster the packages of the extra `cluster` are not installed, or for pictures those
            of `render`.
    """
    given = locals()  # each field of the options is an argument
    if scheduler is not None:
        require("distributed", extra="cluster")
    if pictures:
        require("pyvista", extra="render")
    options = BatchOptions(**{field.name: given[field.name] for field in fields(BatchOptions)})
    require_positive("memory_limit", memory_limit)
    require_count(0, retries=retries)
    require_count(workers=1 if workers is None else workers)
    if scheduler is not None and workers is not None:
        raise OptionError("a cluster has its own number of workers; give either workers or scheduler")
    limits = Limits(seconds=SILENCE + STAGES * float(time_limit), memory=int(memory_limit), retries=retries)
    sources = Inputs([inputs] if isinstance(inputs, (str, os.PathLike)) else inputs, output=output, limits=limits)
    with opened_store(output, options, resume=resume) as store, TemporaryFile("w+", encoding="ascii") as file:
        run = _Run(store, options, limits, on_progress)
        for source in sources:
            file.write(json.dumps(asdict(source)) + "\n")
            run.counts["files_total"] += 1
        remaining = run.incomplete(listed(file))
        first = next(remaining, None)
        if first is not None:
            with open_workers(workers, scheduler, store.token) as pool:
                run.solve(pool, chain([first], remaining))
        from spinor_geom.batching.summary import write_summary  # imports numpy, which nothing before needs

        progress = run.progress()
        table, page = write_summary(store, listed(file), options, progress.seconds)
    return BatchResult(output=Path(store.output), progress=progress, table=table, page=page, log=store.log)


@dataclass(frozen=True)
class _Run:
    store: Store
    options: BatchOptions
    limits: Limits
    on_progress: Callable[[BatchProgress], None] | None
    counts: Counter[str] = field(default_factory=Counter)
    start: float = field(default_factory=perf_counter)

    def incomplete(self, sources: Iterable[Source]) -> Iterator[Source]:
        """The sources that are not complete. The others are counted."""
        for source in sources:
            summary = self.store.completed(source)
            if summary is None:
                yield source
            else:
                self.counts["files_before"] += 1
                self._count(summary)

    def solve(self, pool: Workers, sources: Iterator[Source]) -> None:
        """Solves the sources, block by block. Raises BatchError if nothing can be written or the cluster is gone."""
        again: deque[list[Source]] = deque()
        blocks = _blocks(sources, self.counts, pool)
        running: dict[Future[dict[str, Any]], list[Source]] = {}
        settings = {"options": asdict(self.options), "store": asdict(self.store)}
        while True:
            while len(running) < WAITING * pool.count():
                block = again.popleft() if again else next(blocks, None)
                if block is None:
                    break
                job = {"sources": [asdict(source) for source in block], **settings}
                running[pool.executor.submit(run_block, job, self.limits)] = block
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                block = running.pop(future)
                try:
                    done = future.result()
                except pool.killed:
                    again.extend(self._retries(block))
                    continue
                except CancelledError:
                    problem = "the connection to the cluster was lost; resume the batch, finished files are kept"
                    raise BatchError(problem) from None
                except Exception as error:
                    problem = f"a worker failed ({error}); check that the same version is installed there"
                    raise BatchError(problem) from error
                for summary in done["finished"]:
                    self._count(summary)
                if done["stop"]:
                    raise BatchError(done["stop"])

    def _retries(self, block: list[Source]) -> list[list[Source]]:
        """The unfinished sources of a block whose worker was killed, to be tried one by one."""
        tries = []
        for source in block:
            summary = self.store.completed(source)
            if summary is not None:
                self._count(summary)
            elif len(block) == 1:
                self._count(self.store.fail(source, "all workers that tried this file were killed; check their logs"))
            else:
                tries.append([source])
        return tries

    def _count(self, summary: dict[str, Any]) -> None:
        """Counts and logs a finished source."""
        failed = summary["status"] != "done"
        self.counts.update(files=1, files_failed=failed, loops=summary["loops"], loops_failed=summary["loops_failed"])
        if failed:
            with self.store.log.open("a", encoding="utf-8") as file:
                file.write(log_line(summary))
        if self.on_progress is not None:
            self.on_progress(self.progress())

    def progress(self) -> BatchProgress:
        """The counts so far."""
        return BatchProgress(**self.counts, seconds=perf_counter() - self.start)


def _blocks(sources: Iterator[Source], counts: Counter[str], pool: Workers) -> Iterator[list[Source]]:
    """Blocks of sources to be solved together. Those near the end are smaller, so that all workers finish together."""
    block: list[Source] = []
    submitted = most = 0
    for source in sources:
        if block and (len(block) >= most or sum(one.size for one in block) + source.size > MOST_BYTES):
            yield block
            submitted += len(block)
            block = []
        if not block:
            remaining = counts["files_total"] - counts["files_before"] - submitted
            most = min(MOST_FILES, remaining // (2 * pool.count()))
        block.append(source)
    if block:
        yield block
