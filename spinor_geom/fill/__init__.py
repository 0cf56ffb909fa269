"""Fills the holes of meshes: chooses loops, solves for their surfaces, meshes these, joins the patches to the mesh."""
