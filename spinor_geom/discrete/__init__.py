"""Discrete minimal surfaces: the baseline, and the start of the exact solver."""

from spinor_geom.discrete.minimal_surface import DiscreteMinimalSurface, discrete_minimal_surface

__all__ = ["DiscreteMinimalSurface", "discrete_minimal_surface"]
