"""Measures of meshes: one definition each."""
