"""Derivatives of minimal surfaces with respect to the points of their boundary curves."""
