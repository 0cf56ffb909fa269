"""Minimal surfaces as B-spline patches, the surfaces of CAD.

If p and q are polynomials on a disk, `polynomial_disk` makes exact patches. Other surfaces are interpolated: those over
a disk with a few corners by `corner_patches`. For others `blocks` divides Ω into quadrilaterals, in rings along ∂Ω and
by `quadrangulation` inside the rings, and `samples` evaluates positions on them, on smooth disks by `smooth_primitive`
and `quad_polynomials`. `spline_space` defines splines of one variable, and `strips` refines their knots until the
patches are within the tolerance. Plane surfaces are bounded by the splines of `trims`. `nurbs_surface` defines the
result with its measured deviations.
"""
