"""Plane domains Ω: boundary, triangulation, flattening, quadrature."""

from spinor_geom.domain.plane_domain import FourierBoundary, PathTree, PlaneDomain, SplineBoundary

__all__ = ["FourierBoundary", "PathTree", "PlaneDomain", "SplineBoundary"]
