"""What pages and pictures show: surfaces, lines and points, and from where they are looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Int

# The colours that meshes, patches, rims and values have in every picture.
MESH: dict[str, Any] = {"colour": "#c9ced6", "inside": "#8d7f73"}
PATCH: dict[str, Any] = {"colour": "#f28e2b"}
SIDES: dict[str, Any] = {"colour": "#f6bd68", "inside": "#86b3dd"}  # of a surface by itself
RIM_COLOUR, GRID_COLOUR, PLAIN_COLOUR, UNKNOWN_COLOUR = "#1f3b73", "#5a4a3c", "#8fb3d9", "#bebebe"
VIRIDIS = (  # from low to high, perceptually uniform
    *("#440154", "#482475", "#414487", "#355f8d", "#2a788e", "#21918c"),
    *("#22a884", "#44bf70", "#7ad151", "#bddf26", "#fde725"),
)
_TAIL = 0.03  # of the values are beyond each end of a colour scale: one vertex does not make the rest one colour
ALWAYS = ""  # name of the loop choice for what is shown for every loop


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """Something in a view.

    With positions on the conjugate surface a slider turns through the associate family: cos θ of the vertices and sin θ
    of these, both from the middle of the vertices.
    """

    vertices: Float[np.ndarray, "n 3"]
    colour: str = RIM_COLOUR  # of all, where no field is shown
    switch: str | None = None  # of the view's panel, that shows it; without one it is always shown
    loop: str = ALWAYS  # of the view's panel, for which it is shown
    conjugate: Float[np.ndarray, "n 3"] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces(Layer):
    """A surface in a view."""

    faces: Int[np.ndarray, "f 3"]
    colour: str = PLAIN_COLOUR
    inside: str | None = None  # colour of the side that faces run clockwise on; without, as the other side
    fields: Mapping[str, Float[np.ndarray, " n"]] = field(default_factory=dict)  # at the vertices, by name; NaN is grey
    edges: bool | str = False  # whether the triangles' edges are drawn, or the switch of the view's panel that says so


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines(Layer):
    """Straight pieces of lines, of a width in pixels in a picture 500 high; a halo shows them on light and on dark."""

    edges: Int[np.ndarray, "e 2"]
    width: float = 1.5
    halo: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Dots(Layer):
    """Points in a view, of a diameter in pixels."""

    width: float = 7.0


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Values at the violet and the yellow end of the colour scale, and their unit."""

    low: float
    high: float
    unit: str = ""

    @classmethod
    def of(cls, values: Float[np.ndarray, " n"], unit: str = "") -> Scale:
        """The range of the values but for three in a hundred at each end; 0 to 1 where none is known."""
        known = values[np.isfinite(values)]
        low, high = np.quantile(known, [_TAIL, 1 - _TAIL]).tolist() if len(known) else (0.0, 1.0)
        return cls(low=low, high=high, unit=unit)


def colours_of(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Colours in sRGB, 0 to 1, of values on viridis over their `Scale`; grey where there is none."""
    known = (UNKNOWN_COLOUR, *VIRIDIS)
    grey, *stops = np.array([[int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)] for colour in known])
    scale, ends = Scale.of(values), np.linspace(0, 1, len(stops))
    share = np.nan_to_num((values - scale.low) / ((scale.high - scale.low) or 1.0))
    colours = np.stack([np.interp(share, ends, channel) for channel in np.transpose(stops)], axis=1)
    return np.where(np.isfinite(values)[:, None], colours, grey)


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A parallel projection; the unit direction is to the eye, the radius half the height that is shown."""

    focus: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    radius: float

    @property
    def frame(self) -> Float[np.ndarray, "3 3"]:
        """Unit vectors to the right, upwards and to the eye, as rows."""
        return np.stack([np.cross(self.up, self.direction), self.up, self.direction])


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A picture; without a camera it is looked at in a window. The labels are texts at points."""

    layers: Sequence[Layer]
    camera: Camera | None = None
    title: str = ""
    labels: Sequence[tuple[Float[np.ndarray, "3"], str]] = ()


def turned(layer: Layer, angle: float) -> Float[np.ndarray, "n 3"]:
    """The vertices of a layer after a turn of its family by an angle, in radians."""
    if layer.conjugate is None or angle == 0:
        return layer.vertices
    middle = layer.vertices.mean(axis=0)
    return np.asarray(middle + np.cos(angle) * (layer.vertices - middle) + np.sin(angle) * (layer.conjugate - middle))
