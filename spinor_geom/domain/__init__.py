"""Plane domains Ω: boundary, triangulation, flattening, quadrature."""

from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain, SplineBoundary

__all__ = ["FourierBoundary", "PlaneDomain", "SplineBoundary"]
