"""Fills the holes of meshes: chooses loops, solves each, meshes the surfaces, joins the patches to the mesh."""
