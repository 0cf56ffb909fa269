"""`spinor-geom bench`: measures exact minimal surfaces beside discrete ones and beside hole fillers."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from spinor_geom.cli.console import ExitStatus, complain, progress, show_lines, show_table
from spinor_geom.optional import require

DATA = Path("data")  # of a clone, in whose root the command is usually given


def run(arguments: argparse.Namespace) -> ExitStatus:
    """Measures, writes the run's files, and says which promises of accuracy are not kept."""
    require("matplotlib", extra="bench")
    from spinor_geom.bench.claims import claims
    from spinor_geom.bench.page import PAGE, write
    from spinor_geom.bench.runner import Settings, measure
    from spinor_geom.bench.tables import claim_table, trouble_table

    chosen: dict[str, Any] = {name: tuple(getattr(arguments, name) or ()) for name in ("suites", "cases", "methods")}
    if arguments.data is not None or DATA.is_dir():
        chosen["data"] = arguments.data or DATA
    if arguments.repeat is not None:
        chosen["repeat"] = arguments.repeat
    if arguments.time_limit is not None:
        chosen["time_limit"] = arguments.time_limit
    settings = Settings.short(**chosen) if arguments.quick else Settings(**chosen)
    with progress("measuring") as advance:
        result = measure(settings, arguments.output, on_record=lambda _, done, total: advance(done, total))
    write(result)
    found = claims(result.records)
    for table in (claim_table(found), trouble_table(result.records)):
        if table.rows:
            show_lines(table.title, piped=False)
            show_table(table.columns, [[cell.strip("*") for cell in row] for row in table.rows], piped=False)
    show_lines(f"report: {arguments.output / PAGE}", piped=False)
    missed = [claim for claim in found if not claim.met]
    for claim in missed:
        complain(f"{claim.case}: missed ({claim.kind}): {claim.text}: {claim.measured}")
    return ExitStatus.IMPERFECT if any(claim.kind == "accuracy" for claim in missed) else ExitStatus.DONE
