"""The machine, versions, commit, date and load of a measurement."""

import importlib.metadata
import os
import platform
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any, TypeAlias

from spinor_geom.version import program_version

Task: TypeAlias = Mapping[str, Any]
Record: TypeAlias = dict[str, Any]

_PACKAGES = (
    *("numpy", "scipy", "torch", "libigl", "pythoncdt", "trimesh", "pymeshlab", "meshlib", "pymeshfix", "cgal", "vtk"),
    *("open3d-cpu", "cadquery-ocp", "cadquery-ocp-novtk"),
)


def stamp() -> dict[str, Any]:
    """The fields that every record has: the version with its commit, the date, and the load of the machine."""
    load = _load()
    return {"commit": program_version(), "date": date.today().isoformat(), "load": load and round(load, 1)}


def _load() -> float | None:
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


def machine() -> dict[str, Any]:
    """Processor, cores, system, load, and the versions of the compared packages, None for one that is not installed."""
    found = {name: importlib.metadata.distributions(name=name) for name in _PACKAGES}
    versions = {name: next((one.version for one in here), None) for name, here in found.items()}
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "load": _load(),
        "threads": os.environ.get("OMP_NUM_THREADS"),
        "versions": {"spinor-geom": program_version(), **versions},
    }


def machine_text(here: Mapping[str, Any]) -> str:
    """The result of `machine` as a sentence."""
    versions = ", ".join(f"{name} {version or 'not installed'}" for name, version in here["versions"].items())
    threads = "" if here["threads"] is None else f", OMP_NUM_THREADS={here['threads']}"
    load = "" if here["load"] is None else f", load {here['load']:.1f} before the run"
    cores = f"{here['processor']}, {here['cores']} cores ({here['system']})"
    return f"{cores}{threads}{load}; Python {here['python']}, {versions}."


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
