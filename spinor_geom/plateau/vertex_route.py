"""The route for rough rims: the minimal surface through a rim's points that is nearest to a discrete one.

Of a mesh's rim only the points are in the mesh. Between them Γ is free, and a rim that was cut along triangles says
nothing of it: so Γ is the surface's own boundary there. What is left to ask for is that the surface passes through n
points, 3n equations for the read-outs of p and q, far fewer than there are read-outs. Of their solutions the one is
taken that is nearest to p and q of a discrete minimal disk, in the H¹ norm on ∂Ω: p and q hardly vary along an edge,
and Γ keeps near to the rim's edges. Ω is that disk flattened with its boundary lengths kept, a polygon whose vertices
are matched with the rim's points; nothing slides, nothing crowds, and two to six Newton steps are enough.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import torch
from jaxtyping import Complex, Int
from torch import Tensor

from spinor_geom.deadline import is_out_of_time
from spinor_geom.discrete.area_descent import Disk
from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.domain.flattening import Flattening, flatten
from spinor_geom.domain.plane_domain import PlaneDomain
from spinor_geom.domain.quadrature import rule
from spinor_geom.domain.triangulation import PlaneTriangulation
from spinor_geom.errors import SurfaceError
from spinor_geom.holomorphic.cauchy import CauchyNetwork
from spinor_geom.holomorphic.poles import polygon_poles
from spinor_geom.mesh.boundary_loop import BoundaryLoop
from spinor_geom.plateau.clock import Clock
from spinor_geom.plateau.found import Found
from spinor_geom.plateau.start import images_in_plane, lifted_spinors
from spinor_geom.plateau.steps import Steps
from spinor_geom.plateau.through_points import (
    NODES,
    Basis,
    OnRim,
    Passing,
    curve_through,
    misfit_at_points,
    nearest_through,
    polygon_through,
    rms,
    shares,
)
from spinor_geom.surface.formulas import phi
from spinor_geom.surface.interior import RimPrimitive
from spinor_geom.surface.spinor_surface import SpinorSurface

# So many edges away from the points no start has led to a surface through them, and a boundary that leaves the loop's
# edges by as many would cross what is beside them.
_FAR = 2.0


def disk_through_points(
    loop: BoundaryLoop,
    *,
    allowed: float,
    steps: Steps,
    device: torch.device,
    clock: Clock,
    first: Disk | None = None,
) -> Found:
    """The minimal disk through the points of a rough loop, as nearly as they can be met, next to a discrete one.

    Raises:
        FirstFillError: no discrete disk over the loop was found.
        DomainError: it has no simple flattening, or one with an edge of no length.
        SingularMatrixError: the discrete disk is degenerate.
        SurfaceError: no surface near the discrete one comes near to the points.
    """
    points = loop.points
    with clock.stage("first fill"):
        disk = first or first_disk(points)
    with clock.stage("flattening"):
        flat = flatten(disk.vertices, disk.faces, len(points))
        images = images_in_plane(disk.vertices, disk.faces, flat.boundary)
        domain = _domain(disk.faces, images, flat)
        spinors = lifted_spinors(disk.vertices, disk.faces, images, (len(points),), device)
    raw: Complex[Tensor, "k 2"] | None = None
    for nodes in (NODES, 2 * NODES):
        with clock.stage("features"):
            basis = _basis(flat.boundary, nodes, device)
        with clock.stage("fit"):
            raw = _fitted(basis, spinors, raw, loop, allowed, steps)
        with clock.stage("surface"):
            network = basis.network(raw)
            rim = RimPrimitive.along(domain.boundary, partial(_phi_of, network), 2 * nodes)
            error = rim.at_breaks[:-1].real - points
            error -= error.mean(axis=0)
        if np.linalg.norm(error) <= allowed * len(points) ** 0.5 or is_out_of_time():
            break
    with clock.stage("surface"):
        velocity = rim.velocity.real.reshape(len(points), -1, 3) * np.diff(rim.panels.breaks)[:, None, None]
        curve = curve_through(points, velocity, error)
        bulge = curve.bulge() / loop.mean_edge_length
        if not bulge <= _FAR:
            raise SurfaceError(
                f"the surface through the loop's points goes {bulge:.1f} edges away from the edges between them"
            )
        root = domain.root
        at_root = rim.at_breaks[root] if root < len(points) else rim.inside(domain.triangulation.points[[root]])[0]
        return Found(
            surface=SpinorSurface(network, domain, points[0] + error[0] + at_root.real).to(device),
            curves=(curve,),
            matchings=(np.column_stack([domain.boundary.parameters[:-1], curve.breaks[:-1]]),),
            misfit=misfit_at_points(curve, error),
            area=rim.area,
            route="vertices",
            limit="no minimal surface near the discrete one passes through the loop's points more nearly",
        )


def _fitted(
    basis: Basis,
    spinors: Complex[Tensor, "n 2"],
    raw: Complex[Tensor, "k 2"] | None,
    loop: BoundaryLoop,
    allowed: float,
    steps: Steps,
) -> Complex[Tensor, "k 2"]:
    """Read-outs that meet all points, nearest to p and q of a start in the middle of each edge; from `raw` on."""
    (rim,) = basis.rims
    start = _nearest(rim, spinors)
    readout = start if raw is None else rim.norm.mH @ raw
    wanted = torch.tensor(loop.points, device=start.device)
    here = Passing(basis=basis, points=(wanted,), raw=basis.raw(readout))
    in_edges = rms(here.error) / loop.mean_edge_length
    if not in_edges <= _FAR:
        raise SurfaceError(
            "the flattened discrete disk over the loop is too far from conformal: p and q of its frames lead "
            f"{in_edges:.0f} edges away from the points"
        )

    return basis.raw(nearest_through(here, readout, start=start, allowed=allowed, steps=steps))


def _domain(faces: Int[np.ndarray, "f 3"], images: Complex[np.ndarray, " n"], flat: Flattening) -> PlaneDomain:
    """Inside the flattened boundary, with the disk's own triangles where they have a place there."""
    boundary = polygon_through(flat.boundary)
    a, b, c = images[faces].T
    if not ((np.conj(b - a) * (c - a)).imag > 0).all():
        return PlaneDomain.inside(boundary, flat.log_scale)
    mesh = PlaneTriangulation(points=images, faces=faces, boundary_size=len(flat.boundary))
    return PlaneDomain(boundary=boundary, triangulation=mesh, log_scale=flat.log_scale)


def _phi_of(network: CauchyNetwork, z: Complex[np.ndarray, " n"]) -> Complex[np.ndarray, "n 3"]:
    with torch.no_grad():
        spinors = network.value(torch.from_numpy(z).to(network.poles.device))
        return np.asarray(phi(*spinors.unbind(-1)).cpu())


def _basis(vertices: Complex[np.ndarray, " n"], nodes: int, device: torch.device) -> Basis:
    none = torch.zeros(0, dtype=torch.complex128, device=device)
    poles = polygon_poles(vertices)
    return Basis.on([torch.as_tensor(vertices, device=device)], [poles], (), none, nodes=nodes)


def _nearest(rim: OnRim, spinors: Complex[Tensor, "n 2"]) -> Complex[Tensor, "k 2"]:
    """Orthonormal read-outs of the sums nearest in H¹ to values in the middle of each edge and linear between."""
    place = torch.tensor(rule("gauss", rim.features.shape[1]).nodes, device=spinors.device)[:, None]
    edge = shares(rim.polygon)[:, None, None]
    before, after = spinors.roll(1, 0)[:, None], spinors.roll(-1, 0)[:, None]
    back = (0.5 - place).clamp(min=0) * edge * 2 / (edge + edge.roll(1, 0))
    ahead = (place - 0.5).clamp(min=0) * edge * 2 / (edge + edge.roll(-1, 0))
    return rim.nearest((1 - back - ahead) * spinors[:, None] + back * before + ahead * after)
