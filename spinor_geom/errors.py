"""Every exception of the package: each says what is wrong, where, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


class SpinorGeomError(Exception):
    """Base of all errors raised on purpose; the ids it speaks of are attributes."""

    def __init__(self, message: str, **fields: Any) -> None:
        super().__init__(message)
        self.fields = fields
        for name, value in fields.items():
            setattr(self, name, value)


# --- meshes -----------------------------------------------------------------------------------------------------------


class MeshError(SpinorGeomError, ValueError):
    """The input mesh cannot be used as it is."""


class MeshShapeError(MeshError):
    """An array has the wrong shape or dtype."""


class VertexIndexError(MeshError):
    """A face names a vertex that does not exist."""

    def __init__(self, *, face: int, index: int, vertices: int) -> None:
        super().__init__(
            f"face {face} names vertex {index}, but the mesh has vertices 0 to {vertices - 1}; "
            "correct the face's indices",
            face=face,
            index=index,
            vertices=vertices,
        )


class NonFiniteVertexError(MeshError):
    """A coordinate is NaN or infinite."""

    def __init__(self, *, vertex: int, place: str = "") -> None:
        where = f"{place}: " if place else ""
        super().__init__(
            f"{where}vertex {vertex} has a NaN or infinite coordinate; remove or correct it", vertex=vertex, place=place
        )


class NoFacesError(MeshError):
    """Points without faces have no holes."""

    def __init__(self, *, vertices: int) -> None:
        super().__init__(
            f"the mesh has {vertices} vertices and no faces, so it has no holes; make faces first, or span a closed "
            "curve of points with solve_plateau",
            vertices=vertices,
        )


class MeshExtentError(MeshError):
    """Lengths whose powers are no numbers."""

    def __init__(self, *, extent: float) -> None:
        super().__init__(
            f"the mesh has an extent of {extent:.1e}, and powers of such lengths are no numbers; scale the mesh",
            extent=extent,
        )


class DegenerateFaceError(MeshError):
    """A face uses one vertex more than once."""

    def __init__(self, *, face: int, vertices: Sequence[int]) -> None:
        super().__init__(
            f"face {face} uses a vertex twice {tuple(vertices)}; remove the face", face=face, vertices=tuple(vertices)
        )


class DuplicateFaceError(MeshError):
    """Two faces have the same three vertices."""

    def __init__(self, *, faces: Sequence[int], vertices: Sequence[int]) -> None:
        super().__init__(
            f"faces {tuple(faces)} have the same vertices {tuple(vertices)}; keep one of them",
            faces=tuple(faces),
            vertices=tuple(vertices),
        )


class NonManifoldEdgeError(MeshError):
    """An edge has three or more faces where a boundary loop passes."""

    def __init__(self, *, edge: Sequence[int], faces: Sequence[int]) -> None:
        super().__init__(
            f"edge {tuple(edge)} has {len(faces)} faces {tuple(faces)}, at most 2 are allowed beside a boundary loop; "
            "remove or split the extra faces",
            edge=tuple(edge),
            faces=tuple(faces),
        )


class InconsistentOrientationError(MeshError):
    """Two neighbouring faces run through their common edge the same way."""

    def __init__(self, *, edge: Sequence[int], faces: Sequence[int]) -> None:
        super().__init__(
            f"faces {tuple(faces)} run through edge {tuple(edge)} in the same direction; orient the faces consistently",
            edge=tuple(edge),
            faces=tuple(faces),
        )


class DuplicateVertexError(MeshError):
    """The faces do not share vertices: a soup, as STL files hold."""

    def __init__(self, *, vertices: Sequence[int], count: int) -> None:
        super().__init__(
            f"{count} boundary edges lie on one another, first at vertices {tuple(vertices)}: the faces do not share "
            "their vertices; merge vertices of equal position first (read_mesh(path).merged(), "
            "TriangleMesh.merged(), or --merge on the command line)",
            vertices=tuple(vertices),
            count=count,
        )


# --- boundary loops ---------------------------------------------------------------------------------------------------


class LoopError(SpinorGeomError, ValueError):
    """A boundary loop cannot be used."""


class LoopTooShortError(LoopError):
    """Fewer than three points."""

    def __init__(self, *, points: int) -> None:
        super().__init__(f"a loop needs at least 3 points, got {points}; give a closed curve", points=points)


class RepeatedPointError(LoopError):
    """Two neighbouring points of a loop are equal."""

    def __init__(self, *, index: int) -> None:
        super().__init__(f"points {index} and its successor on the loop are equal; remove one of them", index=index)


class CurveError(LoopError):
    """The formulas of a closed curve are not what they should be."""

    def __init__(self, *, reason: str, parameter: float) -> None:
        super().__init__(
            f"the curve {reason} (near s = {parameter:.6g}); give a closed curve on [0, 1) with its own "
            "derivatives and name its corners",
            parameter=parameter,
        )


class ZeroWidthSlitError(LoopError):
    """Both sides of the loop lie on each other."""

    def __init__(self, *, fraction: float, vertices: Sequence[int]) -> None:
        super().__init__(
            f"{fraction:.0%} of the loop is a zero-width slit (its two sides have the same positions, first at "
            f"vertices {tuple(vertices)}); merge the vertices of equal position instead of filling it",
            fraction=fraction,
            vertices=tuple(vertices),
        )


class SeamError(LoopError):
    """Edges of the loop lie on edges of another loop."""

    def __init__(self, *, edge: Sequence[int], count: int) -> None:
        super().__init__(
            f"{count} edges of the loop lie on edges of another loop, first {tuple(edge)}: a seam between pieces that "
            "do not share their vertices, not only a hole; merge the vertices of equal position first",
            edge=tuple(edge),
            count=count,
        )


class SheetBorderError(LoopError):
    """A patch over the loop would lie on the mesh: it is the border of a sheet."""

    def __init__(self, *, folded: float, crossed: int) -> None:
        super().__init__(
            f"it is the border of a sheet rather than a hole: along {folded:.0%} of it a patch would turn back over "
            f"the faces beside it, and it would cross the mesh in {crossed} pairs of faces; to fill it all the same "
            "name it in loop= (--loop)",
            folded=folded,
            crossed=crossed,
        )


class LoopIndexError(LoopError):
    """A loop was asked for that the mesh does not have."""

    def __init__(self, *, index: int, loops: int) -> None:
        super().__init__(
            f"loop {index} does not exist, the mesh has {loops} (numbered 0 to {loops - 1}, longest first)"
            if loops
            else f"loop {index} does not exist, the mesh has no boundary loops",
            index=index,
            loops=loops,
        )


class ForeignLoopError(LoopError):
    """A loop object is not one of the mesh's boundary loops."""

    def __init__(self, *, vertices: int) -> None:
        super().__init__(
            f"the loop of {vertices} vertices is not a boundary loop of this mesh (its vertex ids, positions and "
            "direction must be those of a loop in boundary_loops(mesh)); to span a bare curve use solve_plateau",
            vertices=vertices,
        )


class SelfCrossingLoopError(LoopError):
    """Edges of the loop meet that are no neighbours, or neighbours lie on each other."""

    def __init__(self, *, edges: Sequence[Sequence[int]], count: int) -> None:
        first, second = (tuple(edge) for edge in edges)
        more = f" (and {count - 1} more {'pair' if count == 2 else 'pairs'})" if count > 1 else ""
        super().__init__(
            f"the loop crosses or touches itself: its edges {first} and {second} meet{more}, so it bounds no disk; "
            "move them apart, or give them a common vertex where they meet, so that the loop falls into simple ones",
            edges=(first, second),
            count=count,
        )


class OpenCurveError(LoopError):
    """A curve does not come back to its first point."""

    def __init__(self, *, gap: float, mean_edge: float) -> None:
        super().__init__(
            f"the curve is open: its ends are {gap:.6g} apart, {gap / mean_edge if mean_edge else 0:.3g} of its mean "
            "edges; close it, or raise the closing tolerance",
            gap=gap,
            mean_edge=mean_edge,
        )


class KnottedLoopError(LoopError):
    """The loop is knotted, so every disk over it crosses itself."""

    def __init__(self, *, determinant: float) -> None:
        super().__init__(
            f"the loop is knotted (|Δ(−1)| of its Alexander polynomial is {determinant:.0f}), so every disk over it "
            "crosses itself; cut it into loops that are not",
            determinant=determinant,
        )


class TooManyRimsError(LoopError):
    """A surface between three or more loops was asked for."""

    def __init__(self, *, sizes: Sequence[int], names: Sequence[int] | None = None) -> None:
        named = range(len(sizes)) if names is None else names
        loops = ", ".join(
            f"{name} ({size} vertices)" if size else f"{name} (a formula)"
            for name, size in zip(named, sizes, strict=True)
        )
        listed = f"{len(sizes)}: loops {loops}" if len(sizes) > 1 else f"a sequence of {len(sizes)}"
        super().__init__(
            f"surfaces span one loop or join two, got {listed}; "
            + ("three rims and more are not supported: join two of them first" if len(sizes) > 2 else "give two"),
            sizes=tuple(sizes),
            names=tuple(named),
        )


class SeveralRimsError(LoopError):
    """The one loop of a surface was asked for that has several."""

    def __init__(self, *, rims: int) -> None:
        super().__init__(f"the surface has {rims} rims; take its loops and curves from `rims`", rims=rims)


class LoopsMeetError(LoopError):
    """Two loops that are to be joined cross or touch each other."""

    def __init__(self, *, edges: Sequence[Sequence[int]]) -> None:
        first, second = (tuple(edge) for edge in edges)
        super().__init__(
            f"edge {first} of the first loop and edge {second} of the second meet, so no annulus lies between them; "
            "move the loops apart, or merge the vertices that they share",
            edges=(first, second),
        )


class TwistedRimsError(LoopError):
    """Two rims of a mesh run such that a surface between them would join the inside to the outside."""

    def __init__(self, *, loops: Sequence[int]) -> None:
        super().__init__(
            f"the rims of loops {tuple(loops)} run the same way around, so that a bridge would join the outside of one "
            "to the inside of the other; turn the faces of one piece over",
            loops=tuple(loops),
        )


class NoAreaError(LoopError):
    """The loop encloses nothing: its points lie on a line, or its sides on each other."""

    def __init__(self, *, width: float, mean_edge: float) -> None:
        super().__init__(
            f"the loop encloses no area (mean width {width:.1e}, mean edge {mean_edge:.3g}), a patch would be slivers; "
            "merge or remove vertices along it instead",
            width=width,
            mean_edge=mean_edge,
        )


class LoneFaceError(LoopError):
    """The loop is the outline of one face that hangs on nothing."""

    def __init__(self, *, face: int, vertices: Sequence[int]) -> None:
        super().__init__(
            f"the loop is the outline of face {face} {tuple(vertices)}, which has no neighbours; a patch would lie on "
            "that face; remove the face",
            face=face,
            vertices=tuple(vertices),
        )


# --- surfaces and solvers ---------------------------------------------------------------------------------------------


class DomainError(SpinorGeomError, ValueError):
    """No simple plane domain, or a plane polygon that is not simple."""


class FirstFillError(SpinorGeomError):
    """No discrete disk over the loop was found."""


class OutOfTimeError(SpinorGeomError):
    """The time that was allowed was over before there was anything to show."""

    def __init__(self) -> None:
        super().__init__("no surface was found within the time that was allowed; raise time_limit (--time-limit)")


class SurfaceError(SpinorGeomError):
    """A surface has no finite value where one is needed."""


class PeriodError(SurfaceError):
    """An associate surface does not close around a part of ∂Ω."""

    def __init__(self, *, angle: float, around: str, period: Sequence[float]) -> None:
        told = ", ".join(f"{x:.3g}" for x in period)
        super().__init__(
            f"the associate surface of angle {angle:.6g} does not close around {around}: it moves by ({told}) there; "
            "take an angle that is a multiple of π, or a part of the domain that does not go around",
            angle=angle,
            around=around,
            period=tuple(period),
        )


class SingularMatrixError(SpinorGeomError, ValueError):
    """A Laplacian cannot be factored: faces without area, as loops that cross themselves have them."""

    def __init__(self, *, size: int) -> None:
        super().__init__(
            f"a Laplacian of {size} inner vertices is singular, as some faces have no area; check that the loop does "
            "not cross itself or run along itself",
            size=size,
        )


class DtypeError(SpinorGeomError, TypeError):
    """A tensor has the wrong dtype."""


class OptionError(SpinorGeomError, ValueError):
    """An option has a value that is not allowed."""


class TooManyPointsError(OptionError):
    """An edge length asks for more vertices than fit into memory."""

    def __init__(self, *, target: float, area: float, points: float, most: int) -> None:
        super().__init__(
            f"patches with edges of {target:.6g} would need about {points:.1e} vertices for an area of {area:.6g}, "
            f"more than {most:.0e}; give a longer target_edge_length (--edge-length), in mesh units",
            target=target,
            area=area,
            points=points,
        )


class StorageError(SpinorGeomError):
    """A saved surface cannot be read."""


class ZeroOnContourError(SpinorGeomError):
    """A holomorphic function has a zero on the path along which its zeros are counted."""

    def __init__(self, *, z: complex) -> None:
        super().__init__(
            f"the function has a zero on the boundary, or too near to it, by z = {z:.6g}; its zeros cannot be counted: "
            "use a slightly larger or smaller domain",
            z=z,
        )


class ImperfectFillWarning(UserWarning):
    """Holes that were asked for stay open, are closed by a discrete surface or not within the tolerance, or cross."""


# --- adapters and files -----------------------------------------------------------------------------------------------


_REMEDIES = {
    "trimesh.PointCloud": "points have no holes: make faces first, or span a closed curve of points with solve_plateau",
}


class UnknownMeshTypeError(SpinorGeomError, TypeError):
    """No adapter knows this type."""

    def __init__(self, *, found: str, known: Sequence[str]) -> None:
        what_to_do = _REMEDIES.get(found, f"give one of: {', '.join(known)}")
        super().__init__(f"{found} is not a mesh type known here; {what_to_do}", found=found, known=tuple(known))


class MeshFileError(SpinorGeomError, ValueError):
    """A mesh file is missing, malformed, or of an unknown format."""


class ArchiveError(SpinorGeomError, ValueError):
    """An archive is damaged, or holds what no honest archive of meshes holds."""


class BatchError(SpinorGeomError):
    """A batch cannot start or go on."""


class MissingPackageError(SpinorGeomError, ImportError):
    """An optional package is not installed."""

    def __init__(self, *, package: str, extra: str) -> None:
        super().__init__(
            f"{package} is not installed; install it, in a clone, with: pip install '.[{extra}]'",
            package=package,
            extra=extra,
        )


class RenderError(SpinorGeomError, RuntimeError):
    """No picture could be drawn."""
