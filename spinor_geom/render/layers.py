"""What pages and pictures show: surfaces, lines and points, and from where they are looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from spinor_geom.render.colours import PLAIN_COLOUR, RIM_COLOUR

# share of the values that the ends of a colour scale leave out, so that one vertex does not make the rest one colour
_TAIL = 0.03
# name of the loop choice for what is shown for every loop
ALWAYS = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces:
    """A surface in a view.

    Attributes:
        vertices: positions.
        faces: triangles.
        colour: where no field is shown.
        inside: colour of the side that faces run clockwise on; that of the other side if none is given.
        fields: values at the vertices that it may be coloured by, by name; NaN is grey.
        edges: whether the triangles' edges are drawn, or the switch of the view's panel that says so.
        switch: the switch of the view's panel that shows it; without one it is always shown.
        loop: the loop of the view's panel for which it is shown; `ALWAYS` for each.
        conjugate: positions on the conjugate surface; with them a slider turns through the associate family, cos θ of
            the vertices and sin θ of these, both from the middle of the vertices.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    colour: str = PLAIN_COLOUR
    inside: str | None = None
    fields: Mapping[str, Float[np.ndarray, " n"]] = field(default_factory=dict)
    edges: bool | str = False
    switch: str | None = None
    loop: str = ALWAYS
    conjugate: Float[np.ndarray, "n 3"] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines:
    """Straight pieces of lines in a view; what is not explained here is as in `Faces`.

    Attributes:
        vertices: their ends.
        edges: pairs of ends.
        colour: of all.
        width: in pixels; in a picture 500 high.
        halo: colour of their edges, where they are to be seen on light and on dark.
        switch: see `Faces`.
        loop: see `Faces`.
        conjugate: see `Faces`.
    """

    vertices: Float[np.ndarray, "n 3"]
    edges: Int[np.ndarray, "e 2"]
    colour: str = RIM_COLOUR
    width: float = 1.5
    halo: str | None = None
    switch: str | None = None
    loop: str = ALWAYS
    conjugate: Float[np.ndarray, "n 3"] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Dots:
    """Points in a view; what is not explained here is as in `Faces`.

    Attributes:
        vertices: the points.
        colour: of all.
        size: their diameter in pixels.
        loop: see `Faces`.
    """

    vertices: Float[np.ndarray, "n 3"]
    colour: str = RIM_COLOUR
    size: float = 7.0
    loop: str = ALWAYS


@dataclass(frozen=True, kw_only=True)
class Scale:
    """What the ends of the colour scale stand for.

    Attributes:
        low: value of the violet end.
        high: value of the yellow end.
        unit: of the values.
    """

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
    """A parallel projection.

    Attributes:
        focus: (3,) the point in the middle of the picture, in mesh units.
        direction: (3,) unit vector from the focus to the eye.
        up: (3,) unit vector that points up in the picture.
        radius: half the height that is shown, in mesh units.
    """

    focus: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    radius: float


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A picture.

    Attributes:
        layers: what is in it.
        camera: from where it is looked at; in a window the reader says.
        title: above it.
        labels: texts at points.
    """

    layers: Sequence[Faces | Lines]
    camera: Camera | None = None
    title: str = ""
    labels: Sequence[tuple[Float[np.ndarray, "3"], str]] = ()
