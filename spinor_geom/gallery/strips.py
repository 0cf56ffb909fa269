"""Outlines of narrow strips: slits, horseshoes and helical ramps, which the round disk crowds or cannot hold at all."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.errors import OptionError
from spinor_geom.gallery.curves import polygon
from spinor_geom.gallery.known import KnownCurve, KnownDisk
from spinor_geom.mesh.curve import CurveFunction


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
        vertices = np.array([[0, 0, 0], [length, 0, 0], [length, width, 0], [0, width, 0]])
        area = KnownDisk(area=length * width, stable=True)
        return polygon(vertices, name=f"slit {length:g} × {width:.3g}", disks=(area,), source="a plane rectangle")
    return _outline(
        _Strip(radius=length / bend, half_width=width / 2, turn=bend, rise=0.0, tilt=math.pi / 2, twist=0.0),
        name=f"slit {length:g} × {width:.3g} bent by {math.degrees(bend):.0f}°",
        disks=(),
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
        _Strip(radius=radius, half_width=half_width, turn=turn, rise=0.0, tilt=0.0, twist=twist),
        name=f"horseshoe {math.degrees(turn):.0f}°, twisted by {math.degrees(twist):.0f}°",
        disks=(),
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
    return _outline(
        _Strip(radius=radius, half_width=half_width, turn=turn, rise=pitch * turns, tilt=0.0, twist=0.0),
        name=f"helical ramp of {turns:g} turns",
        disks=(KnownDisk(area=area, stable=True, relative_error=1e-14),),
        source="Meusnier (1776), the helicoid",
    )


class _Strip(NamedTuple):
    """A ruled strip around the z axis: x + iy = (R + v cos ψ)e^{iθ}, z = v sin ψ + rise·u, −h ≤ v ≤ h, 0 ≤ u ≤ 1.

    θ = turn·u is the place along it, ψ = tilt + twist·u its slope.
    """

    radius: float
    half_width: float
    turn: float
    rise: float
    tilt: float
    twist: float

    def line(self, u: Float[np.ndarray, "*pts"], v: float, order: int) -> Float[np.ndarray, "*pts 3"]:
        """The derivative of a given order (0, 1, 2) by u of the line v = constant."""
        slope = np.exp(1j * (self.tilt + self.twist * u))
        around = np.exp(1j * self.turn * u)
        # v e^{iψ} has the real part v cos ψ and the imaginary part v sin ψ, and so have its derivatives
        arm = [v * (1j * self.twist) ** k * slope for k in range(order + 1)]
        outward = [a.real + (self.radius if k == 0 else 0.0) for k, a in enumerate(arm)]
        plane = sum(
            math.comb(order, k) * outward[k] * (1j * self.turn) ** (order - k) * around for k in range(order + 1)
        )
        height = arm[order].imag + (self.rise * u if order == 0 else self.rise if order == 1 else 0.0)
        return np.stack([np.real(plane), np.imag(plane), height], axis=-1)


def _outline(strip: _Strip, *, name: str, disks: tuple[KnownDisk, ...], source: str) -> KnownCurve:
    """The closed curve v = h, u = 1, v = −h, u = 0, each side with its share of the length as its share of [0, 1)."""
    h = strip.half_width
    middle = (np.arange(512) + 0.5) / 512
    along = [float(np.linalg.norm(strip.line(middle, v, 1), axis=-1).mean()) for v in (h, -h)]
    length = np.array([along[0], 2 * h, along[1], 2 * h])
    share = length / length.sum()
    start = np.append(0.0, np.cumsum(share)[:-1])
    ends = [strip.line(np.array(u), v, 0) for u, v in ((1.0, h), (1.0, -h), (0.0, -h), (0.0, h))]
    across = (ends[1] - ends[0], ends[3] - ends[2])

    def order(n: int) -> CurveFunction:
        def value(t: Float[np.ndarray, "*pts"]) -> Float[np.ndarray, "*pts 3"]:
            turned = np.mod(t, 1.0)
            side: Int[np.ndarray, "*pts"] = np.asarray(np.searchsorted(start, turned, side="right") - 1)
            u = (turned - start[side]) / share[side]
            straight = [
                (first + u[..., None] * ray, np.broadcast_to(ray, (*u.shape, 3)), np.zeros((*u.shape, 3)))[n]
                for first, ray in zip((ends[0], ends[2]), across, strict=True)
            ]
            # the second long side is run backwards, which changes the sign of its first derivative
            sides = (strip.line(u, h, n), straight[0], (-1) ** n * strip.line(1 - u, -h, n), straight[1])
            return np.asarray(np.choose(side[..., None], sides) / share[side][..., None] ** n)

        return value

    return KnownCurve(
        name=name,
        point=order(0),
        derivative=order(1),
        second_derivative=order(2),
        corners=tuple(start.tolist()),
        disks=disks,
        source=source,
    )
