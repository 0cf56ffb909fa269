"""Plane domains Ω: boundary, triangulation, flattening, quadrature."""

from spinor_geom.domain.plane_domain import CircleBoundary, PathTree, PlaneDomain, SplineBoundary

__all__ = ["CircleBoundary", "PathTree", "PlaneDomain", "SplineBoundary"]
