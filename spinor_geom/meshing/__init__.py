"""Triangle meshes of solved surfaces."""
