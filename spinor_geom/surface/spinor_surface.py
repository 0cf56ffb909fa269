"""The surface of two holomorphic functions as a torch module, with gradients."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from jaxtyping import Complex, Float

from spinor_geom.arrays import Array, to_numpy
from spinor_geom.surface import curvature
from spinor_geom.surface.array_surface import ArraySurface, Points, anchors, integrate, require_complex_points
from spinor_geom.surface.module import ModelModule, as_module
from spinor_geom.torch_extra import torch


class SpinorSurface(ArraySurface, torch.nn.Module):
    """An `ArraySurface` whose model and constant can be trained by any torch optimiser.

    The model is copied into a module, unless it is one. Results for tensors are differentiable in the parameters and
    in z. Arrays of points are evaluated without torch if the parameters are on the CPU.
    """

    def _set(self, model: Any, constant: Float[Array, "3"], spinor_map: Complex[Array, "2 2"]) -> None:
        torch.nn.Module.__init__(self)
        self.model = as_module(model)
        self.constant = torch.nn.Parameter(torch.as_tensor(constant).detach().clone())
        self.register_buffer("spinor_map", torch.as_tensor(spinor_map).detach().clone())

    @classmethod
    def of(cls, surface: ArraySurface) -> SpinorSurface:
        """A surface as a module, with a copy of its arrays. A module is returned as it is."""
        if isinstance(surface, cls):
            return surface
        return cls(surface.model, surface.domain, surface.constant, spinor_map=surface.spinor_map, **surface._rule)

    def mean_curvature(self, z: Points) -> Points:
        """See `ArraySurface.mean_curvature`."""
        return self._evaluate(_mean_curvature, z)

    def _evaluate(self, function: Callable[..., Array], *points: Points) -> Points:
        if isinstance(points[0], torch.Tensor):
            require_complex_points(points)
            values: Points = function(self, *(z.to(torch.complex128) for z in points))
            return values
        if function is _mean_curvature or self.constant.device.type != "cpu" or not isinstance(self.model, ModelModule):
            with torch.no_grad():
                return super()._evaluate(function, *points)
        constant, spinor_map = to_numpy(self.constant), to_numpy(self.spinor_map)
        untracked = ArraySurface(self.model.untracked, self.domain, constant, spinor_map=spinor_map, **self._rule)
        return untracked._evaluate(function, *points)


def _mean_curvature(on: ArraySurface, z: Complex[torch.Tensor, "*pts"]) -> Float[torch.Tensor, "*pts"]:
    def integrated(start: curvature.Points, end: curvature.Points) -> Float[torch.Tensor, "n 3"]:
        displacement: torch.Tensor = integrate(on, start, end)
        return displacement

    end = z.reshape(-1)
    _, start = anchors(on, end)
    mean = curvature.mean_curvature_of_integrals(integrated, start, end, order=on.order)
    return mean.reshape(z.shape)
