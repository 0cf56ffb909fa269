"""Scenes for pictures, pages and notebooks: layers of triangles, lines and points, and their colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Float, Int, UInt8

from spinor_geom.mesh.array_checks import with_finite_rows
from spinor_geom.render.camera import Camera, upright

Label: TypeAlias = tuple[Float[np.ndarray, "3"], str]  # a text at a point
# Colours of meshes, patches, rims and values.
MESH: dict[str, Any] = {"colour": "#c9ced6", "inside": "#8d7f73"}
PATCH: dict[str, Any] = {"colour": "#f28e2b"}
SIDES: dict[str, Any] = {"colour": "#f6bd68", "inside": "#86b3dd"}  # both sides of a surface without a mesh around it
RIM_COLOUR, GRID_COLOUR, PLAIN_COLOUR, UNKNOWN_COLOUR = "#1f3b73", "#5a4a3c", "#8fb3d9", "#bebebe"
VIRIDIS = (  # from low to high, perceptually uniform
    *("#440154", "#482475", "#414487", "#355f8d", "#2a788e", "#21918c"),
    *("#22a884", "#44bf70", "#7ad151", "#bddf26", "#fde725"),
)
EYE = (1.0, -2.0, 1.3)  # direction from a surface to the eye: in front and above
_ALONG = 0.999  # a view counts as along the third axis if the cosine of the angle between them is at least this
_TURNS = np.linspace(0, 2 * np.pi, 24, endpoint=False).tolist()
_TAIL = 0.03  # quantile at each end of a colour scale, against outliers


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """Part of a scene.

    `conjugate` holds the vertices on the conjugate surface, with the same mean as `vertices`. A page with such a layer
    has a slider for the angle θ of the associate family.
    """

    vertices: Float[np.ndarray, "n 3"]
    colour: str = RIM_COLOUR
    switch: str | None = None  # check box of the page's panel that shows the layer, or None if it is always shown
    conjugate: Float[np.ndarray, "n 3"] | None = None
    loop: str | None = None  # the loop that is selected by a click on the layer

    def turned(self, angle: float) -> Float[np.ndarray, "n 3"]:
        """The vertices of the member of the associate family at an angle in radians."""
        if self.conjugate is None or angle == 0:
            return self.vertices
        middle = self.vertices.mean(axis=0)
        return np.asarray(middle + np.cos(angle) * (self.vertices - middle) + np.sin(angle) * (self.conjugate - middle))


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces(Layer):
    """Triangles. A field, values at the vertices, replaces the colour while it is shown. NaN is grey."""

    faces: Int[np.ndarray, "f 3"]
    colour: str = PLAIN_COLOUR
    inside: str | None = None  # colour of the back side, None for the same colour
    fields: Mapping[str, Float[np.ndarray, " n"]] = field(default_factory=dict)  # by name, with the unit
    # own colours, shown instead of `colour`: (n, 3) sRGB of the vertices, 0 to 1, or coordinates in `image` (3f, 2) of
    # all corners, with the origin at the lower left
    skin: Float[np.ndarray, "_ _"] | None = None
    image: UInt8[np.ndarray, "h w 3"] | None = None
    edges: bool | str = False  # whether edges are drawn, or the check box of the page's panel that shows them

    def __post_init__(self) -> None:
        """Vertices that are NaN are in no face. Without them the scene has a size."""
        self.__dict__.update(vertices=with_finite_rows(self.vertices, self.faces))


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines(Layer):
    """Line segments, of a width in pixels in a picture 500 pixels high. Pages draw the halo around them."""

    edges: Int[np.ndarray, "e 2"]
    width: float = 1.5
    halo: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Dots(Layer):
    """Points, of a diameter in pixels as `Lines.width`."""

    width: float = 7.0


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Values at the two ends of the colour scale. Where it is cut, smaller and larger values have the ends' colours."""

    low: float
    high: float
    is_cut_below: bool = False
    is_cut_above: bool = False

    @classmethod
    def of(cls, values: Float[np.ndarray, " n"]) -> Scale:
        """The 3 % and the 97 % quantile of the finite values, or 0 and 1 if there are none."""
        known = values[np.isfinite(values)]
        low, high = np.quantile(known, [_TAIL, 1 - _TAIL]).tolist() if len(known) else (0.0, 1.0)
        is_cut = len(known) > 0
        return cls(
            low=low,
            high=high,
            is_cut_below=is_cut and bool(known.min() < low),
            is_cut_above=is_cut and bool(known.max() > high),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Layers shown together: in a picture by `write_png`, in a page by `Views`.

    A picture shows the first field of each layer. `loop_cameras` and the attributes after it are for pages.
    """

    layers: Sequence[Layer]
    title: str = ""
    camera: Camera | None = None  # None: see `overview`
    labels: Sequence[Label] = ()
    scales: Mapping[str, Scale] = field(default_factory=dict)  # by field. The default is `Scale.of` the values
    loop_cameras: Mapping[str, Camera] = field(default_factory=dict)  # by the loop selected in the page's panel
    panel: bool = False  # whether the view follows the page's panel, else it shows the first field
    unit: str | None = None  # unit of lengths for a ruler, None for no ruler
    flat: bool = False  # a plane figure: dragging moves it and does not rotate it
    shape: Literal["wide", "square"] = "wide"  # class in page.css

    @property
    def colour_scales(self) -> dict[str, Scale]:
        """The colour scale of each field, the same for all layers, none for a field without finite values."""
        fields = [layer.fields for layer in self.layers if isinstance(layer, Faces)]
        values = {
            name: np.concatenate([own[name] for own in fields if name in own])
            for name in dict.fromkeys(name for own in fields for name in own)
        }
        known = {name: Scale.of(own) for name, own in values.items() if np.isfinite(own).any()}
        return {**known, **self.scales}


def overview(layers: Sequence[Layer], *, eye: Sequence[float] = EYE, aspect: float = 1.0) -> Camera:
    """A camera that shows all layers and members of their families. `aspect` is the picture's width per height.

    The third axis is upwards, or the second one if the direction to the eye is along the third.
    """
    direction = np.asarray(eye, dtype=np.float64) / np.linalg.norm(eye)
    axis = np.eye(3)[2 if abs(direction[2]) < _ALONG else 1]
    points = np.concatenate(
        [layer.turned(angle) for layer in layers for angle in ((0.0,) if layer.conjugate is None else _TURNS)]
    )
    return Camera.around(points, direction, upright(direction, axis), aspect=aspect)


def viridis(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Colours in sRGB, 0 to 1, of values on their `Scale`, grey for NaN."""
    grey, *stops = np.array([[int(c[k : k + 2], 16) / 255 for k in (1, 3, 5)] for c in (UNKNOWN_COLOUR, *VIRIDIS)])
    scale, ends = Scale.of(values), np.linspace(0, 1, len(stops))
    share = np.nan_to_num((values - scale.low) / ((scale.high - scale.low) or 1.0))
    colours = np.stack([np.interp(share, ends, channel) for channel in np.transpose(stops)], axis=1)
    return np.where(np.isfinite(values)[:, None], colours, grey)
