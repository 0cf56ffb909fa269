"""Plane domains Ω: boundary curves, triangulation, flattening, quadrature."""

from spinor_geom.domain.plane_domain import FourierBoundary, PlaneDomain, SplineBoundary

__all__ = ["FourierBoundary", "PlaneDomain", "SplineBoundary"]
