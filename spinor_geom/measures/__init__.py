"""Measures of meshes: one definition each."""

from spinor_geom.measures.hausdorff import HausdorffDistance, OneSidedDistance, hausdorff_distance
from spinor_geom.measures.mean_curvature import DiscreteMeanCurvature, discrete_mean_curvature
from spinor_geom.measures.quality import TriangleQuality, triangle_quality
from spinor_geom.mesh.intersections import self_intersections

__all__ = [
    "DiscreteMeanCurvature",
    "HausdorffDistance",
    "OneSidedDistance",
    "TriangleQuality",
    "discrete_mean_curvature",
    "hausdorff_distance",
    "self_intersections",
    "triangle_quality",
]
