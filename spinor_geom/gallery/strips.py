"""Outlines of narrow strips: slits, horseshoes and helical ramps, which the round disk crowds or cannot hold at all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from spinor_geom.errors import OptionError
from spinor_geom.gallery.curves import image_of_polygon, plane_polygon
from spinor_geom.gallery.known import KnownCurve, KnownDisk


def slit(length: float = 50.0, width: float = math.sqrt(0.75), *, bend: float = 0.0) -> KnownCurve:
    """A slit as a row of triangles leaves it when it is taken out of a mesh: a rectangle, plane or rolled.

    Args:
        length: of the longer sides; 50 with edges of 1 is 50 triangles long.
        width: of the shorter sides; by default the height of an equilateral triangle with edge 1.
        bend: angle through which the longer sides are rolled on a cylinder, in radians; 0 leaves the slit plane.

    Raises:
        OptionError: length or width is not positive, or the bend is negative or a whole turn.
    """
    if not (length > 0 and width > 0 and 0 <= bend < 2 * math.pi):
        raise OptionError(f"a slit needs length and width > 0 and a bend in [0, 2π), got {length}, {width}, {bend}")
    if bend == 0:
        corners = [(0, 0), (length, 0), (length, width), (0, width)]
        return plane_polygon(corners, name=f"slit {length:g} × {width:.3g}")
    return _outline(
        radius=length / bend,
        half_width=width / 2,
        turn=bend,
        tilt=math.pi / 2,
        name=f"slit {length:g} × {width:.3g} bent by {math.degrees(bend):.0f}°",
        source="a rectangle rolled on a cylinder",
    )


def horseshoe(
    radius: float = 1.0, half_width: float = 0.25, *, turn: float = 1.5 * math.pi, twist: float = math.pi / 2
) -> KnownCurve:
    """The outline of a strip that runs along an arc of a circle and turns about that arc.

    It starts in the circle's plane; at the end it stands at the angle `twist` to it.

    Args:
        radius: of the arc, the strip's middle line.
        half_width: half the strip's width.
        turn: angle of the arc, in radians.
        twist: angle through which the strip turns about its middle line, in radians.

    Raises:
        OptionError: half the width is not between 0 and the radius, or the turn is not between 0 and 2π.
    """
    if not (0 < half_width < radius and 0 < turn < 2 * math.pi):
        raise OptionError(
            f"a horseshoe needs 0 < half_width < radius and a turn in (0, 2π), got {half_width}, {radius}, {turn}"
        )
    return _outline(
        radius=radius,
        half_width=half_width,
        turn=turn,
        twist=twist,
        name=f"horseshoe {math.degrees(turn):.0f}°, twisted by {math.degrees(twist):.0f}°",
        source="a ruled strip along an arc of a circle",
    )


def helical_ramp(
    turns: float = 2.0, *, radius: float = 3.0, half_width: float = 0.35, pitch: float = 2.0
) -> KnownCurve:
    """The outline of a ramp that winds around an axis: two helices and two straight ends.

    The helicoid between them is its minimal disk, stable however long it is because its normal is nowhere horizontal:
    the vertical shift is a positive Jacobi field. Its area is the turn times ½(ρ√(ρ² + c²) + c² asinh(ρ/c)) between
    ρ = R − h and ρ = R + h, with c the rise in a radian. Over more than one turn it has no simple plane flattening of
    the same lengths.

    Args:
        turns: about the axis.
        radius: R, the middle line's distance from the axis.
        half_width: h, half the ramp's width.
        pitch: rise in one turn.

    Raises:
        OptionError: turns or pitch is not positive, or half the width is not between 0 and the radius.
    """
    if not (turns > 0 and pitch > 0 and 0 < half_width < radius):
        raise OptionError(
            "a helical ramp needs turns and pitch > 0 and 0 < half_width < radius, "
            f"got {turns}, {pitch}, {half_width}, {radius}"
        )
    c = pitch / (2 * math.pi)

    def inside(rho: float) -> float:
        return (rho * math.hypot(rho, c) + c**2 * math.asinh(rho / c)) / 2

    turn = 2 * math.pi * turns
    area = turn * (inside(radius + half_width) - inside(radius - half_width))
    outline = _outline(
        radius=radius,
        half_width=half_width,
        turn=turn,
        rise=pitch * turns,
        name=f"helical ramp of {turns:g} turns",
        source="Meusnier (1776), the helicoid",
    )
    return replace(outline, disks=(KnownDisk(area=area, stable=True, relative_error=1e-14),))


def _outline(
    *,
    radius: float,
    half_width: float,
    turn: float,
    rise: float = 0.0,
    tilt: float = 0.0,
    twist: float = 0.0,
    name: str,
    source: str,
) -> KnownCurve:
    """The outline of the strip x + iy = (R + v cos ψ)e^{iθ}, z = v sin ψ + rise·u, −h ≤ v ≤ h, 0 ≤ u ≤ 1.

    θ = turn·u is the place along it, ψ = tilt + twist·u its slope.
    """

    def strip(uv: Float[Tensor, "*pts 2"]) -> Float[Tensor, "*pts 3"]:
        u, v = uv.unbind(-1)
        slope, outward = tilt + twist * u, radius + v * (tilt + twist * u).cos()
        return torch.stack([outward * (turn * u).cos(), outward * (turn * u).sin(), v * slope.sin() + rise * u], dim=-1)

    h = half_width
    corners = np.array([(0, h), (1, h), (1, -h), (0, -h)])
    return image_of_polygon(corners, strip, name=name, source=source)
