"""What pages and pictures show: surfaces, lines and points, and from where they are looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

# The colours that meshes, patches, rims and values have in every picture.
MESH_COLOUR, INSIDE_COLOUR, PATCH_COLOUR, RIM_COLOUR = "#c9ced6", "#8d7f73", "#f28e2b", "#1f3b73"
# of a surface by itself: its two sides, and the image of Ω's grid
FRONT_COLOUR, BACK_COLOUR, GRID_COLOUR = "#f6bd68", "#86b3dd", "#5a4a3c"
PLAIN_COLOUR, UNKNOWN_COLOUR = "#8fb3d9", "#bebebe"
# from low to high, perceptually uniform
VIRIDIS = (
    *("#440154", "#482475", "#414487", "#355f8d", "#2a788e", "#21918c"),
    *("#22a884", "#44bf70", "#7ad151", "#bddf26", "#fde725"),
)
# share of the values that the ends of a colour scale leave out, so that one vertex does not make the rest one colour
_TAIL = 0.03
# name of the loop choice for what is shown for every loop
ALWAYS = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """Something in a view.

    Attributes:
        vertices: positions.
        colour: of all, where no field is shown.
        switch: the switch of the view's panel that shows it; without one it is always shown.
        loop: the loop of the view's panel for which it is shown; `ALWAYS` for each.
        conjugate: positions on the conjugate surface; with them a slider turns through the associate family, cos θ of
            the vertices and sin θ of these, both from the middle of the vertices.
    """

    vertices: Float[np.ndarray, "n 3"]
    colour: str = RIM_COLOUR
    switch: str | None = None
    loop: str = ALWAYS
    conjugate: Float[np.ndarray, "n 3"] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces(Layer):
    """A surface in a view.

    Attributes:
        inside: colour of the side that faces run clockwise on; that of the other side if none is given.
        fields: values at the vertices that it may be coloured by, by name; NaN is grey.
        edges: whether the triangles' edges are drawn, or the switch of the view's panel that says so.
    """

    faces: Int[np.ndarray, "f 3"]
    colour: str = PLAIN_COLOUR
    inside: str | None = None
    fields: Mapping[str, Float[np.ndarray, " n"]] = field(default_factory=dict)
    edges: bool | str = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines(Layer):
    """Straight pieces of lines, of a width in pixels in a picture 500 high; a halo shows them on light and on dark."""

    edges: Int[np.ndarray, "e 2"]
    width: float = 1.5
    halo: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Dots(Layer):
    """Points in a view, of a diameter in pixels."""

    size: float = 7.0


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A parallel projection; the unit direction is to the eye, the radius half the height that is shown."""

    focus: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    radius: float


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
