"""Minimal surfaces as B-spline patches, the surfaces of CAD.

`polynomial_disk` has exact patches of polynomials; other surfaces are interpolated. `blocks` divides Ω into
quadrilaterals, inside the rings by `quadrangulation`; `samples` has positions on them, for smooth disks by
`smooth_primitive` and `quad_polynomials`; `spline_space` has the splines of one side; `strips` refines their knots
until the patches are within the tolerance; `nurbs_surface` is the result with its measured deviations.
"""
