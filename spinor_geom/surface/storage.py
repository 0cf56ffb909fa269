"""Surfaces in files: safetensors with a versioned JSON description, without pickle.

Complex arrays are stored as pairs of real numbers, because safetensors has no complex128. Reading restores every array
bit for bit.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import safetensors
from safetensors.numpy import save as to_bytes

from spinor_geom.arrays import to_numpy
from spinor_geom.domain.plane_domain import Boundary, FourierBoundary, PlaneDomain, SplineBoundary
from spinor_geom.domain.quadrature import rule
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import StorageError
from spinor_geom.files import SURFACE_SUFFIX, atomic_path, regular_file
from spinor_geom.holomorphic.model import rebuild, saved_arrays

if TYPE_CHECKING:
    from spinor_geom.surface.array_surface import ArraySurface

FORMAT = "spinor_geom.surface"
VERSION = 8
_BOUNDARY_PARTS = ("parameters", "coefficients", "corners")


def write(surface: ArraySurface, path: str | os.PathLike[str]) -> None:
    """Writes a surface to a file, completely or not at all."""
    if Path(path).suffix.lower() != SURFACE_SUFFIX:
        wrong = f"a surface is saved as {SURFACE_SUFFIX}, not '{Path(path).suffix}'"
        raise StorageError(f"{os.fspath(path)}: {wrong}", path=path)
    boundaries, mesh = surface.domain.boundaries, surface.domain.triangulation
    arrays = {
        **{f"model/{name}": to_numpy(array) for name, array in saved_arrays(surface.model).items()},
        **{
            f"boundary{number}/{name}": getattr(boundary, name)
            for number, boundary in enumerate(boundaries)
            for name in _BOUNDARY_PARTS
        },
        "constant": to_numpy(surface.constant),
        "spinor_map": to_numpy(surface.spinor_map),
        "domain/points": mesh.points,
        "domain/faces": mesh.faces,
        "domain/log_scale": surface.domain.log_scale,
    }
    description = {
        "format": FORMAT,
        "version": VERSION,
        "model": {"kind": surface.model.kind, "config": surface.model.config()},
        "boundaries": ["fourier" if isinstance(one, FourierBoundary) else "spline" for one in boundaries],
        "quadrature": surface.quadrature,
        "order": surface.order,
        "complex": sorted(name for name, array in arrays.items() if np.iscomplexobj(array)),
    }
    # np.ascontiguousarray would turn 0-dimensional arrays into vectors
    plain = {name: _as_real(np.asarray(array, order="C")) for name, array in arrays.items()}
    try:
        with atomic_path(Path(path)) as temporary:
            # one entry of metadata, because the order of several is random, and equal surfaces should give equal files
            temporary.write_bytes(to_bytes(plain, {"description": json.dumps(description)}))
    except OSError as error:
        raise StorageError(f"{os.fspath(path)}: cannot be written ({error.strerror or error})", path=path) from error


def _as_real(array: np.ndarray) -> np.ndarray:
    return array.view(np.float64).reshape(*array.shape, 2) if np.iscomplexobj(array) else array


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The arguments of the `SpinorSurface` in a file."""
    name = os.fspath(path)
    try:
        with safetensors.safe_open(regular_file(name), framework="np") as file:
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 - not a mapping
            description = json.loads((file.metadata() or {}).get("description", "{}"))
    except (OSError, ValueError, RecursionError, safetensors.SafetensorError) as error:
        problem = getattr(error, "strerror", None) or error
        raise StorageError(f"{name} cannot be read as a saved surface: {problem}", path=name) from error
    if not isinstance(description, dict) or description.get("format") != FORMAT:
        raise StorageError(f"{name} is not a saved surface: its header has no format {FORMAT!r}", path=name)
    if (version := description.get("version")) != VERSION:
        raise StorageError(
            f"{name} has format version {version}, and this program reads version {VERSION}; "
            "read it with the version of spinor-geom that wrote it",
            path=name,
            version=version,
        )
    try:
        return _parts(description, tensors)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError, RuntimeError, StorageError) as error:
        raise StorageError(f"{name} is not a complete saved surface: {error}", path=name) from error


def _parts(description: Mapping[str, Any], tensors: Mapping[str, np.ndarray]) -> dict[str, Any]:
    data = {
        name: np.ascontiguousarray(tensor).view(np.complex128)[..., 0] if name in description["complex"] else tensor
        for name, tensor in tensors.items()
    }
    rule(description["quadrature"], description["order"])
    if data["constant"].shape != (3,) or data["spinor_map"].shape != (2, 2):
        raise ValueError("its constant or its matrix has the wrong shape")
    state = {name.removeprefix("model/"): tensor for name, tensor in data.items() if name.startswith("model/")}
    return {
        "model": rebuild(description["model"]["kind"], description["model"]["config"], state),
        "domain": _read_domain(description, data),
        "constant": data["constant"],
        "spinor_map": data["spinor_map"],
        "quadrature": description["quadrature"],
        "order": description["order"],
    }


def _read_domain(description: Mapping[str, Any], data: Mapping[str, np.ndarray]) -> PlaneDomain:
    boundary, *holes = (
        _read_boundary(some, {name.removeprefix(f"boundary{number}/"): tensor for name, tensor in data.items()})
        for number, some in enumerate(description["boundaries"])
    )
    points, faces = data["domain/points"], data["domain/faces"]
    hole_sizes = tuple(len(hole.vertices) for hole in holes)
    size = len(boundary.vertices) + sum(hole_sizes)
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.min() < 0 or faces.max() >= len(points):
        raise ValueError("its faces have indices out of range")
    if len(points) < size:
        raise ValueError("its triangulation does not fit its boundary")
    return PlaneDomain(
        boundary=boundary,
        triangulation=PlaneTriangulation(points=points, faces=faces, boundary_size=size, hole_sizes=hole_sizes),
        log_scale=data["domain/log_scale"],
        holes=tuple(holes),
    )


def _read_boundary(kind: str, parts: Mapping[str, np.ndarray]) -> Boundary:
    parameters, coefficients, corners = (parts[name] for name in _BOUNDARY_PARTS)
    if kind == "fourier":
        return FourierBoundary(coefficients, len(corners))
    if kind == "spline":
        return SplineBoundary(parameters, coefficients, corners)
    raise ValueError(f"unknown kind of boundary {kind!r}")
