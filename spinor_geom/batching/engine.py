"""Hands the inputs of a batch to its workers: threads of this process, or those of a Dask cluster."""

from __future__ import annotations

import json
import os
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from itertools import chain
from pathlib import Path
from tempfile import TemporaryFile
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

from spinor_geom.batching.inputs import SMALL, Inputs, Source, listed
from spinor_geom.batching.options import BatchOptions, Limits, What
from spinor_geom.batching.store import Store, log_line, opened_store
from spinor_geom.batching.worker import end_solvers, run_block
from spinor_geom.errors import BatchError, OptionError, require, require_positive
from spinor_geom.fill.fill_options import TIME_LIMIT, Continuity, Islands

if TYPE_CHECKING:
    from distributed import Client
    from distributed.deploy import Cluster

TOGETHER = 64  # most files whose loops are solved side by side
WAITING = 2  # blocks that wait at each worker
# Seconds without a sign of life until a process is ended: for what no time limit holds for (reading a file, and each
# step between two looks at the clock), and so many time limits, of which a stage of a loop takes one.
SILENCE, STAGES = 60.0, 10.0


@dataclass(frozen=True, kw_only=True)
class BatchProgress:
    """How far a batch is.

    Attributes:
        files: sources that are finished, those that were complete before included.
        files_failed: those of them for which `spinor-geom fill` would not exit with 0.
        files_total: how many there are.
        files_before: those that were complete before a resumed run.
        loops: of the files that are finished.
        loops_failed: those of them that should have a patch and have none.
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
    """What a batch has left.

    Attributes:
        output: the folder: "files" holds a folder for each source with its record and meshes.
        progress: how many files and loops, done and failed.
        table: one row a loop, as Parquet.
        table_csv: the same as CSV.
        page: the summary with pictures, as HTML.
        log: a line for each file that is not wholly done.
    """

    output: Path
    progress: BatchProgress
    table: Path
    table_csv: Path
    page: Path
    log: Path

    @property
    def complete(self) -> bool:
        """Whether every requested loop of every file is closed and no patch crosses anything.

        With `strict` also whether all patches are exact surfaces within the tolerance.
        """
        return not self.progress.files_failed


def batch(
    inputs: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    output: str | os.PathLike[str],
    *,
    what: What = "fill",
    format: str | None = None,
    loop: Literal["all"] | int | Sequence[int] = "all",
    bridge: Sequence[int] | None = None,
    islands: Islands = "ignore",
    continuity: Continuity = "C0",
    merge: bool | float = False,
    keep_largest: bool = False,
    max_perimeter: float | None = None,
    edge_length: float | Literal["auto"] = "auto",
    tolerance: float = 1e-3,
    time_limit: float = TIME_LIMIT,
    strict: bool = False,
    closing: float = 1e-3,
    compare: bool = False,
    workers: int | None = None,
    scheduler: str | Cluster | Client | None = None,
    device: str = "cpu",
    resume: bool = False,
    memory_limit: int = 4 << 30,
    retries: int = 2,
    on_progress: Callable[[BatchProgress], None] | None = None,
) -> BatchResult:
    """Fills the holes of many mesh files as `fill_hole` does, each file by itself, and writes the results to a folder.

    Closed curves of OBJ files (`l` elements) are spanned too. Whatever a file does, it costs only itself: the reason
    stands in its record, the table and the log. Results appear whole or not at all, and a run that was cut off goes on
    with `resume=True`; the files that it leaves are the same byte for byte, however it was cut off and by however many
    workers they were made (on one kind of processor; of the records all but the timings; loops that reach the time
    limit excepted).

    Args:
        inputs: mesh files of every format that `read_mesh` reads, folders (searched with all below them), patterns,
            manifests (.csv with a column "path", .jsonl), and archives (.zip, .tar, packed or not), which are read
            without being unpacked. They are listed before the first is solved; the list is kept in a temporary file.
        output: the folder to write to: empty or new, but for a resumed run.
        what: "fill" for the triangulation of each loop, and of files with faces the filled mesh; "surface" for the
            triangulation and the spinor surface, to be read by `SpinorSurface.load`; "loops" for the loops alone.
        format: of the meshes: "obj", "ply", "stl", "off", "glb", "vtp", "vtk", "3mf" or "npz"; None for that of each
            input ("obj" for loops alone).
        loop: as for `fill_hole`, of every file. A file without such a loop fails.
        bridge: as for `fill_hole`, of every file.
        islands: as for `fill_hole`.
        continuity: as for `fill_hole`. Closed curves have minimal surfaces.
        merge: as for `fill_hole`. Curves keep their points.
        keep_largest: as for `fill_hole`, of every file.
        max_perimeter: as for `fill_hole`.
        edge_length: `target_edge_length` of `fill_hole`.
        tolerance: as for `fill_hole`.
        time_limit: as for `fill_hole`, in seconds. A process that solves and gives no sign of life for a minute and
            ten times as long is ended, which costs the file; so is one that needs 100 times as long as that for one
            file, and one that lists an archive and finds no member for so long.
        strict: counts files with a loop that has no exact surface within the tolerance as not done.
        closing: open curves whose ends are at most so many mean edges apart count as closed.
        compare: also compares each surface with a discrete minimal surface.
        workers: processes that solve on this machine; by default as many as there are cores for this process.
        scheduler: a Dask cluster to use instead: its scheduler's address, the cluster object, or a client, whose TLS
            settings are used. All its machines must see inputs and output under the same names.
        device: of the batched linear algebra, such as "cuda"; equal bytes are promised on the CPU only.
        resume: goes on with the run in the output folder: only what is not complete is done.
        memory_limit: of the process that solves, and of the one that lists archives, in bytes.
        retries: how often a file is tried again after its process died. A cluster has a number of its own for workers
            that died: `distributed.scheduler.allowed-failures`.
        on_progress: is called now and then.

    Returns:
        Where things are, and how many.

    Raises:
        OptionError: an option has a value that is not allowed.
        BatchError: an input does not exist, or holds no mesh files; the output folder is another run's or cannot be
            written to; the scheduler cannot be reached.
        MissingPackageError: the packages of the extra `batch` are not installed, or for a cluster those of `cluster`.
    """
    for package in ("pyarrow", "filelock", "psutil"):
        require(package, extra="batch")
    if scheduler is not None:
        require("distributed", extra="cluster")
    options = BatchOptions(
        what=what,
        format=format,
        loop=loop,
        bridge=bridge,
        islands=islands,
        continuity=continuity,
        merge=merge,
        keep_largest=keep_largest,
        max_perimeter=max_perimeter,
        edge_length=edge_length,
        tolerance=tolerance,
        time_limit=time_limit,
        strict=strict,
        closing=closing,
        compare=compare,
        device=device,
    )
    require_positive("memory_limit", memory_limit)
    if retries < 0:
        raise OptionError(f"retries must be a number from 0 on, not {retries}")
    limits = Limits(seconds=SILENCE + STAGES * float(time_limit), memory=int(memory_limit), retries=retries)
    if scheduler is not None and workers is not None:
        raise OptionError("workers are those of the scheduler's cluster; give one of workers and scheduler")
    if workers is not None and workers < 1:
        raise OptionError(f"workers must be at least 1, not {workers}")
    named = Inputs([inputs] if isinstance(inputs, (str, os.PathLike)) else inputs, output=output, limits=limits)
    with opened_store(output, options, resume=resume) as store, TemporaryFile("w+", encoding="ascii") as file:
        run = _Run(store, options, limits, on_progress)
        for source in named:
            file.write(json.dumps(asdict(source)) + "\n")
            run.counts["files_total"] += 1
        left = run.incomplete(listed(file))
        first = next(left, None)
        if first is not None:
            with _workers(workers, scheduler, store.token) as pool:
                run.solve(pool, chain([first], left))
        from spinor_geom.batching.summary import write_summary  # pyarrow and numpy are not needed before

        progress = run.progress()
        paths = write_summary(store, listed(file), options, asdict(progress))
    return BatchResult(output=Path(store.output), progress=progress, log=store.log, **paths)


@dataclass(frozen=True, kw_only=True)
class Workers:
    """What does the blocks of a batch: this machine's threads, or a cluster."""

    executor: Executor
    count: Callable[[], int]  # how many blocks it works at at a time; clusters grow and shrink
    killed: tuple[type[Exception], ...] = ()  # what the future of a block raises whose workers died


@dataclass(frozen=True)
class _Run:
    store: Store
    options: BatchOptions
    limits: Limits
    on_progress: Callable[[BatchProgress], None] | None
    counts: Counter[str] = field(default_factory=Counter)
    start: float = field(default_factory=perf_counter)

    def incomplete(self, sources: Iterable[Source]) -> Iterator[Source]:
        """The sources that are still to be done; those that are complete are counted."""
        for source in sources:
            one = self.store.completed(source)
            if one is None:
                yield source
            else:
                self.counts["files_before"] += 1
                self._finish(one)

    def solve(self, pool: Workers, sources: Iterator[Source]) -> None:
        """Has sources solved, a few blocks at a time; BatchError if nothing can be written, or the cluster is gone."""
        again: deque[list[Source]] = deque()
        blocks = _blocks(sources, self.counts, pool)
        running: dict[Future[dict[str, Any]], list[Source]] = {}
        while True:
            while len(running) < WAITING * pool.count():
                block = again.popleft() if again else next(blocks, None)
                if block is None:
                    break
                settings = {"options": asdict(self.options), "store": asdict(self.store)}
                job = {"sources": [asdict(source) for source in block], **settings}
                running[pool.executor.submit(run_block, job, self.limits)] = block
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                block = running.pop(future)
                try:
                    done = future.result()
                except pool.killed:
                    again.extend(self._left_of(block))
                    continue
                except CancelledError:
                    problem = "the cluster was lost; what is finished is kept: resume the batch"
                    raise BatchError(problem) from None
                except Exception as error:
                    problem = f"a worker cannot do its work ({error}); is the same version installed there?"
                    raise BatchError(problem) from error
                for one in done["finished"]:
                    self._finish(one)
                if done["stop"]:
                    raise BatchError(done["stop"])

    def _left_of(self, block: list[Source]) -> list[list[Source]]:
        """What of the block of a worker that was killed has to be tried again, file by file."""
        tries = []
        for source in block:
            one = self.store.completed(source)  # what the workers had finished before they died need not be done again
            if one is not None:
                self._finish(one)
            elif len(block) == 1:
                self._finish(self.store.fail(source, "every worker that tried it was killed; look at their logs"))
            else:
                tries.append([source])
        return tries

    def _finish(self, one: dict[str, Any]) -> None:
        failed = one["status"] != "done"
        self.counts.update(files=1, files_failed=failed, loops=one["loops"], loops_failed=one["loops_failed"])
        if failed:
            with self.store.log.open("a", encoding="utf-8") as file:
                file.write(log_line(one))
        if self.on_progress is not None:
            self.on_progress(self.progress())

    def progress(self) -> BatchProgress:
        """How far it is."""
        return BatchProgress(**self.counts, seconds=perf_counter() - self.start)


def _blocks(sources: Iterator[Source], counts: Counter[str], pool: Workers) -> Iterator[list[Source]]:
    """Sources in blocks to be solved together: small files, and fewer as the end comes near."""
    block: list[Source] = []
    handed = most = 0
    for source in sources:
        if block and (len(block) >= most or sum(one.size for one in block) + source.size > SMALL):
            yield block
            handed += len(block)
            block = []
        if not block:
            most = min(TOGETHER, (counts["files_total"] - counts["files_before"] - handed) // (2 * pool.count()))
        block.append(source)
    if block:
        yield block


@contextmanager
def _workers(workers: int | None, scheduler: str | Cluster | Client | None, token: str) -> Iterator[Workers]:
    """Threads, or the workers of a cluster; the processes that solve for them end with the block."""
    if scheduler is not None:
        with _cluster(scheduler, token) as pool:
            yield pool
        return
    count = workers or (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
    with ThreadPoolExecutor(count) as executor:
        try:
            yield Workers(executor=executor, count=lambda: count)
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
            end_solvers(token)


@contextmanager
def _cluster(scheduler: str | Cluster | Client, token: str) -> Iterator[Workers]:
    from distributed import Client, KilledWorker

    with ExitStack() as stack:
        try:
            client: Any = scheduler
            if not isinstance(scheduler, Client):
                client = stack.enter_context(Client(scheduler, timeout="20s", set_as_default=False))
            threads = client.nthreads
            threads()
        except (OSError, ValueError, RuntimeError, TypeError, AttributeError) as error:
            raise BatchError(f"{scheduler}: no Dask scheduler answers there ({error}); check the address") from error
        executor = client.get_executor(pure=False)
        try:
            yield Workers(
                executor=executor, count=lambda: max(1, sum(map(int, threads().values()))), killed=(KilledWorker,)
            )
        finally:
            with suppress(OSError, RuntimeError):  # it is gone, and they with it
                executor.shutdown(wait=False)
                client.run(end_solvers, token, on_error="ignore")
