"""The exceptions of the package. Each message says what is wrong, where, and what to do."""

import importlib.util
import math
import sys
from functools import partial
from numbers import Integral, Real
from typing import Any


class SpinorGeomError(Exception):
    """Base of all errors that the package raises on purpose. Indices and numbers are attributes.

    If a type has a single message, `sentence` is its format string, with the attributes, and its docstring.
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
    sentence = "face {face} has vertex index {index}, but the mesh has {vertices} vertices, numbered from 0; correct it"


class PolygonError(VertexIndexError):
    sentence = "face {face} {problem}; correct or remove it"


class NonFiniteVertexError(MeshError):
    """A coordinate is NaN or infinite."""

    def __init__(self, message: str | None = None, *, vertex: int, face: int | None = None, place: str = "") -> None:
        where = f"{place}: " if place else ""
        use = "" if face is None else f" and is used by face {face}"
        default = f"{where}vertex {vertex} has a NaN or infinite coordinate{use}; correct it"
        super().__init__(message or default, vertex=vertex, face=face, place=place)


class NoFacesError(MeshError):
    sentence = "the mesh has {vertices} vertices but no faces; add faces, or pass a curve to solve_plateau"


class MeshExtentError(MeshError):
    sentence = "the mesh has an extent of {extent:.1e}, whose powers overflow or underflow; scale the mesh"


class NonManifoldEdgeError(MeshError):
    sentence = (
        "edge {edge} has {count} faces, such as {faces}, at most 2 are allowed at a loop; remove or split the others"
    )


class DuplicateVertexError(MeshError):
    sentence = (
        "{count} boundary edges coincide, first at vertices {vertices}: adjacent faces do not share their "
        "vertices; merge vertices of equal position first (read_mesh(path).merged(), TriangleMesh.merged(), --merge)"
    )


def advised_distance(distance: float) -> float:
    """The merging distance that errors suggest for vertices at this distance: 10 % larger, to two digits."""
    return float(f"{1.1 * distance:.1e}")


def merge_advice(distance: float) -> str:
    """Advice on merging vertices at this distance, in mesh units."""
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
    sentence = "point {index} of the loop is equal to the next one; remove one of them"


class CurveError(LoopError):
    sentence = (
        "the curve {reason} (near s = {parameter:.6g}); give a closed curve on [0, 1), its derivatives and corners"
    )


class ZeroWidthSlitError(LoopError):
    sentence = (
        "{fraction:.0%} of the loop is a zero-width slit (its two sides are {apart}, first at vertices {vertices}); "
        "merge the vertices of equal position instead of filling it ({advice})"
    )


class SeamError(LoopError):
    sentence = (
        "{count} edges of the loop and of another loop are {apart}, first {edge}: a seam between pieces that do not "
        "share their vertices; merge the vertices ({advice}), or fill the loop by its index in loop= (--loop)"
    )


class TJunctionError(LoopError):
    sentence = (
        "the loop is a seam with T-junctions: {count} boundary vertices lie on boundary edges, first vertex {vertex} "
        "on edge {edge}, {apart}; split those edges there, or fill the loop by its index in loop= (--loop)"
    )


class SheetBorderError(LoopError):
    sentence = "it is the border of a sheet rather than a hole: {evidence}; give its index in loop= (--loop) to fill it"


class LoopIndexError(LoopError):
    sentence = "loop {index} does not exist, there are {loops} (numbered from 0, longest first)"


class ForeignLoopError(LoopError):
    sentence = "the loop of {vertices} vertices is not a boundary loop of this mesh; take one from boundary_loops(mesh)"


class ForeignRimError(LoopError):
    sentence = (
        "the mesh to compare with has another boundary than the surface: {boundary}; give the patch, or the filled "
        "mesh with the same rim"
    )


class SelfCrossingLoopError(LoopError):
    sentence = (
        "the loop crosses or touches itself: its edges {edges[0]} and {edges[1]} meet ({found} such pairs were found); "
        "move them apart, or give them a common vertex, which splits the loop"
    )


class SelfCrossingCurveError(SelfCrossingLoopError):
    sentence = "the curve crosses or touches itself near {point}; move its parts apart"


class OpenCurveError(LoopError):
    sentence = "the curve is open: its ends are {gap:.6g} apart (mean edge {mean_edge:.3g}); close it, or raise closing"


class OpenWireError(LoopError):
    sentence = (
        "the edges are open: their ends {ends[0]} and {ends[1]} are {gap:.3g} apart, and ends meet within "
        "{closing:.1e}; close the wire"
    )


class BranchingEdgesError(LoopError):
    sentence = "{count} ends of edges meet at {point}, but two do in a closed wire; give only edges of the boundary"


class NoEdgesError(LoopError):
    sentence = "there is no boundary curve ({what}); give edges or wires, or faces with a hole"


class TooManyRimsError(LoopError):
    sentence = "a discrete minimal surface needs one or two loops, got loops of {sizes} vertices; use solve_plateau"


class SeveralRimsError(LoopError):
    sentence = "the surface has {rims} rims; take its loops and curves from `rims`"


class LoopsMeetError(LoopError):
    sentence = "edge {edges[0]} of one loop and edge {edges[1]} of the other meet; move them apart, or merge vertices"


class TwistedRimsError(LoopError):
    sentence = "the loops {loops} have the wrong orientations for a bridge; flip the faces of one piece"


class NoAreaError(LoopError):
    sentence = "the loop encloses no area (mean width {width:.1e}, mean edge {mean_edge:.3g}); merge or remove vertices"


class LoneFaceError(LoopError):
    sentence = "the loop is the outline of face {face} {vertices}, which has no neighbours; {advice}"


class DomainError(SpinorGeomError, ValueError):
    """The loop has no simple plane domain, or a plane polygon crosses itself."""


class FirstFillError(SpinorGeomError):
    """No discrete disk over the loop was found."""


class OutOfTimeError(SpinorGeomError):
    sentence = "no surface was found within the time limit; raise time_limit (--time-limit)"


class SurfaceError(SpinorGeomError):
    """No surface was found, or it is not finite."""


class UnresolvedRimsError(SurfaceError):
    sentence = (
        "the search for a surface between the {rims} rims {failure}, so that one may exist; round the corners of the "
        "rims more, or divide narrow gaps by edges between the rims"
    )


class NotContinuedError(SurfaceError):
    """A mesh is not continued smoothly. The message is the reason."""


class PeriodError(SurfaceError):
    sentence = (
        "the associate surface of angle {angle:.6g} does not close around {around}: its period is ({period[0]:.3g}, "
        "{period[1]:.3g}, {period[2]:.3g}); use a multiple of π, or a part that does not surround it"
    )


class NotDifferentiableError(SurfaceError):
    """An area or positions are not differentiable in the points of the curve."""


class SingularMatrixError(SpinorGeomError, ValueError):
    sentence = "the Laplacian of {size} interior vertices is singular (degenerate faces); check the loop for crossings"


class UnsolvableError(SingularMatrixError):
    sentence = (
        "the equations for a surface over the loop cannot be solved ({reason}); check the loop for points that nearly "
        "coincide and parts that nearly touch"
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


def in_mesh_units(error: SpinorGeomError, unit: float) -> SpinorGeomError:
    """An error of a computation whose unit of length is `unit`, in mesh units, with its lengths and areas converted."""
    if not isinstance(error, (NoAreaError, TooManyPointsError)):
        return error
    powers = {"width": 1, "mean_edge": 1, "target": 1, "area": 2}
    fields = {name: value * unit ** powers.get(name, 0) for name, value in error.fields.items()}
    return type(error)(**fields)


class StorageError(SpinorGeomError):
    """A saved surface cannot be read."""


class ZeroOnContourError(SpinorGeomError):
    sentence = "the function has a zero on or too near the boundary, at about z = {z:.6g}; change the domain slightly"


class UnplacedZerosError(SpinorGeomError):
    sentence = "the function has {count} zeros in the domain, but not all were found; use a smaller domain"


class ImperfectFillWarning(UserWarning):
    """A hole is still open, or its patch is discrete, exceeds the tolerance, or has intersections."""


class HiddenTextureWarning(UserWarning):
    """A mesh has a texture that pictures and pages do not show."""


class UncertainGradientWarning(UserWarning):
    """Derivatives of a surface are approximate, or may not exist."""


class UnknownMeshTypeError(SpinorGeomError, TypeError):
    sentence = "{found} is not a supported mesh type; {advice}"


class MeshFileError(SpinorGeomError, ValueError):
    """A mesh file is missing, malformed, or of an unknown format."""


class PrecisionError(MeshFileError):
    sentence = (
        "the 32-bit numbers of {suffix} files do not hold this mesh: different vertices would become equal, or edges "
        "would change by over 0.1 %; write .obj or .off, or move the mesh to the origin"
    )


class CadFileError(SpinorGeomError, ValueError):
    """A CAD file has an unknown format or cannot be read, or the surface cannot be converted."""


class ArchiveError(SpinorGeomError, ValueError):
    """An archive is damaged, or unsafe to unpack."""


class BatchError(SpinorGeomError):
    """A batch cannot start or continue."""


class MissingPackageError(SpinorGeomError, ImportError):
    sentence = "{package} is not installed; install it, in a clone, with: pip install '.[{extra}]'"


class MissingLibraryError(MissingPackageError):
    sentence = "{package} is not installed; install it with: pip install {package}"


class CompiledPartError(SpinorGeomError, ImportError):
    sentence = (
        "the compiled part of spinor_geom {problem}; install the package again, or run `python setup.py build_ext` in "
        "its source folder"
    )


class RenderError(SpinorGeomError, RuntimeError):
    """A picture cannot be drawn."""


def require(package: str, *, extra: str) -> None:
    """Raises a MissingPackageError unless a package is installed. It is not imported."""
    if importlib.util.find_spec(package) is None:
        raise MissingPackageError(package=package, extra=extra)


def require_type(value: Any, types: type | tuple[type, ...], *, function: str, takes: str) -> None:
    """Raises an ArgumentTypeError unless a value has one of some types. `takes` describes them."""
    if not isinstance(value, types):
        raise ArgumentTypeError(function=function, takes=takes, found=type(value).__name__)


def require_count(least: int = 1, **values: Any) -> None:
    """Raises an OptionError that names the first value that is not a whole number of at least `least`."""
    for name, value in values.items():
        if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
            raise OptionError(f"{name} must be a whole number of at least {least}, not {value!r}")


def require_positive(name: str, value: Any, *, finite: bool = True, instead: str = "") -> None:
    """Raises an OptionError unless a value is a positive number. `instead` names other allowed values."""
    try:
        number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:  # an integer of hundreds of digits
        number = math.inf
    if not 0 < number <= (sys.float_info.max if finite else math.inf):
        raise OptionError(f"{name} must be {instead}a positive number, not {value!r}")
