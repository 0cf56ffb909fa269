"""`spinor-geom batch`, `bench` and `reproduce`: long runs over many files or cases, which can be resumed."""

import argparse
import sys
from itertools import count
from pathlib import Path

from spinor_geom.batching.engine import BatchProgress, batch
from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines, show_table
from spinor_geom.errors import require
from spinor_geom.experiments import NAMES

DATA = Path("data")  # in the root of a clone


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Runs `batch`, `bench` or `reproduce`."""
    return {"batch": _batch, "bench": _bench, "reproduce": _reproduce}[arguments.command](arguments)


def _batch(arguments: argparse.Namespace) -> ExitStatus:
    with progress("listing the inputs") as bar:

        def on_progress(now: BatchProgress) -> None:
            bar(now.files, now.files_total, _counts(now) + _remaining_time(now))

        options = {k: v for k, v in vars(arguments).items() if k not in ("command", "inputs", "output")}
        options["edge_length"] = arguments.edge_length or "auto"
        options["loop"] = "all" if arguments.loop is None else arguments.loop
        result = batch(arguments.inputs, arguments.output, **options, on_progress=on_progress)
    done = result.progress
    show_lines(f"{_counts(done)}, {done.seconds:.1f} s; table: {result.table}, page: {result.page}", piped=False)
    if not result.complete:
        complain(f"{done.files_failed} of {done.files} files have failures; see {result.log}")
    return ExitStatus.DONE if result.complete else ExitStatus.IMPERFECT


def _remaining_time(now: BatchProgress) -> str:
    if not now.seconds or now.files == now.files_before:
        return ""
    left = (now.files_total - now.files) * now.seconds / (now.files - now.files_before)
    return f", {left / 60:.0f} min left" if left > 90 else f", {left:.0f} s left"


def _counts(now: BatchProgress) -> str:
    rate = now.loops / now.seconds if now.seconds and not now.files_before else 0.0
    return (
        f"files: {now.files} done, {now.files_failed} with failures, {now.files_total - now.files} left, "
        f"loops: {now.loops} done, {now.loops_failed} failed{f', {rate:.1f} loops/s' if rate else ''}"
    )


def _bench(arguments: argparse.Namespace) -> ExitStatus:
    for package in ("matplotlib", "torch"):
        require(package, extra="peers")
    from spinor_geom.bench.promises import promises
    from spinor_geom.bench.run_tables import PAGE, promise_table, trouble_table, write
    from spinor_geom.bench.runner import Settings, measure

    own = ("suites", "cases", "methods", "repeat", "time_limit", "data")
    chosen = {name: value for name, value in vars(arguments).items() if name in own and value is not None}
    if DATA.is_dir():
        chosen.setdefault("data", DATA)
    settings = Settings.short(**chosen) if arguments.quick else Settings(**chosen)
    with progress("measuring") as bar:
        result = measure(settings, arguments.output, on_record=lambda _, done, total: bar(done, total))
    write(result)
    found = promises(result.records)
    for table in (promise_table(found), trouble_table(result.records)):
        if table.rows:
            show_lines(table.title, piped=False)
            show_table(table.columns, table.plain_rows, piped=False)
    show_lines(f"report: {arguments.output / PAGE}", piped=False)
    missed = [promise for promise in found if not promise.met]
    for promise in missed:
        complain(f"{promise.case}: promise missed: {promise.text}: {promise.measured}")
    return ExitStatus.IMPERFECT if missed else ExitStatus.DONE


def _reproduce(arguments: argparse.Namespace) -> ExitStatus:
    require("pyvista", extra="render")
    require("torch", extra="torch")
    from spinor_geom.experiments.experiment import PAGE, QUICK, reproduce

    names = arguments.names or tuple(NAMES)
    with progress("reproducing") as bar:
        started = count()

        def on_start(name: str) -> None:
            bar(number := next(started), len(names), f"reproducing {name}")
            if not sys.stderr.isatty():
                complain(f"{number + 1} of {len(names)}: {name}")

        done = reproduce(names, arguments.output, quick=arguments.quick, on_start=on_start)
    rows = [[one.name, "yes" if one.reproduced else "no", f"{one.seconds:.1f}"] for one in done]
    show_table(("experiment", "agrees", "seconds"), rows, piped=False)
    agree = f"{sum(one.reproduced for one in done)} of {len(done)} agree with the paper"
    complain(f"{agree}{f'. {QUICK}' if arguments.quick else ''}; report: {arguments.output / PAGE}")
    for one in done:
        if not one.reproduced:
            complain(f"{one.name}: {one.verdict}")
    return ExitStatus.DONE if all(one.reproduced for one in done) else ExitStatus.IMPERFECT
