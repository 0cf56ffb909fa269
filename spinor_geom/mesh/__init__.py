"""Triangle meshes, their boundary loops, and the smooth curves through them.

`TriangleMesh` holds a checked mesh, `find_boundary_loops` gives its holes as `BoundaryLoop` objects, `BoundaryCurve` is
the smooth curve through a loop, and `MeshExtension` is what a fill appends. numpy, scipy and libigl only.
"""
