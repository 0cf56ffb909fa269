"""Records: what is known of each file and loop of a batch, in JSON's types. Imports nothing heavy.

All that may differ between two runs over the same input stands under the keys "seconds".
"""

from collections.abc import Iterable
from typing import Any

from spinor_geom.version import program_version

RECORD = "record.json"
# From good to bad. "imperfect": there is a surface, but not within the tolerance, or it crosses something. "failed": of
# a loop that there is none, of a file that this is so of one of its loops or of the file itself. "fault": the file's
# process died or was ended, which may be so once and not again: a resumed batch tries anew.
STATUSES = ("done", "imperfect", "failed", "fault")


def worst(statuses: Iterable[str]) -> str:
    """The worst of some statuses; "done" of none."""
    return max(statuses, key=STATUSES.index, default="done")


def failure(key: str, reason: str, *, status: str = "failed") -> dict[str, Any]:
    """The record of a file that has no results."""
    return {
        "source": key,
        "status": status,
        # names of files may hold bytes that are no text, or that terminals obey
        "reason": "".join(character if character.isprintable() else "?" for character in reason),
        "vertices": None,
        "faces": None,
        "curves": None,
        "filled": None,
        "loops": [],
        "version": program_version(),
        "seconds": {},
    }


def summary(record: dict[str, Any]) -> dict[str, Any]:
    """What the driver is told of a file: few bytes, however many loops it has."""
    statuses = [loop["status"] for loop in record["loops"]]
    bad = [loop for loop in record["loops"] if loop["status"] != "done"]
    return {
        "key": record["source"],
        "status": record["status"],
        "reason": record["reason"],
        "loops": len(statuses),
        "loops_failed": statuses.count("failed"),
        "first": "" if not bad else f"loop {bad[0]['loop']} ({bad[0]['name'] or 'no name'}): {bad[0]['reason']}",
    }
