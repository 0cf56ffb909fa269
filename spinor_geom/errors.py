"""Every exception of the package: each says what is wrong, where, and what to do."""

import importlib.util
import math
import sys
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any


class SpinorGeomError(Exception):
    """Base of all errors raised on purpose; the ids it speaks of are attributes.

    A type that always says the same has it as its `sentence`, with the ids' names in braces.
    """

    sentence = ""

    def __init__(self, message: str | None = None, **fields: Any) -> None:
        self.fields = {name: _tuples(value) for name, value in fields.items()}
        super().__init__(self.sentence.format(**self.fields) if message is None else message)
        for name, value in self.fields.items():
            setattr(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        # types differ in what makes them: pickling does not make the sentence anew
        return _unpickled, (type(self), str(self)), self.__dict__


def _unpickled(kind: type[SpinorGeomError], message: str) -> SpinorGeomError:
    error = kind.__new__(kind)
    super(SpinorGeomError, error).__init__(message)
    return error


def _tuples(value: Any) -> Any:
    """Lists, nested too, as tuples."""
    return tuple(map(_tuples, value)) if isinstance(value, (list, tuple)) else value


class MeshError(SpinorGeomError, ValueError):
    """The input mesh cannot be used as it is."""


class MeshShapeError(MeshError):
    """An array has the wrong shape or dtype."""


class VertexIndexError(MeshError):
    """A face names a vertex that does not exist."""

    sentence = "face {face} names vertex {index}, but the mesh has {vertices}, numbered from 0; correct its indices"


class PolygonError(VertexIndexError):
    """A face has fewer than three corners, or one that does not exist."""

    sentence = "face {face} {problem}; correct or remove it"


class NonFiniteVertexError(MeshError):
    """A coordinate is NaN or infinite."""

    def __init__(self, *, vertex: int, place: str = "") -> None:
        where = f"{place}: " if place else ""
        super().__init__(f"{where}vertex {vertex} has a NaN or infinite part; correct it", vertex=vertex, place=place)


class NoFacesError(MeshError):
    """Points without faces have no holes."""

    sentence = "the mesh has {vertices} vertices and no faces: no holes; make faces, or span a curve with solve_plateau"


class MeshExtentError(MeshError):
    """Lengths whose powers are no numbers."""

    sentence = "the mesh has an extent of {extent:.1e}, and powers of such lengths are no numbers; scale the mesh"


class NonManifoldEdgeError(MeshError):
    """An edge has three or more faces where a boundary loop passes."""

    sentence = "edge {edge} has the faces {faces}, at most 2 are allowed beside a loop; remove or split the others"


class DuplicateVertexError(MeshError):
    """The faces do not share vertices: a soup, as STL files hold."""

    sentence = (
        "{count} boundary edges lie on one another, first at vertices {vertices}: the faces do not share their "
        "vertices; merge vertices of equal position first (read_mesh(path).merged(), TriangleMesh.merged(), or "
        "--merge on the command line)"
    )


def advised_distance(distance: float) -> float:
    """The distance that merges vertices so far apart, in mesh units: with two digits, and larger by one of the last."""
    return float(f"{1.1 * distance:.1e}")


def merge_advice(distance: float) -> str:
    """How to merge vertices that are so far apart, in mesh units."""
    within = f"{advised_distance(distance):.1e}" if distance else ""
    return f"fill_hole(mesh, merge={within or True}), or --merge{' ' * bool(within)}{within} on the command line"


def how_far_apart(distance: float) -> str:
    """How two sides of a slit or a seam lie, in words."""
    return f"at most {distance:.2g} apart" if distance else "at the same positions"


class LoopError(SpinorGeomError, ValueError):
    """A boundary loop cannot be used."""


class LoopTooShortError(LoopError):
    """Fewer than three points."""

    sentence = "a loop needs at least 3 points, got {points}; give a closed curve"


class RepeatedPointError(LoopError):
    """Two neighbouring points of a loop are equal."""

    sentence = "points {index} and its successor on the loop are equal; remove one of them"


class CurveError(LoopError):
    """The formulas of a closed curve are not what they should be."""

    sentence = "the curve {reason} (near s = {parameter:.6g}); give a closed one on [0, 1), its derivatives and corners"


class ZeroWidthSlitError(LoopError):
    """Both sides of the loop lie on each other."""

    sentence = (
        "{fraction:.0%} of the loop is a zero-width slit (its two sides are {apart}, first at vertices {vertices}); "
        "merge the vertices of equal position instead of filling it ({advice})"
    )


class SeamError(LoopError):
    """Edges of the loop lie on edges of another loop."""

    sentence = (
        "{count} edges of the loop and of another loop are {apart}, first {edge}: a seam between pieces that do not "
        "share their vertices, not only a hole; merge the vertices of equal position first ({advice}), or name the "
        "loop in loop= (--loop) to fill it all the same"
    )


class TJunctionError(LoopError):
    """Vertices of a boundary lie on edges of a boundary: two sides of a seam that are divided differently."""

    sentence = (
        "the loop is a seam with T-junctions, not only a hole: {count} boundary vertices lie on boundary edges, first "
        "vertex {vertex} on edge {edge}, which are {apart}; divide those edges at these vertices, or name the "
        "loop in loop= (--loop) to fill it all the same"
    )


class SheetBorderError(LoopError):
    """A loop is the border of a sheet, over which a patch would lie on the mesh."""

    sentence = (
        "it is the border of a sheet rather than a hole: {evidence}; to fill it all the same name it in loop= (--loop)"
    )


class LoopIndexError(LoopError):
    """A loop was asked for that the mesh does not have."""

    sentence = "loop {index} does not exist, the mesh has {loops} (numbered from 0, longest first)"


class ForeignLoopError(LoopError):
    """A loop object is not one of the mesh's boundary loops."""

    sentence = (
        "the loop of {vertices} vertices is not a boundary loop of this mesh (its vertex ids, positions and direction"
        " must be those of a loop in boundary_loops(mesh)); to span a bare curve use solve_plateau"
    )


class ForeignRimError(LoopError):
    """A mesh is to be compared with a surface that has another rim."""

    sentence = (
        "the mesh to compare with is not over the same rim: it has {boundary}; give the patch alone, without the mesh "
        "around the hole, and with the rim's points on its boundary"
    )


class SelfCrossingLoopError(LoopError):
    """Edges of the loop meet that are no neighbours, or neighbours lie on each other."""

    sentence = (
        "the loop crosses or touches itself: its edges {edges[0]} and {edges[1]} meet ({count} such pairs in all), so"
        " it bounds no disk; move them apart, or give them a common vertex where they meet, so that the loop falls "
        "into simple ones"
    )


class OpenCurveError(LoopError):
    """A curve does not come back to its first point."""

    sentence = "the curve is open: its ends are {gap:.6g} apart (mean edge {mean_edge:.3g}); close it, or raise closing"


class KnottedLoopError(LoopError):
    """The loop is knotted, so every disk over it crosses itself."""

    sentence = (
        "the loop is knotted (|Δ(−1)| of its Alexander polynomial is {determinant:.0f}), so every disk over it "
        "crosses itself; cut it into loops that are not"
    )


class TooManyRimsError(LoopError):
    """A surface between three or more loops was asked for."""

    sentence = "discrete minimal surfaces span one loop or join two, got loops of {sizes} vertices; give one or two"


class SeveralRimsError(LoopError):
    """The one loop of a surface was asked for that has several."""

    sentence = "the surface has {rims} rims; take its loops and curves from `rims`"


class LoopsMeetError(LoopError):
    """Two loops that are to be joined cross or touch each other."""

    sentence = "edge {edges[0]} of one loop and edge {edges[1]} of the other meet; move them apart, or merge vertices"


class TwistedRimsError(LoopError):
    """Two rims of a mesh run such that a surface between them would join the inside to the outside."""

    sentence = (
        "the rims of loops {loops} run the same way around, so that a bridge would join the outside of one to the "
        "inside of the other; turn the faces of one piece over"
    )


class NoAreaError(LoopError):
    """The loop encloses nothing: its points lie on a line, or its sides on each other."""

    sentence = "the loop encloses no area (mean width {width:.1e}, mean edge {mean_edge:.3g}); merge or remove vertices"


class LoneFaceError(LoopError):
    """The loop is the outline of one face that hangs on nothing."""

    sentence = "the loop is the outline of face {face} {vertices}, which has no neighbours; remove the face"


class DomainError(SpinorGeomError, ValueError):
    """No simple plane domain, or a plane polygon that is not simple."""


class FirstFillError(SpinorGeomError):
    """No discrete disk over the loop was found."""


class OutOfTimeError(SpinorGeomError):
    """The time that was allowed was over before there was anything to show."""

    sentence = "no surface was found within the time that was allowed; raise time_limit (--time-limit)"


class SurfaceError(SpinorGeomError):
    """A surface has no finite value where one is needed."""


class PeriodError(SurfaceError):
    """An associate surface does not close around a part of ∂Ω."""

    sentence = (
        "the associate surface of angle {angle:.6g} does not close around {around}: it moves by ({period[0]:.3g}, "
        "{period[1]:.3g}, {period[2]:.3g}) there; take an angle that is a multiple of π, or a part of the domain that "
        "does not go around"
    )


class SingularMatrixError(SpinorGeomError, ValueError):
    """A Laplacian cannot be factored: faces without area, as loops that cross themselves have them."""

    sentence = "a Laplacian of {size} inner vertices is singular, as faces have no area; check the loop for crossings"


class UnsolvableError(SingularMatrixError):
    """Equations for a surface have no solution in double precision."""

    sentence = (
        "equations for a surface over the loop cannot be solved ({reason}); check the loop for points that nearly "
        "coincide, and for parts of it that nearly touch"
    )


class DtypeError(SpinorGeomError, TypeError):
    """A tensor has the wrong dtype."""


class OptionError(SpinorGeomError, ValueError):
    """An option has a value that is not allowed."""


class ArgumentTypeError(OptionError, TypeError):
    """A function was given what it does not take."""

    sentence = "{function} takes {takes}, not {found}"


class TooManyPointsError(OptionError):
    """An edge length asks for more vertices than fit into memory."""

    sentence = (
        "patches with edges of {target:.6g} would need about {points:.1e} vertices for an area of {area:.6g}, more "
        "than {most:.0e}; give a longer target_edge_length (--edge-length), in mesh units"
    )


class StorageError(SpinorGeomError):
    """A saved surface cannot be read."""


class ZeroOnContourError(SpinorGeomError):
    """A holomorphic function has a zero on the path along which its zeros are counted."""

    sentence = "the function has a zero on the boundary, or too near, by z = {z:.6g}; take a slightly different domain"


class UnplacedZerosError(SpinorGeomError):
    """A holomorphic function has zeros inside a domain that were counted, but not all found."""

    sentence = (
        "the function has {count} zeros in the domain, but not all of them were found; take a smaller domain around "
        "them"
    )


class ImperfectFillWarning(UserWarning):
    """Holes that were asked for stay open, are closed by a discrete surface or not within the tolerance, or cross."""


class UnknownMeshTypeError(SpinorGeomError, TypeError):
    """No adapter knows this type."""

    def __init__(self, *, found: str, known: Sequence[str]) -> None:
        what_to_do = f"give one of: {', '.join(known)}"
        if found.endswith(".PointCloud"):
            what_to_do = "points have no holes: make faces first, or span a closed curve of points with solve_plateau"
        super().__init__(f"{found} is not a mesh type known here; {what_to_do}", found=found, known=tuple(known))


class MeshFileError(SpinorGeomError, ValueError):
    """A mesh file is missing, malformed, or of an unknown format."""


class ArchiveError(SpinorGeomError, ValueError):
    """An archive is damaged, or holds what no honest archive of meshes holds."""


class BatchError(SpinorGeomError):
    """A batch cannot start or go on."""


class MissingPackageError(SpinorGeomError, ImportError):
    """An optional package is not installed."""

    sentence = "{package} is not installed; install it, in a clone, with: pip install '.[{extra}]'"


class RenderError(SpinorGeomError, RuntimeError):
    """No picture could be drawn."""


def require(package: str, *, extra: str) -> None:
    """Checks, without importing it, that a package is installed; else a MissingPackageError names the extra to get."""
    if importlib.util.find_spec(package) is None:
        raise MissingPackageError(package=package, extra=extra)


def require_type(value: Any, types: type | tuple[type, ...], *, function: str, takes: str) -> None:
    """Raises an ArgumentTypeError for what is not of some types; `takes` names them, and what makes one."""
    if not isinstance(value, types):
        raise ArgumentTypeError(function=function, takes=takes, found=type(value).__name__)


def require_count(least: int = 1, **values: Any) -> None:
    """Raises an OptionError that names the first value that is not a whole number from `least` on."""
    for name, value in values.items():
        if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
            raise OptionError(f"{name} must be a whole number of at least {least}, not {value!r}")


def require_positive(name: str, value: Any, *, finite: bool = True, instead: str = "") -> None:
    """Raises an OptionError for a value that is not a positive number; `instead` says what else it may be."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not 0 < value <= (sys.float_info.max if finite else math.inf):
        raise OptionError(f"{name} must be {instead}a positive number, not {value!r}")
