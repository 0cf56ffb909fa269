"""Minimal surfaces as B-spline patches, the surfaces of CAD.

`blocks` divides Ω into quadrilaterals; `spline_space` has the splines of one side; `strips` refines their knots until
the patches are within the tolerance; `nurbs_surface` is the result with its measured deviations.
"""
