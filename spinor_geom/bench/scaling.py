"""How the time grows: exponents fitted over loops and patches of growing size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spinor_geom.bench.isolate import Record


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Time ∝ size^exponent over a range.

    Attributes:
        method: whose time.
        size: what grew, "points" or "triangles".
        sizes: that were measured.
        seconds: at each.
        exponent: slope of log(seconds) over log(size) by least squares; None below three sizes.
        error: standard error of the slope.
    """

    method: str
    size: str
    sizes: tuple[float, ...]
    seconds: tuple[float, ...]
    exponent: float | None
    error: float | None


def fits(records: Sequence[Record]) -> list[Fit]:
    """The fits of all methods whose growth was measured."""
    found = []
    keys = dict.fromkeys((r["grows"], r["method"]) for r in records)
    for size, method in keys:
        chosen = [r for r in records if r["grows"] == size and r["method"] == method and r["status"] == "done"]
        # patches are told by the triangles they have, not by those that were asked for
        pairs = sorted((float(r["n"] if size == "points" else r["triangles"]), r["seconds"]) for r in chosen)
        found.append(fitted(method, size, [p[0] for p in pairs], [p[1] for p in pairs]))
    return found


def fitted(method: str, size: str, sizes: Sequence[float], seconds: Sequence[float]) -> Fit:
    """The fit of one method."""
    exponent = error = None
    if len(set(sizes)) > 2:
        x, y = np.log(sizes), np.log(seconds)
        (slope, intercept), *_ = np.polyfit(x, y, 1, full=True)
        left = y - slope * x - intercept
        exponent = float(slope)
        error = float(np.sqrt(left @ left / (len(x) - 2) / ((x - x.mean()) @ (x - x.mean()))))
    return Fit(method=method, size=size, sizes=tuple(sizes), seconds=tuple(seconds), exponent=exponent, error=error)
