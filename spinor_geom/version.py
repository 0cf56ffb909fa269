"""The version of the package, with the commit if it is not released. The build reads it from this file."""

import subprocess
from functools import cache
from importlib.metadata import distributions
from pathlib import Path

RELEASE = "0.1.0"  # the next release, or the one tagged at this commit


@cache
def program_version() -> str:
    """The version of the running code.

    In a clone it names the commit, such as "0.1.0.dev0+g1f2e3d4c5", with ".dirty" if files differ from it. Otherwise it
    is the version in the metadata beside the package, or the release if there are none.
    """
    root = Path(__file__).parents[1]
    if not (root / ".git").exists():
        beside = next(iter(distributions(name="spinor-geom", path=[str(root)])), None)
        return RELEASE if beside is None else beside.version
    tag = f"v{RELEASE}"
    command = ["git", "-C", str(root), "describe", "--always", "--dirty=.dirty", "--abbrev=9", "--tags", "--match", tag]
    try:
        described = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):  # no git, or a clone of another user, which git does not read
        return f"{RELEASE}.dev0+unknown"
    return RELEASE if described == tag else f"{RELEASE}.dev0+g{described.rpartition('-g')[2]}"
