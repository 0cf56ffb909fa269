"""Holomorphic models: p and q as functions on Ω."""

from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.laurent import LaurentSeries
from spinor_geom.holomorphic.mlp import ComplexMLP
from spinor_geom.holomorphic.model import MODELS, HolomorphicModel, rebuild
from spinor_geom.holomorphic.series import PowerSeries

__all__ = ["MODELS", "CauchyNetwork", "ComplexMLP", "HolomorphicModel", "LaurentSeries", "PowerSeries", "rebuild"]
