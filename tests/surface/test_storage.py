"""Saved surfaces are loaded bit for bit, and other files are refused."""

import json

import numpy as np
import pytest
import torch
from safetensors.torch import load as from_bytes
from safetensors.torch import save as to_bytes

from spinor_geom.domain import FourierBoundary, PlaneDomain
from spinor_geom.errors import StorageError
from spinor_geom.gallery import catenoid, enneper
from spinor_geom.holomorphic.circular_domain import CircularDomain
from spinor_geom.holomorphic.interpolant import CauchyInterpolant
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.surface.spinor_surface import SpinorSurface
from spinor_geom.surface.storage import VERSION
from tests.surface.test_spinor_surface import cauchy_surface


def stored_cauchy_surface():
    return SpinorSurface(cauchy_surface().model, DISK, (1.0, 2.0, 1 / 3), quadrature="simpson", order=8)


def interpolant_surface():
    boundary = FourierBoundary(np.array([0.1j, 0.5, 0.2, 1.5, 0.1]), 40)
    z, dz, _ = (torch.from_numpy(row) for row in boundary.grid(64))
    model = CauchyInterpolant(z, dz, torch.stack([torch.exp(z), 0.3 * z], dim=-1))
    return SpinorSurface(model, PlaneDomain.inside(boundary), (1.0, 2.0, 1 / 3), quadrature="gauss", order=16)


def annulus_surface(*, antiperiodic):
    outward, inward = torch.randn(2, 5, 2, dtype=torch.complex128, generator=torch.Generator().manual_seed(5))
    ring = CircularDomain.annulus(-np.log(0.4))
    model = LaurentSeries(outward, inward[None], ring, antiperiodic=(antiperiodic,))
    return SpinorSurface(model, PlaneDomain.annulus(0.4))


DISK = PlaneDomain.disk()
SURFACES = {
    "series": lambda: SpinorSurface.of(enneper(0.8).surface).associate(0.3).transform(scale=0.1),
    "series, spline domain": lambda: SpinorSurface.of(catenoid(0.5).surface),
    "cauchy": stored_cauchy_surface,
    "cauchy-interpolant, Fourier domain": interpolant_surface,
    "mlp": lambda: SpinorSurface(ComplexMLP(generator=torch.Generator().manual_seed(0)), PlaneDomain.disk()),
    "laurent": lambda: annulus_surface(antiperiodic=False),
    "laurent, antiperiodic": lambda: annulus_surface(antiperiodic=True),
}


@pytest.mark.parametrize("make", SURFACES.values(), ids=SURFACES.keys())
def test_round_trip_is_bit_exact(make, tmp_path):
    surface = make()
    surface.save(tmp_path / "surface.safetensors")
    loaded = SpinorSurface.load(tmp_path / "surface.safetensors")
    for name, tensor in surface.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], tensor), name
    assert set(loaded.state_dict()) == set(surface.state_dict())
    for name in ("points", "faces", "boundary_size", "hole_sizes"):
        there, here = (getattr(one.domain.triangulation, name) for one in (loaded, surface))
        np.testing.assert_array_equal(there, here)
    np.testing.assert_array_equal(loaded.domain.log_scale, surface.domain.log_scale)
    t = np.arange(50) / 50
    for again, boundary in zip(loaded.domain.boundaries, surface.domain.boundaries, strict=True):
        np.testing.assert_array_equal(again.point(t), boundary.point(t))
    z = surface.domain.triangulation.points[::3] * 0.999
    np.testing.assert_array_equal(loaded.position(z), surface.position(z))
    np.testing.assert_array_equal(loaded.mean_curvature(z), surface.mean_curvature(z))
    assert loaded.area() == surface.area()


def test_loaded_surface_can_be_trained(tmp_path):
    enneper(0.8).surface.save(tmp_path / "surface.safetensors")
    loaded = SpinorSurface.load(tmp_path / "surface.safetensors")
    loaded.position(torch.tensor([0.3 + 0.1j], dtype=torch.complex128)).sum().backward()
    assert all(parameter.grad is not None for parameter in loaded.parameters())


def test_saving_over_the_file_it_was_loaded_from(tmp_path):
    path = tmp_path / "surface.safetensors"
    enneper(0.8).surface.save(path)
    loaded = SpinorSurface.load(path)
    loaded.save(path)
    z = np.array([0.1, 0.2j])
    np.testing.assert_array_equal(SpinorSurface.load(path).position(z), loaded.position(z))


class Foreign(torch.nn.Module):
    kind = "foreign"

    def value(self, z):
        return torch.stack([torch.ones_like(z), z], dim=-1)


def test_unknown_model_is_refused_before_a_file_is_made(tmp_path):
    with pytest.raises(StorageError, match="foreign"):
        SpinorSurface(Foreign(), PlaneDomain.disk(n=16)).save(tmp_path / "surface.safetensors")
    assert list(tmp_path.iterdir()) == []


def saved(tmp_path):
    path = tmp_path / "surface.safetensors"
    enneper(0.8).surface.save(path)
    return path


def rewrite(path, *, metadata=None, description=None, drop=None, replace=None):
    """Writes the file again with something changed."""
    data = path.read_bytes()
    size = int.from_bytes(data[:8], "little")
    meta = json.loads(data[8 : 8 + size])["__metadata__"]
    if description:
        meta["description"] = json.dumps({**json.loads(meta["description"]), **description})
    tensors = {name: tensor for name, tensor in from_bytes(data).items() if name != drop}
    path.write_bytes(to_bytes({**tensors, **(replace or {})}, {**meta, **(metadata or {})}))


@pytest.mark.parametrize(
    "change",
    [
        {"description": {"version": VERSION - 1}},
        {"description": {"version": VERSION + 1}},
        {"description": {"version": "x"}},
        {"description": {"format": "something else"}},
        {"metadata": {"description": "{"}},
        {"metadata": {"description": "[]"}},
        {"metadata": {"description": "[" * 100_000}},
        {"drop": "constant"},
        {"drop": "domain/points"},
        {"drop": "model/coefficients"},
        {"replace": {"constant": torch.zeros(2, dtype=torch.float64)}},
        {"replace": {"domain/faces": torch.full((4, 3), 10**6)}},
        {"replace": {"model/coefficients": torch.zeros(7, 2, 2, dtype=torch.float64)}},
        {"replace": {"model/extra": torch.zeros(1)}},
        {"replace": {"spinor_map": torch.zeros(3, 2, 2, dtype=torch.float64)}},
        {"description": {"model": {"kind": "unknown", "config": {}}}},
        {"description": {"model": {"kind": "series", "config": {}}}},
        {"description": {"boundaries": ["ellipse"]}},
        {"description": {"boundaries": []}},
        {"description": {"quadrature": "euler"}},
        {"description": {"order": 0}},
        {"description": {"order": "many"}},
        {"description": {"order": 10**9}},
        {"description": {"order": 10**30}},
    ],
    ids=str,
)
def test_damaged_or_foreign_descriptions_are_refused(change, tmp_path):
    path = saved(tmp_path)
    rewrite(path, **change)
    with pytest.raises(StorageError, match="surface"):
        SpinorSurface.load(path)


@pytest.mark.parametrize("make", SURFACES.values(), ids=SURFACES.keys())
def test_sizes_are_compared_with_the_arrays_before_memory_is_taken_for_them(make, tmp_path):
    path = tmp_path / "surface.safetensors"
    make().save(path)
    whole, surface = path.read_bytes(), SpinorSurface.load(path)
    config = surface.model.config()
    for name in (name for name, value in config.items() if type(value) is int):
        for size in (10**9, 10**15, 10**30, 1e300, -1):
            path.write_bytes(whole)
            rewrite(path, description={"model": {"kind": surface.model.kind, "config": {**config, name: size}}})
            with pytest.raises(StorageError, match="does not fit its description"):
                SpinorSurface.load(path)


def test_truncated_files_are_refused(tmp_path):
    data = saved(tmp_path).read_bytes()
    for length in (0, 4, 100, len(data) // 2, len(data) - 1):
        path = tmp_path / "cut"
        path.write_bytes(data[:length])
        with pytest.raises(StorageError, match="cut"):
            SpinorSurface.load(path)


def test_other_files_and_missing_ones_are_refused(tmp_path):
    pickle = tmp_path / "model.pt"
    torch.save({"a": torch.zeros(3)}, pickle)
    for path in (pickle, tmp_path / "missing", tmp_path):
        with pytest.raises(StorageError):
            SpinorSurface.load(path)


@pytest.mark.parametrize("name", ["surface.obj", "surface", "missing/surface.safetensors"])
def test_a_name_that_cannot_be_written_is_one_sentence(tmp_path, name):
    with pytest.raises(StorageError, match=r"saved as \.safetensors|cannot be written"):
        SURFACES["series"]().save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
