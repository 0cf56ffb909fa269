"""Minimal surfaces from two holomorphic functions."""

from spinor_geom.surface.branch import BranchPoint
from spinor_geom.surface.spinor_surface import SpinorSurface

__all__ = ["BranchPoint", "SpinorSurface"]
