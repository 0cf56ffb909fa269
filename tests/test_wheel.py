"""The contents of the wheel, and that it works without the source."""

import importlib.metadata
import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from email.parser import Parser
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.slow  # CI builds and installs the wheel as well


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A copy to build from, because a build leaves folders behind and includes those of earlier builds."""
    source = tmp_path_factory.mktemp("source")
    shutil.copytree(ROOT / "spinor_geom", source / "spinor_geom", ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE", "MANIFEST.in"):
        shutil.copy(ROOT / name, source)
    return source


@pytest.fixture(scope="module")
def wheel(source, tmp_path_factory):
    return built_wheel(source, tmp_path_factory.mktemp("wheel"))


def built_wheel(source, target):
    """The wheel of a folder or of an sdist."""
    pip = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--quiet", "-w", target, source]
    subprocess.run(pip, check=True, timeout=120)
    (built,) = target.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def unpacked(wheel, tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def built(source, target, kind):
    """The file that the setuptools hook of this name builds."""
    program = f"import sys; from setuptools import build_meta; build_meta.build_{kind}(sys.argv[1])"
    subprocess.run(
        [sys.executable, "-c", program, str(target)], cwd=source, check=True, timeout=120, capture_output=True
    )
    (made,) = target.iterdir()
    return made


def contents(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if ".dist-info/" not in name}


def test_the_wheel_of_the_sdist_is_the_wheel_of_the_source(wheel, source, tmp_path):
    assert contents(built_wheel(built(source, tmp_path, "sdist"), tmp_path / "wheel")) == contents(wheel)


IMPORT = "import spinor_geom.adapters, spinor_geom; print(spinor_geom.adapters.__file__, spinor_geom.MeshFile)"


def imported(program, place, *arguments, options=()):
    """The path from which a program in a given folder imports the adapters; the program prints it."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, *options, "-c", program, *map(str, arguments)]
    done = subprocess.run(command, cwd=place, env=environment, timeout=120, check=True, capture_output=True, text=True)
    return Path(done.stdout.split(" <class")[0])


def test_an_editable_install_finds_the_adapters(source, tmp_path):
    with zipfile.ZipFile(built(source, tmp_path, "editable")) as archive:
        archive.extractall(tmp_path / "site")
    # without what this environment makes known at its start: the package may be installed in it in the same way
    packages = tmp_path / "packages"
    packages.mkdir()
    for folder in {sysconfig.get_paths()[name] for name in ("purelib", "platlib")}:
        for entry in Path(folder).iterdir():
            if not entry.name.startswith(("spinor_geom", "__editable__")):
                (packages / entry.name).symlink_to(entry)
    first = "import site, sys; [site.addsitedir(folder) for folder in sys.argv[1:]]; "
    found = imported(first + IMPORT, tmp_path, tmp_path / "site", packages, options=["-S"])
    assert found == source / "spinor_geom" / "adapters" / "__init__.py"


def test_the_wheel_holds_every_module_and_nothing_else(wheel):
    held = contents(wheel)
    expected = {path.relative_to(ROOT).as_posix() for path in (ROOT / "spinor_geom").rglob("*.py")}
    assert held == expected | {
        "spinor_geom/__init__.pyi",
        "spinor_geom/py.typed",
        f"spinor_geom/_kernel{EXTENSION_SUFFIXES[0]}",
        *(f"spinor_geom/render/{name}" for name in ("page.css", "three.LICENSE", "three.min.js", "viewer.js")),
    }


def test_the_wheel_has_its_licence_and_its_command(unpacked):
    (info,) = unpacked.glob("*.dist-info")
    metadata = metadata_of(unpacked)
    assert metadata["Name"] == "spinor-geom"
    assert metadata["License-Expression"] == "MIT"
    assert "MIT License" in (info / "licenses" / "LICENSE").read_text(encoding="utf-8")
    assert "three.js authors" in (info / "licenses/spinor_geom/render/three.LICENSE").read_text(encoding="utf-8")
    entries = (info / "entry_points.txt").read_text(encoding="utf-8")
    assert "spinor-geom = spinor_geom.cli.main:main" in entries
    assert "[pyvista.accessors]\nspinor = spinor_geom.fill.pyvista_accessor" in entries


def requirements(unpacked):
    return [Requirement(line) for line in metadata_of(unpacked).get_all("Requires-Dist") or ()]


def metadata_of(unpacked):
    (info,) = unpacked.glob("*.dist-info")
    return Parser().parsestr((info / "METADATA").read_text(encoding="utf-8"))


def test_the_default_install_excludes_no_version_of_python(unpacked):
    versions = {f"3.{minor}" for minor in range(10, 16)}
    assert set(SpecifierSet(metadata_of(unpacked)["Requires-Python"]).filter(versions)) == versions
    least = [one for one in requirements(unpacked) if "extra" not in str(one.marker)]
    # no marker leaves one out, no upper bound keeps it from a release with wheels for a later Python
    assert not [one for one in least if one.marker or any(bound.operator != ">=" for bound in one.specifier)]
    names, seen = [one.name for one in least], set[str]()
    while names:
        name = names.pop()
        if name not in seen:
            seen.add(name)
            needed = importlib.metadata.metadata(name)["Requires-Python"] or ""
            assert SpecifierSet(needed).contains("3.15"), f"{name} requires Python {needed}"
            further = map(Requirement, importlib.metadata.requires(name) or ())
            names += [one.name for one in further if one.marker is None or one.marker.evaluate({"extra": ""})]
    assert {"numpy", "scipy", "libigl", "trimesh", "mdurl"} <= seen  # the last one through two others
    assert not seen & {"torch", "pymeshlab", "pyvista"}


def test_all_has_the_packages_of_every_feature(unpacked):
    metadata = metadata_of(unpacked)
    (included,) = (one.extras for one in requirements(unpacked) if 'extra == "all"' in str(one.marker))
    assert included == set(metadata.get_all("Provides-Extra")) - {"all", "peers", "docs", "dev"}


def test_the_wheel_works_away_from_the_source(unpacked, tmp_path, monkeypatch):
    mesh = tmp_path / "corner.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 4 2\n")
    monkeypatch.setenv("PYTHONPATH", str(unpacked))
    program = "import sys; from spinor_geom.cli.main import main; sys.exit(main(sys.argv[1:]))"
    outputs = [
        subprocess.check_output([sys.executable, "-c", program, *arguments], cwd=tmp_path, text=True, timeout=120)
        for arguments in (["loops", str(mesh)], ["--version"])
    ]
    assert [line.split("\t")[:2] for line in outputs[0].splitlines()[1:]] == [["0", "3"]]
    assert outputs[1] == "spinor-geom 0.1.0\n"
