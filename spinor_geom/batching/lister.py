"""The process that lists archives: what is in them is nobody's word, and lists that would fill the memory end there."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from spinor_geom.batching.archives import members
from spinor_geom.batching.names import ADDED, safe_name
from spinor_geom.errors import ArchiveError
from spinor_geom.isolate import Tell, serve


def work(job: dict[str, Any], tell: Tell) -> None:
    """Lists an archive.

    Args:
        job: "archive", its path; "suffix" of the names that are wanted; "parts" of their keys, before those of their
            own names; "listing", the file that takes a line of JSON for each: its key, and the fields of its `Member`.
        tell: is called with "listed" after each member, and with "problem" where the archive cannot be used.
    """
    seen: Counter[str] = Counter()
    try:
        with open(job["listing"], "w", encoding="ascii") as file:
            for member in members(Path(job["archive"])):
                if member.name.lower().endswith(job["suffix"]):
                    inner = (part for part in member.name.replace("\\", "/").split("/") if part not in ("", "."))
                    key = safe_name([*job["parts"], *inner])
                    # some file systems see no difference between A and a
                    seen[key.lower()] += 1
                    key += f"{ADDED}{seen[key.lower()]}" if seen[key.lower()] > 1 else ""
                    file.write(json.dumps([key, asdict(member)]) + "\n")
                tell({"listed": member.place})
    except ArchiveError as error:
        tell({"problem": str(error)})
    except OSError as error:
        tell({"problem": f"{job['archive']}: cannot be read ({error.strerror}); check the access rights"})


if __name__ == "__main__":
    serve(work)
