"""Surfaces in files: safetensors with a versioned JSON description, without pickle.

Complex arrays are stored as pairs of real numbers, because safetensors has no complex128. Reading restores every array
bit for bit.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import safetensors
import torch
from safetensors.torch import save as to_bytes
from torch import Tensor

from spinor_geom.domain.plane_domain import Boundary, FourierBoundary, PlaneDomain, SplineBoundary
from spinor_geom.domain.quadrature import rule
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import StorageError
from spinor_geom.files import SURFACE_SUFFIX, atomic_path
from spinor_geom.holomorphic.model import MODELS, HolomorphicModel, rebuild

if TYPE_CHECKING:
    from spinor_geom.surface.spinor_surface import SpinorSurface

FORMAT = "spinor_geom.surface"
VERSION = 8
_BOUNDARY_PARTS = ("parameters", "coefficients", "corners")


def write(surface: SpinorSurface, path: str | os.PathLike[str]) -> None:
    """Writes a surface to a file, completely or not at all."""
    if Path(path).suffix.lower() != SURFACE_SUFFIX:
        wrong = f"a surface is saved as {SURFACE_SUFFIX}, not '{Path(path).suffix}'"
        raise StorageError(f"{os.fspath(path)}: {wrong}", path=path)
    kind = getattr(surface.model, "kind", type(surface.model).__name__)
    if kind not in MODELS or not isinstance(surface.model, MODELS[kind]):
        raise StorageError(f"a model of kind {kind!r} cannot be saved; known: {', '.join(sorted(MODELS))}", kind=kind)
    boundaries, mesh = surface.domain.boundaries, surface.domain.triangulation
    tensors = {
        **{f"model/{name}": tensor for name, tensor in surface.model.state_dict().items()},
        **{
            f"boundary{number}/{name}": torch.tensor(getattr(boundary, name))
            for number, boundary in enumerate(boundaries)
            for name in _BOUNDARY_PARTS
        },
        "constant": surface.constant,
        "spinor_map": surface.spinor_map,
        "domain/points": torch.tensor(mesh.points),
        "domain/faces": torch.tensor(mesh.faces),
        "domain/log_scale": torch.tensor(surface.domain.log_scale),
    }
    description = {
        "format": FORMAT,
        "version": VERSION,
        "model": {"kind": kind, "config": cast(HolomorphicModel, surface.model).config()},
        "boundaries": ["fourier" if isinstance(one, FourierBoundary) else "spline" for one in boundaries],
        "quadrature": surface.quadrature,
        "order": surface.order,
        "complex": sorted(name for name, tensor in tensors.items() if tensor.is_complex()),
    }
    held = {name: tensor.detach().cpu().resolve_conj() for name, tensor in tensors.items()}
    plain = {name: (torch.view_as_real(t) if t.is_complex() else t).contiguous() for name, t in held.items()}
    try:
        with atomic_path(Path(path)) as temporary:
            # one entry of metadata: several are in random order, and equal surfaces should make equal files
            temporary.write_bytes(to_bytes(plain, {"description": json.dumps(description)}))
    except OSError as error:
        raise StorageError(f"{os.fspath(path)}: cannot be written ({error.strerror or error})", path=path) from error


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The arguments of the `SpinorSurface` in a file."""
    name = os.fspath(path)
    try:
        with safetensors.safe_open(name, framework="pt") as file:
            # cloned: the file's memory is released, and its alignment crashes torch's complex numbers
            tensors = {key: file.get_tensor(key).clone() for key in file.keys()}  # noqa: SIM118 - not a mapping
            description = json.loads((file.metadata() or {}).get("description", "{}"))
    except (OSError, ValueError, safetensors.SafetensorError) as error:
        raise StorageError(f"{name} cannot be read as a saved surface: {error}", path=name) from error
    if not isinstance(description, dict) or description.get("format") != FORMAT:
        raise StorageError(f"{name} is not a saved surface: its header has no format {FORMAT!r}", path=name)
    if (version := description.get("version")) != VERSION:
        raise StorageError(
            f"{name} has format version {version}, this program reads version {VERSION}; "
            "read it with the version of spinor-geom that wrote it",
            path=name,
            version=version,
        )
    try:
        return _parts(description, tensors)
    except (KeyError, TypeError, ValueError, IndexError, RuntimeError, StorageError) as error:
        raise StorageError(f"{name} is not a complete saved surface: {error}", path=name) from error


def _parts(description: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> dict[str, Any]:
    data = {
        name: torch.view_as_complex(tensor) if name in description["complex"] else tensor
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


def _read_domain(description: Mapping[str, Any], data: Mapping[str, Tensor]) -> PlaneDomain:
    boundary, *holes = (
        _read_boundary(some, {name.removeprefix(f"boundary{number}/"): tensor for name, tensor in data.items()})
        for number, some in enumerate(description["boundaries"])
    )
    points, faces = data["domain/points"].numpy(), data["domain/faces"].numpy()
    hole_sizes = tuple(len(hole.vertices) for hole in holes)
    size = len(boundary.vertices) + sum(hole_sizes)
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.min() < 0 or faces.max() >= len(points):
        raise ValueError("its faces have indices out of range")
    if len(points) < size:
        raise ValueError("its triangulation does not fit its boundary")
    return PlaneDomain(
        boundary=boundary,
        triangulation=PlaneTriangulation(points=points, faces=faces, boundary_size=size, hole_sizes=hole_sizes),
        log_scale=data["domain/log_scale"].numpy(),
        holes=tuple(holes),
    )


def _read_boundary(kind: str, parts: Mapping[str, Tensor]) -> Boundary:
    parameters, coefficients, corners = (parts[name].numpy() for name in _BOUNDARY_PARTS)
    if kind == "fourier":
        return FourierBoundary(coefficients, len(corners))
    if kind == "spline":
        return SplineBoundary(parameters, coefficients, corners)
    raise ValueError(f"unknown kind of boundary {kind!r}")
