"""The text beside the picture: keys, what runs, and what each loop got."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from time import monotonic

from spinor_geom.edit.filler import Work
from spinor_geom.edit.session import Job, Preview, Session, ranges
from spinor_geom.mesh.boundary_loop import BoundaryLoop

KEYS = (
    "click rim    film; again smooth; again open",
    "Shift+click  two rims: joins them",
    "drag, wheel  turn, zoom",
    "a all   u undo   c cancel   s save   q quit",
)


def panel(
    session: Session,
    work: Work,
    loops: Sequence[BoundaryLoop],
    *,
    pointed: int | None,
    command: str,
    size: tuple[int, int],
) -> str:
    """The text, of at most `size` columns and lines. The list of loops is shortened."""
    width, height = size
    previews = session.previews()
    top = [f"{len(loops)} loops, {len(previews)} patches", "", *KEYS, "", *_wrapped(work.message, width)]
    for filler in work.fillers:
        if filler.job is not None:
            what = f"loop {ranges(filler.job.loops)}" if isinstance(filler.job, Job) else "saving"
            seconds = monotonic() - filler.begin
            top.append(f"{what}: {filler.stage} {seconds:.0f} s {'.' * (1 + int(2 * seconds) % 5)}")
    if pointed is not None:
        loop = loops[pointed]
        top += ["", f"loop {pointed}: {len(loop)} points, perimeter {loop.perimeter:.4g}, size {loop.diagonal:.4g}"]
        own, _ = previews.get(session.loops_with(pointed), (None, True))
        top += [line for text in (own.sentences if own else ()) for line in _wrapped(text, width)]
    bottom = ["", *_wrapped(command, width)] if previews else []
    rows, sentences = [], list[str]()
    # first what needs a look
    order = sorted(previews.items(), key=lambda item: (item[1][0] is not None and not item[1][0].sentences, item[0]))
    for loops_of_patch, (preview, is_current) in order:
        rows.append(_row(ranges(loops_of_patch), preview, session.choices[loops_of_patch], is_current))
        if not is_current and preview is not None:
            sentences.append(f"loop {ranges(loops_of_patch)} is computed again: a patch near it changed")
        sentences += preview.sentences if preview is not None else ()
    if rows:
        top += ["", f"{'loop':10}{'patch':9}{'area':>9}{'residual':>10}{'crossings':>10}"]
    room = max(height - len(top) - len(bottom), 1)
    if len(rows) > room:
        rows[room - 1 :] = [f"... and {len(rows) - room + 1} more"]
    else:
        rows += [line for text in ("", *sentences) for line in _wrapped(text, width) or [""]]
        rows = rows[:room]
    return "\n".join([*top, *rows, *bottom])


def _row(name: str, preview: Preview | None, chosen: str, is_current: bool) -> str:
    if preview is None or not is_current:
        return f"{name:10}{chosen} ..."
    kind = {"minimal": "film", None: "open"}.get(preview.kind, preview.kind)
    area = "" if preview.area is None else f"{preview.area:.4g}"
    residual = "" if preview.residual is None else f"{preview.residual:.0e}"
    crossings = "unknown" if preview.intersections is None else preview.intersections or ""
    return f"{name:10}{kind:9}{area:>9}{residual:>10}{crossings:>10}"


def _wrapped(text: str, width: int) -> list[str]:
    return textwrap.wrap(text, width, break_on_hyphens=False)
