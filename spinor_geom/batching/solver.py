"""The process that reads, solves and writes files of a batch. `workers` starts and supervises it."""

import traceback
import warnings
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from spinor_geom.batching.archives import ArchiveReader, Member
from spinor_geom.batching.inputs import Source
from spinor_geom.batching.pictures import MeshPictures
from spinor_geom.batching.settings import BatchOptions
from spinor_geom.batching.store import Store, Writer, failure
from spinor_geom.batching.task import FileTask
from spinor_geom.errors import ArchiveError, BatchError, OptionError, SpinorGeomError
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.fill.solved_loops import SolvedLoop, solved_loops
from spinor_geom.isolate import Send, serve
from spinor_geom.plateau.options import usable_place

WAITING = 4  # files that are written while the next is meshed. Writing one waits for the disk several times


def work(job: dict[str, Any], send: Send, *, archives: ArchiveReader, pictures: MeshPictures) -> None:
    """Solves the loops of some sources together and writes the results.

    The job has "sources", "options" and "store", as `asdict` gives them. Sends "reading" before each source is read,
    "solving" at each step, "finished" with a summary after a source's results are written, and "stop" if the batch
    cannot continue.
    """
    options, store = BatchOptions(**job["options"]), Store(**job["store"])
    sources = [Source(**entry) for entry in job["sources"]]
    try:
        _work(sources, options, store, archives, pictures, send)
    except BatchError as error:
        send({"stop": str(error)})
    except Exception as error:  # a bug, which must not affect the other files
        if len(sources) > 1:
            return  # `workers` retries them one by one
        where = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"unexpected {type(error).__name__} in {Path(where.filename).name}, line {where.lineno}: {error}"
        send({"finished": store.fail(sources[0], reason)})


def _work(
    sources: Sequence[Source],
    options: BatchOptions,
    store: Store,
    archives: ArchiveReader,
    pictures: MeshPictures,
    send: Send,
) -> None:
    try:
        usable_place(options.device)
    except OptionError as error:
        raise BatchError(f"on a worker: {error}") from error
    fill_options = FillOptions(
        target_edge_length=options.edge_length,
        tolerance=options.tolerance,
        time_limit=options.time_limit,
        continuity=options.continuity,
        on_stage=lambda index, stage: send({"solving": ""}),
    )
    tasks: list[FileTask] = []
    for source in sources:
        send({"reading": source.key})
        try:
            if source.problem:
                raise ArchiveError(source.problem)
            tasks.append(FileTask(_bytes_of(source, archives), source, options, fill_options))
        except SpinorGeomError as error:
            send({"finished": store.fail(source, str(error), status="failed")})
        except OSError as error:  # of the disk or the access rights: a resumed batch tries the file again
            reason = f"{source.path}: cannot be read ({error.strerror or error}); check the access rights"
            send({"finished": store.fail(source, reason)})
    send({"solving": ""})  # from here on, a fault cannot be attributed to one file
    rims = _patches([rim for task in tasks for rim in task.rims], fill_options, options, send)
    curves = _patches([loop for task in tasks for loop in task.curve_loops], fill_options, options, send, is_rim=False)
    waiting: deque[Future[dict[str, Any]]] = deque()
    with ThreadPoolExecutor(WAITING) as writer:
        for task in tasks:
            record, files = _results(task, rims, curves)
            if options.pictures and task.result is not None:
                send({"solving": ""})
                pictures.add(task.result, task.source, record, files)
            waiting.append(writer.submit(store.commit, task.source, record, files))
            while waiting and (waiting[0].done() or len(waiting) > WAITING):
                send({"finished": waiting.popleft().result()})
        for one in waiting:
            send({"finished": one.result()})


def _bytes_of(source: Source, archives: ArchiveReader) -> bytes:
    if not source.member:
        return Path(source.path).read_bytes()
    return archives.read(Path(source.path), Member(name=source.member, size=source.size, place=source.place))


def _patches(
    loops: list[Any], fill_options: FillOptions, options: BatchOptions, send: Send, *, is_rim: bool = True
) -> Iterator[SolvedLoop]:
    """The patch of each loop in order, or the error instead."""
    for solved in solved_loops(loops, fill_options, is_rim=is_rim, device=options.device):
        send({"solving": ""})
        yield solved


def _results(
    task: FileTask, rims: Iterator[SolvedLoop], curves: Iterator[SolvedLoop]
) -> tuple[dict[str, Any], dict[str, Writer]]:
    """The record and the files of a task. All patches of its loops are taken from the iterators in any case."""
    own = islice(rims, len(task.rims)), islice(curves, len(task.curve_loops))
    try:
        return task.results(*own)
    except SpinorGeomError as error:
        return failure(task.source.key, str(error)), {}
    finally:
        for rest in own:
            deque(rest, maxlen=0)


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # standard error is not shown. Notes are in the records
    serve(partial(work, archives=ArchiveReader(), pictures=MeshPictures()))
