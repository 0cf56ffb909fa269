"""The exceptions of the package; each message says what is wrong, where, and what to do."""

import importlib.util
import math
import sys
from functools import partial
from numbers import Integral, Real
from typing import Any


class SpinorGeomError(Exception):
    """Base of all errors that the package raises on purpose; indices and figures are attributes.

    Types with one message have it as their `sentence`, which is their docstring, too; braces hold names of attributes.
    """

    sentence = ""

    def __init_subclass__(cls) -> None:
        cls.__doc__ = cls.__doc__ or cls.sentence

    def __init__(self, message: str | None = None, **fields: Any) -> None:
        self.fields = {name: _tuples(value) for name, value in fields.items()}
        super().__init__(self.sentence.format(**self.fields) if message is None else message)
        self.__dict__.update(self.fields)

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(type(self), str(self), **self.fields), (), self.__dict__


def _tuples(value: Any) -> Any:
    """Lists, nested too, as tuples."""
    return tuple(map(_tuples, value)) if isinstance(value, (list, tuple)) else value


class MeshError(SpinorGeomError, ValueError):
    """The input mesh cannot be used as it is."""


class MeshShapeError(MeshError):
    """An array has the wrong shape or dtype."""


class VertexIndexError(MeshError):
    sentence = "face {face} names vertex {index}, but the mesh has {vertices}, numbered from 0; correct its indices"


class PolygonError(VertexIndexError):
    sentence = "face {face} {problem}; correct or remove it"


class NonFiniteVertexError(MeshError):
    """A coordinate is NaN or infinite."""

    def __init__(self, message: str | None = None, *, vertex: int, place: str = "") -> None:
        where = f"{place}: " if place else ""
        said = f"{where}vertex {vertex} has a NaN or infinite part; correct it"
        super().__init__(message or said, vertex=vertex, place=place)


class NoFacesError(MeshError):
    sentence = "the mesh has {vertices} vertices and no faces: no holes; make faces, or span a curve with solve_plateau"


class MeshExtentError(MeshError):
    sentence = "the mesh has an extent of {extent:.1e}, and powers of such lengths are no numbers; scale the mesh"


class NonManifoldEdgeError(MeshError):
    sentence = "edge {edge} has the faces {faces}, at most 2 are allowed beside a loop; remove or split the others"


class DuplicateVertexError(MeshError):
    sentence = (
        "{count} boundary edges lie on one another, first at vertices {vertices}: the faces do not share their "
        "vertices; merge vertices of equal position first (read_mesh(path).merged(), TriangleMesh.merged(), --merge)"
    )


def advised_distance(distance: float) -> float:
    """The merging distance that an error advises for vertices so far apart: two digits, rounded up."""
    return float(f"{1.1 * distance:.1e}")


def merge_advice(distance: float) -> str:
    """How to merge vertices that are so far apart, in mesh units."""
    within = f"{advised_distance(distance):.1e}" if distance else ""
    return f"fill_hole(mesh, merge={within or True}), or --merge{' ' * bool(within)}{within} on the command line"


def how_far_apart(distance: float) -> str:
    """The distance of the two sides of a slit or a seam, in words."""
    return f"at most {distance:.2g} apart" if distance else "at the same positions"


class LoopError(SpinorGeomError, ValueError):
    """A boundary loop cannot be used."""


class LoopTooShortError(LoopError):
    sentence = "a loop needs at least 3 points, got {points}; give a closed curve"


class RepeatedPointError(LoopError):
    sentence = "points {index} and its successor on the loop are equal; remove one of them"


class CurveError(LoopError):
    sentence = "the curve {reason} (near s = {parameter:.6g}); give a closed one on [0, 1), its derivatives and corners"


class ZeroWidthSlitError(LoopError):
    sentence = (
        "{fraction:.0%} of the loop is a zero-width slit (its two sides are {apart}, first at vertices {vertices}); "
        "merge the vertices of equal position instead of filling it ({advice})"
    )


class SeamError(LoopError):
    sentence = (
        "{count} edges of the loop and of another loop are {apart}, first {edge}: a seam between pieces that do not "
        "share their vertices, not only a hole; merge the vertices ({advice}), or fill it with loop= (--loop)"
    )


class TJunctionError(LoopError):
    sentence = (
        "the loop is a seam with T-junctions, not only a hole: {count} boundary vertices lie on boundary edges, first "
        "vertex {vertex} on edge {edge}, {apart}; divide those edges there, or fill it with loop= (--loop)"
    )


class SheetBorderError(LoopError):
    sentence = "it is the border of a sheet rather than a hole: {evidence}; name it in loop= (--loop) to fill it"


class LoopIndexError(LoopError):
    sentence = "loop {index} does not exist, the mesh has {loops} (numbered from 0, longest first)"


class ForeignLoopError(LoopError):
    sentence = "the loop of {vertices} vertices is not a boundary loop of this mesh; take one from boundary_loops(mesh)"


class ForeignRimError(LoopError):
    sentence = "the mesh to compare with is not over the same rim: it has {boundary}; give the patch alone"


class SelfCrossingLoopError(LoopError):
    sentence = (
        "the loop crosses or touches itself: its edges {edges[0]} and {edges[1]} meet ({count} such pairs in all); "
        "move them apart, or give them a common vertex, which splits the loop"
    )


class OpenCurveError(LoopError):
    sentence = "the curve is open: its ends are {gap:.6g} apart (mean edge {mean_edge:.3g}); close it, or raise closing"


class KnottedLoopError(LoopError):
    sentence = "the loop is knotted (determinant {determinant:.0f}), so every disk over it crosses itself; cut it up"


class TooManyRimsError(LoopError):
    sentence = "discrete minimal surfaces span one loop or join two, got loops of {sizes} vertices; give one or two"


class SeveralRimsError(LoopError):
    sentence = "the surface has {rims} rims; take its loops and curves from `rims`"


class LoopsMeetError(LoopError):
    sentence = "edge {edges[0]} of one loop and edge {edges[1]} of the other meet; move them apart, or merge vertices"


class TwistedRimsError(LoopError):
    sentence = "the rims of loops {loops} have opposite orientations for a bridge; turn the faces of one piece over"


class NoAreaError(LoopError):
    sentence = "the loop encloses no area (mean width {width:.1e}, mean edge {mean_edge:.3g}); merge or remove vertices"


class LoneFaceError(LoopError):
    sentence = "the loop is the outline of face {face} {vertices}, which has no neighbours; remove the face"


class DomainError(SpinorGeomError, ValueError):
    """The loop has no simple plane domain, or a plane polygon crosses itself."""


class FirstFillError(SpinorGeomError):
    """No discrete disk over the loop was found."""


class OutOfTimeError(SpinorGeomError):
    sentence = "no surface was found within the time that was allowed; raise time_limit (--time-limit)"


class SurfaceError(SpinorGeomError):
    """A surface has no finite value where one is needed."""


class PeriodError(SurfaceError):
    sentence = (
        "the associate surface of angle {angle:.6g} does not close around {around}: it moves by ({period[0]:.3g}, "
        "{period[1]:.3g}, {period[2]:.3g}) there; take a multiple of π, or a part that does not go around"
    )


class SingularMatrixError(SpinorGeomError, ValueError):
    sentence = "a Laplacian of {size} inner vertices is singular, as faces have no area; check the loop for crossings"


class UnsolvableError(SingularMatrixError):
    sentence = (
        "equations for a surface over the loop cannot be solved ({reason}); check the loop for points that nearly "
        "coincide, and for parts of it that nearly touch"
    )


class DtypeError(SpinorGeomError, TypeError):
    """A tensor has the wrong dtype."""


class OptionError(SpinorGeomError, ValueError):
    """An option has a value that is not allowed."""


class ArgumentTypeError(OptionError, TypeError):
    sentence = "{function} takes {takes}, not {found}"


class TooManyPointsError(OptionError):
    sentence = (
        "patches with edges of {target:.6g} would need about {points:.1e} vertices for an area of {area:.6g}, more "
        "than {most:.0e}; give a longer target_edge_length (--edge-length), in mesh units"
    )


class StorageError(SpinorGeomError):
    """A saved surface cannot be read."""


class ZeroOnContourError(SpinorGeomError):
    sentence = "the function has a zero on the boundary, or too near, by z = {z:.6g}; take a slightly different domain"


class UnplacedZerosError(SpinorGeomError):
    sentence = "the function has {count} zeros in the domain, but not all were found; take a smaller domain"


class ImperfectFillWarning(UserWarning):
    """A hole stays open, or its patch is discrete, misses the tolerance, or intersects something."""


class UnknownMeshTypeError(SpinorGeomError, TypeError):
    sentence = "{found} is not a mesh type known here; {advice}"


class MeshFileError(SpinorGeomError, ValueError):
    """A mesh file is missing, malformed, or of an unknown format."""


class ArchiveError(SpinorGeomError, ValueError):
    """An archive is damaged, or unsafe to unpack."""


class BatchError(SpinorGeomError):
    """A batch cannot start or continue."""


class MissingPackageError(SpinorGeomError, ImportError):
    sentence = "{package} is not installed; install it, in a clone, with: pip install '.[{extra}]'"


class RenderError(SpinorGeomError, RuntimeError):
    """A picture cannot be drawn."""


def require(package: str, *, extra: str) -> None:
    """Raise a MissingPackageError unless a package is installed; it is not imported."""
    if importlib.util.find_spec(package) is None:
        raise MissingPackageError(package=package, extra=extra)


def require_type(value: Any, types: type | tuple[type, ...], *, function: str, takes: str) -> None:
    """Raise an ArgumentTypeError unless a value has one of some types; `takes` describes them."""
    if not isinstance(value, types):
        raise ArgumentTypeError(function=function, takes=takes, found=type(value).__name__)


def require_count(least: int = 1, **values: Any) -> None:
    """Raises an OptionError that names the first value that is not a whole number from `least` on."""
    for name, value in values.items():
        if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
            raise OptionError(f"{name} must be a whole number of at least {least}, not {value!r}")


def require_positive(name: str, value: Any, *, finite: bool = True, instead: str = "") -> None:
    """Raise an OptionError unless a value is a positive number; `instead` names other allowed values."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not 0 < value <= (sys.float_info.max if finite else math.inf):
        raise OptionError(f"{name} must be {instead}a positive number, not {value!r}")
