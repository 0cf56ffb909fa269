"""Training states in files: safetensors with a JSON description, written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save as to_bytes
from torch import Tensor

from spinor_geom.errors import StorageError
from spinor_geom.files import atomic_path
from spinor_geom.surface.storage import read_tensors

FORMAT = "spinor_geom.training"
VERSION = 1


def write_checkpoint(
    path: str | os.PathLike[str], tensors: Mapping[str, Tensor], description: Mapping[str, Any]
) -> None:
    """Writes tensors, complex ones too, and a JSON-ready description of them, replacing the file."""
    complex_names = sorted(name for name, tensor in tensors.items() if tensor.is_complex())
    metadata = {
        "format": FORMAT,
        "version": str(VERSION),
        "complex": json.dumps(complex_names),
        "description": json.dumps(description),
    }
    plain = {
        # a copy: two names may share memory, which the format does not take
        name: (torch.view_as_real(tensor) if tensor.is_complex() else tensor).detach().cpu().contiguous().clone()
        for name, tensor in tensors.items()
    }
    data = to_bytes(plain, metadata)
    with atomic_path(Path(path)) as temporary:
        temporary.write_bytes(data)


def read_checkpoint(path: str | os.PathLike[str]) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """The tensors and the description that `write_checkpoint` wrote, equal bit for bit.

    Raises:
        StorageError: the file cannot be read, is no checkpoint, or of an unknown version.
    """
    name = os.fspath(path)
    tensors, metadata = read_tensors(name, "a checkpoint")
    if metadata.get("format") != FORMAT or metadata.get("version") != str(VERSION):
        raise StorageError(
            f"{name} is not a checkpoint of version {VERSION}; remove it to train from the start", path=name
        )
    for key in json.loads(metadata["complex"]):
        tensors[key] = torch.view_as_complex(tensors[key])
    return tensors, json.loads(metadata["description"])
