"""Surfaces in files: safetensors with a JSON description, versioned, without pickle.

Complex arrays are stored as pairs of real numbers, because safetensors has no complex128. Reading restores every array,
and so every later answer, bit for bit.
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
from spinor_geom.files import atomic_path
from spinor_geom.holomorphic.model import MODELS, HolomorphicModel, rebuild

if TYPE_CHECKING:
    from spinor_geom.surface.spinor_surface import SpinorSurface

FORMAT = "spinor_geom.surface"
VERSION = 7


def write(surface: SpinorSurface, path: str | os.PathLike[str]) -> None:
    """Writes a surface; the file appears whole or not at all."""
    kind = getattr(surface.model, "kind", type(surface.model).__name__)
    if kind not in MODELS or not isinstance(surface.model, MODELS[kind]):
        raise StorageError(f"a model of kind {kind!r} cannot be saved; known: {', '.join(sorted(MODELS))}", kind=kind)
    described = [_describe_boundary(boundary) for boundary in surface.domain.boundaries]
    mesh = surface.domain.triangulation
    tensors = {
        **{f"model/{name}": tensor for name, tensor in surface.model.state_dict().items()},
        **{
            f"boundary{number}/{name}": tensor
            for number, (_, some) in enumerate(described)
            for name, tensor in some.items()
        },
        "constant": surface.constant,
        "spinor_map": surface.spinor_map,
        "domain/points": torch.tensor(mesh.points),
        "domain/faces": torch.tensor(mesh.faces),
        "domain/log_scale": torch.tensor(surface.domain.log_scale),
    }
    description = {
        "model": {"kind": kind, "config": cast(HolomorphicModel, surface.model).config()},
        "boundaries": [boundary for boundary, _ in described],
        "quadrature": surface.quadrature,
        "order": surface.order,
        "complex": sorted(name for name, tensor in tensors.items() if tensor.is_complex()),
    }
    metadata = {"format": FORMAT, "version": str(VERSION), "description": json.dumps(description)}
    data = _in_fixed_order(to_bytes({name: _plain(tensor) for name, tensor in tensors.items()}, metadata))
    with atomic_path(Path(path)) as temporary:
        temporary.write_bytes(data)


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The arguments of the `SpinorSurface` that `write` wrote."""
    name = os.fspath(path)
    try:
        with safetensors.safe_open(name, framework="pt") as file:
            # clones: the file's own memory goes with it, and is not aligned for complex numbers (torch crashes on it)
            tensors = {key: file.get_tensor(key).clone() for key in file.keys()}  # noqa: SIM118 - not a mapping
            metadata = file.metadata() or {}
    except (OSError, safetensors.SafetensorError) as error:
        raise StorageError(f"{name} cannot be read as a saved surface: {error}", path=name) from error
    if metadata.get("format") != FORMAT:
        raise StorageError(f"{name} is not a saved surface: its header does not say {FORMAT!r}", path=name)
    if metadata.get("version") != str(VERSION):
        raise StorageError(
            f"{name} has format version {metadata.get('version')}, this program reads version {VERSION}; "
            "read it with the version of spinor-geom that wrote it",
            path=name,
            version=metadata.get("version"),
        )
    try:
        return _parts(json.loads(metadata["description"]), tensors)
    except (KeyError, TypeError, ValueError, IndexError, RuntimeError, StorageError) as error:
        raise StorageError(f"{name} is no whole saved surface: {error}", path=name) from error


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
        raise ValueError("its triangulation names points that do not exist")
    if len(points) < size:
        raise ValueError("its triangulation does not fit its boundary")
    return PlaneDomain(
        boundary=boundary,
        triangulation=PlaneTriangulation(points=points, faces=faces, boundary_size=size, hole_sizes=hole_sizes),
        log_scale=data["domain/log_scale"].numpy(),
        holes=tuple(holes),
    )


def _describe_boundary(boundary: Boundary) -> tuple[dict[str, Any], dict[str, Tensor]]:
    if isinstance(boundary, FourierBoundary):
        coefficients = {"coefficients": torch.tensor(boundary.coefficients)}
        return {"kind": "fourier", "count": len(boundary.vertices)}, coefficients
    if isinstance(boundary, SplineBoundary):
        return {"kind": "spline"}, {
            "parameters": torch.tensor(boundary.parameters),
            "coefficients": torch.tensor(boundary.coefficients),
            "corners": torch.tensor(boundary.corners),
        }
    raise StorageError(f"a boundary of type {type(boundary).__name__} cannot be saved; known: fourier, spline")


def _read_boundary(description: Mapping[str, Any], data: Mapping[str, Tensor]) -> Boundary:
    if description["kind"] == "fourier":
        return FourierBoundary(data["coefficients"].numpy(), int(description["count"]))
    if description["kind"] == "spline":
        parts = ("parameters", "coefficients", "corners")
        return SplineBoundary(*(data[part].numpy() for part in parts))
    raise ValueError(f"unknown boundary kind {description['kind']!r}")


def _in_fixed_order(data: bytes) -> bytes:
    """The file with sorted metadata, whose order safetensors leaves to chance: equal surfaces are equal files."""
    start = 8  # of the header, after its size
    size = int.from_bytes(data[:start], "little")
    header = json.loads(data[start : start + size])
    header["__metadata__"] = dict(sorted(header["__metadata__"].items()))
    text = json.dumps(header, ensure_ascii=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)  # tensors are aligned
    return len(text).to_bytes(start, "little") + text + data[start + size :]


def _plain(tensor: Tensor) -> Tensor:
    """What safetensors can store: contiguous, on the CPU, real."""
    tensor = tensor.detach().cpu().resolve_conj()
    return (torch.view_as_real(tensor) if tensor.is_complex() else tensor).contiguous()
