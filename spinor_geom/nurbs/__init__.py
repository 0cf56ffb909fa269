"""Minimal surfaces as B-spline patches, the surfaces of CAD.

Where p and q are polynomials on a disk, `polynomial_disk` makes exact patches. Other surfaces are interpolated:
`blocks` divides Ω into quadrilaterals, in rings along ∂Ω and by `quadrangulation` inside them. `samples` evaluates
positions on them, on smooth disks by `smooth_primitive` and `quad_polynomials`. `spline_space` has splines of one
variable. `strips` refines their knots until the patches are within the tolerance. `nurbs_surface` has the result with
its measured deviations.
"""
