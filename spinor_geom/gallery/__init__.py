"""Known answers: surfaces and closed curves in exact formulas, with exact areas and sources.

It stands above the solvers, so that no solver can look at an answer.
"""

from spinor_geom.gallery.chart import Chart as Chart
from spinor_geom.gallery.curves import ellipse as ellipse
from spinor_geom.gallery.curves import harmonics as harmonics
from spinor_geom.gallery.curves import helical_ramp as helical_ramp
from spinor_geom.gallery.curves import horseshoe as horseshoe
from spinor_geom.gallery.curves import l_shape as l_shape
from spinor_geom.gallery.curves import plane_polygon as plane_polygon
from spinor_geom.gallery.curves import polygon as polygon
from spinor_geom.gallery.curves import random_curve as random_curve
from spinor_geom.gallery.curves import scherk as scherk
from spinor_geom.gallery.curves import slit as slit
from spinor_geom.gallery.curves import tennis_seam as tennis_seam
from spinor_geom.gallery.curves import twisted_circle as twisted_circle
from spinor_geom.gallery.curves import zigzag_rim as zigzag_rim
from spinor_geom.gallery.known import KnownCurve as KnownCurve
from spinor_geom.gallery.known import KnownDisk as KnownDisk
from spinor_geom.gallery.known import KnownPatch as KnownPatch
from spinor_geom.gallery.known import KnownSurface as KnownSurface
from spinor_geom.gallery.known import evenly_sampled as evenly_sampled
from spinor_geom.gallery.known import noisy_loop as noisy_loop
from spinor_geom.gallery.known import unevenly_sampled as unevenly_sampled
from spinor_geom.gallery.names import SURFACES as SURFACES
from spinor_geom.gallery.names import named_surface as named_surface
from spinor_geom.gallery.schwarz import schwarz_d_hexagon as schwarz_d_hexagon
from spinor_geom.gallery.schwarz import schwarz_d_quadrilateral as schwarz_d_quadrilateral
from spinor_geom.gallery.schwarz import schwarz_h as schwarz_h
from spinor_geom.gallery.schwarz import schwarz_p_hexagon as schwarz_p_hexagon
from spinor_geom.gallery.schwarz import schwarz_p_quadrilateral as schwarz_p_quadrilateral
from spinor_geom.gallery.schwarz import schwarz_prism as schwarz_prism
from spinor_geom.gallery.surfaces import associate as associate
from spinor_geom.gallery.surfaces import catenoid as catenoid
from spinor_geom.gallery.surfaces import enneper as enneper
from spinor_geom.gallery.surfaces import helicoid as helicoid
from spinor_geom.gallery.surfaces import henneberg as henneberg
from spinor_geom.gallery.surfaces import plane_disk as plane_disk
from spinor_geom.gallery.surfaces import polynomial as polynomial
from spinor_geom.gallery.surfaces import random_polynomial as random_polynomial
