"""Writes the extension for one platform as a zip, with the wheels that it needs.

Run it with the version of Python that Blender has: `python3.13 blender/build.py`.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).parent
PYTHON = (3, 13)  # Blender's
# by Blender's names. On macOS pip takes wheels for earlier versions, too
PLATFORM_TAGS = {
    "linux-x64": ["linux_x86_64", "manylinux2014_x86_64", *(f"manylinux_2_{minor}_x86_64" for minor in range(18, 29))],
    "macos-arm64": ["macosx_14_0_arm64"],
    "windows-x64": ["win_amd64"],
}
OWN = {"linux": "linux-x64", "darwin": "macos-arm64", "win32": "windows-x64"}


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


def _pip(*words: object) -> None:
    subprocess.run([sys.executable, "-m", "pip", "--quiet", *map(str, words)], check=True)


def main() -> None:
    """Builds the wheel, downloads those that it needs, and writes the zip."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out"), help="folder of the zip (default: out)")
    parser.add_argument("--platform", choices=PLATFORM_TAGS, default=OWN[sys.platform])
    parser.add_argument("--wheel", type=Path, help="of spinor_geom for this platform; otherwise it is built")
    given = parser.parse_args()
    if given.wheel is None and (sys.version_info[:2] != PYTHON or given.platform != OWN[sys.platform]):
        parser.error("run it with Python {}.{} on the platform, or give the platform's --wheel".format(*PYTHON))
    with tempfile.TemporaryDirectory() as name:
        folder, wheel = Path(name), given.wheel
        if wheel is None:
            _pip("wheel", "--no-deps", "-w", folder, HERE.parent)
            (wheel,) = folder.glob("*.whl")
        target = [f"--platform={tag}" for tag in PLATFORM_TAGS[given.platform]]
        target += ["--only-binary=:all:", "--python-version={}.{}".format(*PYTHON)]
        _pip("download", *target, "-d", folder / "wheels", wheel)
        wheels = [path for path in (folder / "wheels").glob("*.whl") if not path.name.startswith("numpy-")]  # Blender's
        print(write(given.output, given.platform, sorted(wheels)))


if __name__ == "__main__":
    main()
