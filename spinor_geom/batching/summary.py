"""The summary of a batch: a CSV table of all loops, a log in the order of the inputs, and a page without scripts."""

import csv
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from jaxtyping import Float

from spinor_geom.batching.inputs import Source
from spinor_geom.batching.pictures import PROGRAM
from spinor_geom.batching.pictures import SIZE as PICTURE_SIZE
from spinor_geom.batching.settings import BatchOptions
from spinor_geom.batching.store import RESULTS, Store, explanation, failure, log_line, summary
from spinor_geom.files import atomic_path, together, write_text
from spinor_geom.render.camera import Camera, upright
from spinor_geom.render.page import document, folded, table, viewer_program
from spinor_geom.render.scene import RIM_COLOUR
from spinor_geom.version import program_version

FIRST, WORST, FAILED, REASONS, MESHES = 12, 12, 48, 40, 1000  # largest numbers of each on the page
BAR = 30  # characters of the longest bar of a histogram
SIZE, MARGIN = 160, 8  # of a thumbnail
TILT = np.radians(35.0)  # of the view, against the normal of the points' plane
STYLE = """.loops { display: flex; flex-wrap: wrap; gap: 1rem }
.loops figure { margin: 0; width: 170px; font-size: 12px; overflow-wrap: anywhere }
.loops img { width: 100%; height: auto; display: block; background: #fff }
svg { border: 1px solid var(--faint); background: #fff }"""
NO_RESULTS = "has no results: they could not be written, or were removed; resume the batch"
COLUMNS = (
    *("source", "loop", "name", "origin", "kind", "status", "reason", "notes", "vertices", "perimeter", "elongation"),
    *("corners", "residual_rms_per_edge", "residual_max_per_edge", "area", "mesh_area", "stability"),
    *("stability_index", "route", "vertices_added", "faces_added"),
    *("self_intersections", "mesh_intersections", "patch_intersections"),
    *("hausdorff_max", "hausdorff_mean", "patch", "surface", "curve", "filled", "seconds", "version"),
)
TABLE, PAGE = "loops.csv", "summary.html"


def write_summary(store: Store, sources: Iterable[Source], options: BatchOptions, seconds: float) -> tuple[Path, Path]:
    """Writes table, log and page from the records, all or none. Returns the paths of the table and the page."""
    path, page = Path(store.output, TABLE), Path(store.output, PAGE)
    content = _PageContent()
    with together():
        with (
            atomic_path(store.log) as log_path,
            log_path.open("w", encoding="utf-8") as log,
            atomic_path(path) as table_path,
            table_path.open("w", encoding="utf-8", newline="") as file,
        ):
            rows = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            rows.writeheader()
            for source in sources:
                record = store.record(source.key) or failure(source.key, NO_RESULTS)
                content.add(record)
                if record["status"] != "done":
                    log.write(log_line(summary(record)))
                rows.writerows({key: _no_formula(value) for key, value in row.items()} for row in _rows(record))
        settings = {**asdict(options), "seconds": f"{seconds:.1f}", "version": program_version()}
        if options.pictures:
            write_text(Path(store.output, PROGRAM), viewer_program())
        write_text(page, _page(content, settings))
    return path, page


def _rows(record: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The table's rows of a file: one for each loop, and one for a file without loops or that cannot be used."""
    of_file = {key: record[key] for key in ("filled", "version")}
    if record["reason"] or not record["loops"]:
        own = {key: record[key] for key in ("source", "status", "reason")}
        yield {**own, "notes": "; ".join(record["notes"]), **of_file}
    for loop in record["loops"]:
        stability, hausdorff = loop.get("stability") or {}, (loop["comparison"] or {}).get("hausdorff", {})
        yield {
            **{key: loop.get(key) for key in COLUMNS},
            **of_file,
            "loop": loop["index"],
            "notes": "; ".join(loop["notes"]),
            "stability": stability.get("verdict"),
            "stability_index": stability.get("index"),
            "hausdorff_max": hausdorff.get("max"),
            "hausdorff_mean": hausdorff.get("mean"),
            "patch": loop["files"].get("patch"),
            "surface": loop["files"].get("surface"),
            "curve": loop["files"].get("loop"),
            "seconds": loop["timings"].get("total", 0.0) + loop["timings"].get("comparison", 0.0),
        }


def _no_formula(value: Any) -> Any:
    """The value, with text changed so that a spreadsheet does not interpret it as a formula."""
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t") else value


class _PageContent:
    """The content of the page, collected from the records, of bounded size."""

    def __init__(self) -> None:
        self.files: Counter[str] = Counter()
        self.loops: Counter[str] = Counter()
        self.reasons: Counter[str] = Counter()
        self.first: list[dict[str, Any]] = []
        self.failed: list[dict[str, Any]] = []
        self.imperfect: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        self.worst: list[dict[str, Any]] = []  # by descending residual
        # numbers of loops by floor(log10) of the residual, and of the seconds
        self.decades: dict[str, Counter[int]] = {"residual per mean edge": Counter(), "seconds": Counter()}

    def add(self, record: dict[str, Any]) -> None:
        self.files[record["status"]] += 1
        if len(self.meshes) < MESHES:
            outline = record["loops"][0]["outline"] if record["loops"] else None
            own = {name: record[name] for name in ("picture", "page", "notes")}
            self.meshes.append({**summary(record), **own, "outline": outline})
        if record["reason"]:
            self._add_failed({**record, "index": None, "name": "", "outline": None})
        for loop in record["loops"]:
            self.loops[loop["status"]] += 1
            if loop["status"] == "failed":
                self._add_failed(loop)
            elif loop["status"] != "done":
                self.imperfect = [*self.imperfect, loop][:FAILED]
            elif len(self.first) < FIRST:
                self.first.append(loop)
            measured = loop.get("residual_rms_per_edge"), loop["timings"].get("total")
            for decades, value in zip(self.decades.values(), measured, strict=True):
                if value:
                    decades[math.floor(math.log10(value))] += 1
            if loop.get("residual_rms_per_edge") is not None and loop["files"]:
                self.worst = sorted([*self.worst, loop], key=lambda one: -one["residual_rms_per_edge"])[:WORST]

    def _add_failed(self, entry: dict[str, Any]) -> None:
        # reasons that differ only in numbers are counted together
        kind = re.sub(r"\d\d?", "#", explanation(entry))[:200]
        if len(self.reasons) < REASONS or kind in self.reasons:
            self.reasons[kind] += 1
        if len(self.failed) < FAILED:
            self.failed.append(entry)


def _page(content: _PageContent, settings: dict[str, Any]) -> str:
    counts = [
        f"{sum(counter.values())} {what}: {', '.join(f'{number} {status}' for status, number in counter.items())}"
        for what, counter in (("files", content.files), ("loops", content.loops))
        if counter
    ]
    body = [
        "<h1>spinor-geom batch</h1>",
        f"<p>{escape('; '.join(counts))}. {settings['seconds']} s. All loops: <a href={TABLE}>{TABLE}</a>.</p>",
    ]
    if content.reasons:
        reasons = [(str(number), reason) for reason, number in content.reasons.most_common()]
        body.append(f"<h2>Failures</h2>{table(('times', 'reason'), reasons)}")
    meshes = "All meshes" if sum(content.files.values()) <= MESHES else f"The first {MESHES} meshes"
    for title, entries, shown in (
        ("First failures", content.failed, _figure),
        ("Patches to check, and loops that are still open", content.imperfect, _figure),
        (meshes, content.meshes if settings["pictures"] else [], _mesh_figure),
        ("Largest boundary residuals", content.worst, _figure),
        ("First loops", content.first, _figure),
    ):
        if entries:
            figures = "".join(map(shown, entries))
            body.append(f"<h2>{title}</h2><div class=loops>{figures}</div>")
    for name, decades in content.decades.items():
        if decades:
            body.append(f"<h2>Loops by {name}</h2>{_histogram(name, decades)}")
    options = table(("option", "value"), [(key, str(value)) for key, value in settings.items()])
    return document("spinor-geom batch", [*body, folded("Options", options)], style=STYLE)


def _histogram(name: str, decades: Counter[int]) -> str:
    """A table with a bar for each power of ten."""
    most = max(decades.values())
    rows = [
        (f"1e{k} to 1e{k + 1}", str(decades[k]), "█" * math.ceil(BAR * decades[k] / most))
        for k in range(min(decades), max(decades) + 1)
    ]
    return table((name, "loops", ""), rows)


def _figure(loop: dict[str, Any]) -> str:
    residual = loop.get("residual_rms_per_edge")
    lines = [
        loop["source"],
        "" if loop["index"] is None else f"loop {loop['index']} {loop['name']}",
        "" if residual is None else f"residual {residual:.1e} per mean edge",
        explanation(loop)[:200],
    ]
    return _captioned(_outline(loop), lines)


def _mesh_figure(mesh: dict[str, Any]) -> str:
    """The picture of a filled mesh with a link to its page, else the outline of its first loop."""
    folder = quote(f"{RESULTS}/{mesh['key']}")
    shown = _outline(mesh)
    if mesh["picture"]:
        size = "width={} height={}".format(*PICTURE_SIZE)
        shown = f'<img src="{folder}/{mesh["picture"]}" alt="{escape(mesh["key"])}" {size} loading=lazy>'
    if mesh["page"]:
        shown = f'<a href="{folder}/{mesh["page"]}">{shown or "page"}</a>'
    counted = f"{mesh['loops']} {'loop' if mesh['loops'] == 1 else 'loops'}, {mesh['status']}"
    return _captioned(shown, [mesh["key"], mesh["reason"] or counted, mesh["first"][:200], *mesh["notes"][-1:]])


def _captioned(shown: str, lines: Iterable[str]) -> str:
    return f"<figure>{shown}<figcaption>{'<br>'.join(map(escape, filter(None, lines)))}</figcaption></figure>"


def _outline(entry: dict[str, Any]) -> str:
    return thumbnail(np.array(entry["outline"])) if entry["outline"] else ""


def thumbnail(points: Float[np.ndarray, "n 3"]) -> str:
    """An `svg` element of a polyline, seen at an angle to its plane."""
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2] if len(points) > 2 else np.eye(3)
    eye = np.cos(TILT) * axes[2] - np.sin(TILT) * axes[1]
    camera = Camera.around(points, eye, upright(eye, axes[1]))
    x, y, _ = camera.frame @ (points - camera.focus).T * ((SIZE / 2 - MARGIN) / camera.radius)
    path = " ".join(f"{SIZE / 2 + a:.1f},{SIZE / 2 - b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
    line = f'<polyline points="{path}" fill="none" stroke="{RIM_COLOUR}" stroke-width="1.5"/>'
    return f'<svg viewBox="0 0 {SIZE} {SIZE}" width="{SIZE}" height="{SIZE}">{line}</svg>'
