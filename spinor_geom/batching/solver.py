"""The process that reads, solves and writes; see `isolate` for how it is told what to do."""

import io
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

from spinor_geom.batching.archives import ArchiveReader, Member
from spinor_geom.batching.inputs import SMALL, Source
from spinor_geom.batching.options import BatchOptions
from spinor_geom.batching.store import Store, failure
from spinor_geom.batching.task import OpenedFile, Writer, open_file, results_of
from spinor_geom.errors import ArchiveError, BatchError, OptionError, SpinorGeomError
from spinor_geom.fill.exact_patches import SolvedLoop, minimal_patches
from spinor_geom.fill.fill_options import FillOptions
from spinor_geom.isolate import Tell, serve
from spinor_geom.plateau.options import usable_device

WAITING = 4  # files whose results are on their way to the disk: each waits for it several times


def work(job: dict[str, Any], tell: Tell, *, archives: ArchiveReader) -> None:
    """Does a job: some sources, whose loops are solved side by side.

    Args:
        job: "sources", "options" and "store", as `asdict` gives them.
        tell: is called with "reading" before each source is read, with "solving" before and after what is done of all
            of them together, and with "finished" after a source's results are written; with "stop" where none can be.
        archives: keeps the last archive open.
    """
    options, store = BatchOptions(**job["options"]), Store(**job["store"])
    sources = [Source(**entry) for entry in job["sources"]]
    try:
        with ExitStack() as stack:
            _work(sources, options, store, partial(_stream, archives=archives, stack=stack), tell)
    except BatchError as error:
        tell({"stop": str(error)})
    except Exception as error:  # a mistake of ours, which must not cost the other files
        if len(sources) > 1:
            return  # they are tried one by one
        where = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"unexpected {type(error).__name__} in {Path(where.filename).name}, line {where.lineno}: {error}"
        tell({"finished": store.fail(sources[0], reason)})


def _work(
    sources: Sequence[Source], options: BatchOptions, store: Store, stream_of: Callable[[Source], BinaryIO], tell: Tell
) -> None:
    try:  # once, what otherwise every file would fail for
        usable_device(options.device)
    except OptionError as error:
        raise BatchError(f"a worker: {error}") from error
    fill_options = FillOptions(
        target_edge_length=options.edge_length,
        model="auto",
        tolerance=options.tolerance,
        time_limit=options.time_limit,
        continuity=options.continuity,
        on_stage=lambda place, stage: tell({"solving": ""}),
    )
    opened: list[OpenedFile] = []
    for source in sources:
        tell({"reading": source.key})
        try:
            if source.problem:
                raise ArchiveError(source.problem)
            opened.append(open_file(stream_of(source), source, options, fill_options))
        except SpinorGeomError as error:
            tell({"finished": store.fail(source, str(error), status="failed")})
        except OSError as error:
            reason = f"{source.path}: cannot be read ({error.strerror or error}); check the access rights"
            # of the disk or the rights, which may be others when the batch is resumed
            tell({"finished": store.fail(source, reason)})
    tell({"solving": ""})  # all of them from here on: what happens now is not the fault of the last one read
    answers = _answers(opened, fill_options, options.device, tell)
    waiting: deque[Future[dict[str, Any]]] = deque()
    # the next file is meshed while this one's results are on their way to the disk
    with ThreadPoolExecutor(WAITING) as writer:
        for file in opened:
            waiting.append(writer.submit(store.commit, file.source, *_results(file, *answers)))
            while waiting and (waiting[0].done() or len(waiting) > WAITING):
                tell({"finished": waiting.popleft().result()})
        for one in waiting:
            tell({"finished": one.result()})


def _answers(
    files: Sequence[OpenedFile], options: FillOptions, device: str, tell: Tell
) -> tuple[Iterator[SolvedLoop], Iterator[SolvedLoop]]:
    """The patches of all rims and of all curves, in order, or why there is none; each is a sign of life."""

    def told(answers: Iterator[SolvedLoop]) -> Iterator[SolvedLoop]:
        for answer in answers:
            tell({"solving": ""})
            yield answer

    rims = [rim for file in files for rim in file.rims]
    curves = [curve for file in files for curve in file.curve_loops]
    return (
        told(minimal_patches(rims, options, device=device)),
        told(minimal_patches(curves, options, is_rim=False, device=device)),
    )


def _results(
    file: OpenedFile, rims: Iterator[SolvedLoop], curves: Iterator[SolvedLoop]
) -> tuple[dict[str, Any], dict[str, Writer]]:
    """The record of a file and what writes its files; takes its share of the answers, also where it cannot use them."""
    own = islice(rims, len(file.rims)), islice(curves, len(file.curve_loops))
    try:
        return results_of(file, *own)
    except SpinorGeomError as error:
        return failure(file.source.key, str(error)), {}
    finally:
        for rest in own:
            deque(rest, maxlen=0)


def _stream(source: Source, *, archives: ArchiveReader, stack: ExitStack) -> BinaryIO:
    """The text of a source, which can be gone back in; that of a small one is in memory."""
    if source.member:
        opened = archives.open(source.path, Member(name=source.member, size=source.size, place=source.place))
    else:
        opened = open(source.path, "rb")  # noqa: SIM115 - closed below, or by the stack
    if source.size > SMALL:
        return stack.enter_context(closing(opened))  # the stack closes it, after the file's results are written
    with closing(opened):
        return io.BytesIO(opened.read())


if __name__ == "__main__":
    # nobody reads this process's standard error; what matters of a loop stands in its record
    warnings.simplefilter("ignore")
    serve(partial(work, archives=ArchiveReader()))
