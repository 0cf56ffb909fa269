"""Minimal surfaces through the points of rough loops."""
