"""The version, and for what is not released the commit it was made from. The build takes it from here too."""

import subprocess
from functools import cache
from importlib.metadata import distributions
from pathlib import Path

RELEASE = "0.1.0"  # the next one, or the one whose tag v0.1.0 stands on this commit


@cache
def program_version() -> str:
    """The version of the code that is running.

    In a clone it tells the commit, as "0.1.0.dev0+g1f2e3d4c5", with ".dirty" after it where files differ from that.
    An installed package, and one that is built from an sdist, tell what the metadata beside it tell: those of another
    installation are of other code. Files that come with neither tell the release.
    """
    root = Path(__file__).parents[1]
    if not (root / ".git").exists():
        beside = next(iter(distributions(name="spinor-geom", path=[str(root)])), None)
        return RELEASE if beside is None else beside.version
    tag = f"v{RELEASE}"
    command = ["git", "-C", str(root), "describe", "--always", "--dirty=.dirty", "--abbrev=9", "--tags", "--match", tag]
    try:
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return f"{RELEASE}.dev0+unknown"  # no git, or a clone that belongs to somebody else, which git does not open
    return RELEASE if said == tag else f"{RELEASE}.dev0+g{said.rpartition('-g')[2]}"
