"""Poles lie outside Ω, at a distance from it, and cluster at corners."""

import numpy as np
import pytest

from spinor_geom.discrete.minimal_surface import first_disk
from spinor_geom.domain import PlaneDomain
from spinor_geom.domain.flattening import flatten
from spinor_geom.holomorphic.poles import place_poles, refining_poles
from tests.loops import L_SHAPE, planar, ramp, slit

FLAT = np.array([1, 1j, 0])


def flat_domain(loop_points, corners=None):
    disk = first_disk(loop_points)
    return PlaneDomain.from_boundary(flatten(disk.vertices, disk.faces, len(loop_points)).boundary, corners)


def plane(loop):
    return PlaneDomain.from_boundary(loop.points @ FLAT, loop.corners)


def distance_to_boundary(domain, z):
    boundary = np.concatenate([domain.boundary.vertices, domain.boundary.point(np.arange(8000) / 8000)])
    return np.abs(z[:, None] - boundary).min(axis=1)


DOMAINS = {"disk": PlaneDomain.disk(2.0), "L": plane(planar(L_SHAPE, 60)), "slit": plane(slit())}
DOMAINS |= {"ramp": flat_domain(ramp(2.2).points)}
every_domain = pytest.mark.parametrize("domain", DOMAINS.values(), ids=DOMAINS.keys())


@every_domain
def test_poles_lie_outside(domain):
    poles = place_poles(domain)
    assert not domain.contains(poles.positions).any()
    assert (poles.scales > 0).all()
    # at most a pole a vertex, and 16 a corner
    assert len(poles.positions) <= len(domain.boundary.vertices) + 16 * domain.boundary.corners.sum()
    assert len(poles.positions) > 0.9 * (~domain.boundary.corners).sum()


@every_domain
def test_scale_of_a_unit_is_about_its_poles_distance(domain):
    poles = place_poles(domain)
    ratio = distance_to_boundary(domain, poles.positions) / poles.scales
    # never nearer than 0.6 of it to any part of ∂Ω. A sample of ∂Ω may lie a little beside the nearest point
    assert ratio.min() > 0.55
    assert ratio.max() < 1.05


TIP = -np.array([np.cos(0.1), np.sin(0.1)]) * [[1, 1], [1, -1]]
NOTCHED = [(0, 0), TIP[0], (-1, -1), (1, -1), (1, 1), (-1, 1), TIP[1]]
CORNERS = {"square": ([(0, 0), (1, 0), (1, 1), (0, 1)], np.pi / 4), "notch": (NOTCHED, 0.0)}


@pytest.mark.parametrize(("corners", "inward"), CORNERS.values(), ids=CORNERS.keys())
def test_corner_poles_cluster_root_exponentially_on_the_outer_bisector(corners, inward):
    outside = -place_poles(plane(planar(corners, 16))).positions * np.exp(-1j * inward)
    distance = np.sort(outside.real[(np.abs(outside.imag) < 1e-9) & (outside.real > 0)])
    assert len(distance) == 16
    root = np.sqrt(np.arange(1, 17))
    slope, residual, *_ = np.polyfit(root, np.log(distance), 1, full=True)
    assert 3 < slope[0] < 5
    assert residual[0] < 1e-12
    assert abs(distance[-1] - 0.5) < 1e-12


@every_domain
def test_refining_poles_lie_outside_beside_their_panels(domain):
    t = domain.boundary.parameters
    panels = np.stack([t[3:6], t[4:7]], axis=1)
    poles = refining_poles(domain, panels)
    # three middles and four ends
    assert 5 <= len(poles.positions) <= 7
    assert not domain.contains(poles.positions).any()
    edge = np.abs(np.diff(domain.boundary.point(t[3:7]))).max()
    near = domain.boundary.point(np.linspace(t[3], t[6], 200))
    assert np.abs(poles.positions[:, None] - near).min(axis=1).max() < 0.51 * edge
