"""Writes the extension for one platform as a zip, with the wheels that it needs.

Run it on Linux by Python 3.13, the version of Blender: `python3.13 blender/build.py`. Zig compiles for all platforms.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
PYTHON = (3, 13)  # Blender's


@dataclass(frozen=True, kw_only=True)
class Platform:
    """A platform as Zig, Python and pip call it."""

    target: str
    name: str
    suffix: str
    tags: Sequence[str]


# by Blender's names. glibc 2.28 is that of Blender, and pip does not take wheels for earlier versions by itself
PLATFORMS = {
    "linux-x64": Platform(
        target="x86_64-linux-gnu.2.28",
        name="manylinux_2_28_x86_64",
        suffix=".so",
        tags=["manylinux2014_x86_64", *(f"manylinux_2_{minor}_x86_64" for minor in range(17, 29))],
    ),
    "macos-arm64": Platform(
        target="aarch64-macos.14.0", name="macosx-14.0-arm64", suffix=".so", tags=["macosx_14_0_arm64"]
    ),
    "windows-x64": Platform(target="x86_64-windows-gnu", name="win-amd64", suffix=".pyd", tags=["win_amd64"]),
}


def write(folder: Path, platform: str, wheels: Sequence[Path]) -> Path:
    """Writes the zip of the extension with these wheels to a folder, and returns its path."""
    listed = {"platforms": [platform], "wheels": [f"./wheels/{wheel.name}" for wheel in wheels]}
    manifest = (HERE / "blender_manifest.toml").read_text(encoding="utf-8")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"spinor_geom-blender-{platform}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        lines = "".join(f"{key} = {json.dumps(values)}\n" for key, values in listed.items())
        archive.writestr("blender_manifest.toml", manifest + lines)
        archive.write(HERE / "__init__.py", "__init__.py")
        archive.write(HERE.parent / "LICENSE", "LICENSE")
        for wheel in wheels:
            archive.write(wheel, f"wheels/{wheel.name}")
    return path


def _pip(*words: object, **environment: str) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", *map(str, words)]
    subprocess.run(command, check=True, env={**os.environ, **environment})


def wheels(folder: Path, platform: Platform) -> list[Path]:
    """Builds the wheel of this clone for a platform, and downloads those that it needs and Blender does not have."""
    _pip("install", "--target", folder / "zig", "ziglang")
    compiler = f"{folder / 'zig' / 'ziglang' / 'zig'} c++ -target {platform.target}"
    # what setuptools compiles with and names the file and the wheel after, instead of this machine's
    built_for = {"SETUPTOOLS_EXT_SUFFIX": platform.suffix, "_PYTHON_HOST_PLATFORM": platform.name}
    _pip("wheel", "--no-deps", "-w", folder, HERE.parent, CC=compiler, CXX=compiler, **built_for)
    (own,) = folder.glob("*.whl")
    target = ["--only-binary=:all:", "--python-version={}.{}".format(*PYTHON)]
    _pip("download", *target, *(f"--platform={tag}" for tag in platform.tags), "-d", folder / "wheels", own)
    return sorted(path for path in (folder / "wheels").glob("*.whl") if not path.name.startswith("numpy-"))


def main() -> None:
    """Writes the zip for the given platform."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out"), help="folder of the zip (default: out)")
    parser.add_argument("--platform", choices=PLATFORMS, default="linux-x64", help="(default: linux-x64)")
    given = parser.parse_args()
    if sys.version_info[:2] != PYTHON or sys.platform != "linux":
        parser.error("run it on Linux with Python {}.{}".format(*PYTHON))
    with tempfile.TemporaryDirectory() as folder:
        print(write(given.output, given.platform, wheels(Path(folder), PLATFORMS[given.platform])))


if __name__ == "__main__":
    main()
