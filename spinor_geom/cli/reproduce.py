"""`spinor-geom reproduce`: runs the paper's experiments, writes data, pictures and a report."""

from __future__ import annotations

import argparse

from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines, show_table
from spinor_geom.experiments import NAMES
from spinor_geom.optional import require

COLUMNS = ("experiment", "seen", "seconds")


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Runs experiments in their own order; says which did not show what the paper says."""
    for package in ("matplotlib", "markdown_it"):
        require(package, extra="experiments")
    from spinor_geom.experiments.experiment import PAGE, Done, reproduce

    names = arguments.names or tuple(NAMES)
    with progress("reproducing") as advance:
        seen: list[Done] = []

        def on_done(one: Done) -> None:
            seen.append(one)
            advance(len(seen), len(names))

        advance(0, len(names))
        done = reproduce(names, arguments.output, quick=arguments.quick, on_done=on_done)
    rows = [[one.name, "yes" if one.holds else "no", f"{one.seconds:.1f}"] for one in done]
    show_table(COLUMNS, rows, piped=False)
    show_lines(f"report: {arguments.output / PAGE}", piped=False)
    for one in done:
        if not one.holds:
            complain(f"{one.name}: {one.verdict}")
    return ExitStatus.DONE if all(one.holds for one in done) else ExitStatus.IMPERFECT
