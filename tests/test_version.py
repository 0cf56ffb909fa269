"""The version has the commit of a clone, or else that of the build."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from spinor_geom.version import RELEASE

SOURCE = Path(__file__).parents[1] / "spinor_geom" / "version.py"


def git(folder, *arguments):
    identity = ["-c", "user.name=a", "-c", "user.email=a@b"]
    command = ["git", "-C", str(folder), *identity, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture
def root(tmp_path):
    """A folder with a package whose version is determined."""
    (tmp_path / "spinor_geom").mkdir()
    (tmp_path / "spinor_geom" / "__init__.py").touch()
    shutil.copy(SOURCE, tmp_path / "spinor_geom")
    return tmp_path


def version_in(root):
    """The version that a new process finds in that folder."""
    program = "from spinor_geom.version import program_version; print(program_version())"
    command = [sys.executable, "-B", "-c", program]
    environment = {"PATH": os.environ["PATH"]}
    output = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=True)
    return output.stdout.strip()


def test_a_clone_reports_its_commit_and_whether_files_differ(root):
    git(root, "init", "-q")
    git(root, "add", ".")
    git(root, "commit", "-qm", "first")
    commit = git(root, "rev-parse", "--short=9", "HEAD")
    assert version_in(root) == f"{RELEASE}.dev0+g{commit}"
    (root / "spinor_geom" / "__init__.py").write_text("# changed\n")
    assert version_in(root) == f"{RELEASE}.dev0+g{commit}.dirty"
    git(root, "tag", f"v{RELEASE}")
    git(root, "checkout", "-q", ".")
    assert version_in(root) == RELEASE
    git(root, "commit", "-q", "--allow-empty", "-m", "second")
    commit = git(root, "rev-parse", "--short=9", "HEAD")
    assert version_in(root) == f"{RELEASE}.dev0+g{commit}"


def test_a_clone_that_git_does_not_open_is_reported(root):
    (root / ".git").touch()
    assert version_in(root) == f"{RELEASE}.dev0+unknown"


def test_an_installed_package_reports_its_commit_and_bare_files_the_release(root):
    assert version_in(root) == RELEASE
    metadata = root / "spinor_geom-7.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text("Metadata-Version: 2.1\nName: spinor-geom\nVersion: 7.0+gabc\n")
    assert version_in(root) == "7.0+gabc"
