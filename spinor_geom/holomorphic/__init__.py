"""Holomorphic models: p and q as functions on Ω."""
