"""Triangle meshes of solved surfaces."""

from spinor_geom.meshing.embed import Patch, mesh_patch

__all__ = ["Patch", "mesh_patch"]
