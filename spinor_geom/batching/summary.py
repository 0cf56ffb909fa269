"""What a batch leaves of all files together: the tables, the page, the log in the order of the inputs."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.options import BatchOptions
from spinor_geom.batching.page import PageParts, write_page
from spinor_geom.batching.records import failure, summary
from spinor_geom.batching.store import Store, log_line
from spinor_geom.files import atomic_path
from spinor_geom.version import program_version

NO_RESULTS = "has no results: they could not be written, or were removed; resume the batch"
ROWS_AT_ONCE = 10_000
TEXT, WHOLE, REAL = "string", "int64", "double"
COLUMNS: dict[str, str] = {
    "source": TEXT,
    "loop": WHOLE,
    "name": TEXT,
    "kind": TEXT,
    "status": TEXT,
    "reason": TEXT,
    "notes": TEXT,
    "vertices": WHOLE,
    "perimeter": REAL,
    "elongation": REAL,
    "corners": WHOLE,
    "residual_rms_per_edge": REAL,
    "residual_max_per_edge": REAL,
    "area": REAL,
    "stability": TEXT,
    "stability_index": WHOLE,
    "route": TEXT,
    "patch_vertices": WHOLE,
    "patch_faces": WHOLE,
    "self_intersections": WHOLE,
    "mesh_intersections": WHOLE,
    "patch_intersections": WHOLE,
    "hausdorff_max": REAL,
    "hausdorff_mean": REAL,
    "patch": TEXT,
    "surface": TEXT,
    "curve": TEXT,
    "filled": TEXT,
    "seconds": REAL,
    "version": TEXT,
}
TABLE, TABLE_CSV, PAGE = "loops.parquet", "loops.csv", "summary.html"


def write_summary(
    store: Store, sources: Iterable[Source], options: BatchOptions, progress: dict[str, Any]
) -> dict[str, Path]:
    """Writes tables, page and log from the records, and tells where they are by the names of `BatchResult`."""
    root = Path(store.output)
    parts = PageParts()

    def records() -> Iterator[dict[str, Any]]:
        with atomic_path(store.log) as log, log.open("w", encoding="utf-8") as file:
            for source in sources:
                record = store.record(source.key) or failure(source.key, NO_RESULTS)
                parts.add(record)
                if record["status"] != "done":
                    file.write(log_line(summary(record)))
                yield record

    paths = {"table": root / TABLE, "table_csv": root / TABLE_CSV, "page": root / PAGE}
    write_tables(records(), paths["table"], paths["table_csv"])
    figures = {**options.to_dict(), "seconds": f"{progress['seconds']:.1f}", "version": program_version()}
    write_page(parts, store, figures, paths["page"])
    return paths


def rows_of(record: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The rows of a file: one for each loop, or one for the file itself where it has none or could not be read."""
    filled = record["filled"] or {}
    if record["reason"] or not record["loops"]:
        entry = dict.fromkeys(COLUMNS)
        yield entry | {key: record[key] for key in ("source", "status", "reason", "version")}
    for loop in record["loops"]:
        stability, hausdorff = loop["stability"] or {}, (loop["comparison"] or {}).get("hausdorff", {})
        yield {
            **{key: loop.get(key) for key in COLUMNS},
            "notes": "; ".join(loop["notes"]),
            "stability": stability.get("verdict"),
            "stability_index": stability.get("index"),
            "hausdorff_max": hausdorff.get("max"),
            "hausdorff_mean": hausdorff.get("mean"),
            "patch": loop["files"].get("patch"),
            "surface": loop["files"].get("surface"),
            "curve": loop["files"].get("loop"),
            "filled": filled.get("file"),
            "seconds": sum(loop["seconds"].values(), 0.0),
        }


def write_tables(records: Iterable[dict[str, Any]], parquet: Path, text: Path) -> None:
    """Writes both tables, Parquet and CSV, each whole or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema([(name, pa.type_for_alias(kind)) for name, kind in COLUMNS.items()])
    rows = (row for record in records for row in rows_of(record))
    with (
        atomic_path(parquet) as parquet_path,
        atomic_path(text) as text_path,
        text_path.open("w", encoding="utf-8", newline="") as file,
        pq.ParquetWriter(parquet_path, schema) as writer,
    ):
        lines = csv.DictWriter(file, list(COLUMNS), lineterminator="\n")
        lines.writeheader()
        while part := list(islice(rows, ROWS_AT_ONCE)):
            writer.write_table(pa.Table.from_pylist(part, schema))
            lines.writerows({key: _harmless(value) for key, value in row.items()} for row in part)


def _harmless(value: Any) -> Any:
    """Text that a spreadsheet does not take for a formula."""
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t") else value
