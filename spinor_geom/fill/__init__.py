"""Fills holes: chooses loops, solves each, meshes the surfaces, joins them to the mesh, reports."""
