"""Names of inputs as names of outputs: relative, harmless on every system, and different for different inputs."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable

LONGEST_PART, LONGEST_NAME = 180, 700
# What no name has by itself: a % stands before two digits, or at an end.
ADDED = "%~"
UNSAFE = re.compile(r"[\x00-\x1f\x7f\\/:*?\"<>|%\ud800-\udfff]|^[. ]|[. ]$")


def safe_name(parts: Iterable[str]) -> str:
    """A relative path of harmless parts.

    What a file system may take amiss is written as % and two hexadecimal digits a byte, so different names stay
    different; names that are too long end in %~ and a checksum instead of their rest.
    """
    *folders, last = map(_safe_part, parts)
    # folders of results are named after files: one inside the other would be removed with it
    name = "/".join([*(f"{part}%" if part.lower().endswith(".obj") else part for part in folders), last])
    return name if len(os.fsencode(name)) <= LONGEST_NAME else _shortened(name, LONGEST_PART)


def _safe_part(part: str) -> str:
    safe = UNSAFE.sub(lambda found: "".join(f"%{byte:02X}" for byte in os.fsencode(found.group())), part) or "%"
    return safe if len(os.fsencode(safe)) <= LONGEST_PART else _shortened(safe, LONGEST_PART - 20)


def _shortened(name: str, length: int) -> str:
    digest = hashlib.sha256(os.fsencode(name)).hexdigest()[:16]
    start = os.fsencode(name.replace("/", "%2F"))[:length].decode("utf-8", "ignore")
    return f"{start}{ADDED}{digest}"
