"""`spinor-geom batch`: the boundary loops of many OBJ files, on this machine or a cluster."""

from __future__ import annotations

import argparse

from spinor_geom.batching.engine import BatchProgress, batch
from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Runs the batch; says how many files are not wholly done, and where that stands."""
    with progress("listing the inputs") as show:

        def on_progress(now: BatchProgress) -> None:
            show(now.files, now.files_total, _said(now) + _ready(now))

        own = ("command", "version", "inputs", "output")
        options = {name: value for name, value in vars(arguments).items() if name not in own}
        options["edge_length"] = "auto" if arguments.edge_length is None else arguments.edge_length
        result = batch(arguments.inputs, arguments.output, **options, on_progress=on_progress)
    done = result.progress
    show_lines(f"{_said(done)}, {done.seconds:.1f} s; table: {result.table_csv}, page: {result.page}", piped=False)
    if not result.complete:
        complain(f"{done.files_failed} of {done.files} files are not wholly done; see {result.log}")
    return ExitStatus.DONE if result.complete else ExitStatus.IMPERFECT


def _ready(now: BatchProgress) -> str:
    if not now.seconds or now.files == now.files_before:
        return ""
    left = (now.files_total - now.files) * now.seconds / (now.files - now.files_before)
    return f", ready in {left / 60:.0f} min" if left > 90 else f", ready in {left:.0f} s"


def _said(now: BatchProgress) -> str:
    rate = now.loops / now.seconds if now.seconds and not now.files_before else 0.0
    parts = [
        f"files: {now.files} done, {now.files_failed} with failures",
        f"{now.files_total - now.files} left",
        f"loops: {now.loops} done, {now.loops_failed} failed",
        *([f"{rate:.1f} loops/s"] if rate else []),
    ]
    return ", ".join(parts)
