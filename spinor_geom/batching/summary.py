"""What a batch leaves of all files together: the tables, the page, the log in the order of the inputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.journal import Journal, log_line
from spinor_geom.batching.options import BatchOptions
from spinor_geom.batching.page import PageParts, write_page
from spinor_geom.batching.records import failure, summary
from spinor_geom.batching.tables import write_tables
from spinor_geom.files import atomic_path
from spinor_geom.version import program_version

NO_RESULTS = "has no results: they could not be written, or were removed; resume the batch"
TABLE, TABLE_CSV, PAGE = "loops.parquet", "loops.csv", "summary.html"


def write_summary(
    journal: Journal, sources: Iterable[Source], options: BatchOptions, progress: dict[str, Any]
) -> dict[str, Path]:
    """Writes tables, page and log from the records, one after the other.

    Returns:
        Where the tables and the page are, by the names of `BatchResult`.
    """
    root = Path(journal.store.output)
    parts = PageParts()

    def records() -> Iterator[dict[str, Any]]:
        with atomic_path(journal.log) as log, log.open("w", encoding="utf-8") as file:
            for source in sources:
                record = journal.store.record(source.key) or failure(source.key, NO_RESULTS)
                parts.add(record)
                if record["status"] != "done":
                    file.write(log_line(summary(record)))
                yield record

    paths = {"table": root / TABLE, "table_csv": root / TABLE_CSV, "page": root / PAGE}
    write_tables(records(), paths["table"], paths["table_csv"])
    figures = {**options.to_dict(), "seconds": f"{progress['seconds']:.1f}", "version": program_version()}
    write_page(parts, journal.store, figures, paths["page"])
    return paths
