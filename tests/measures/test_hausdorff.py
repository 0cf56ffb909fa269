import igl
import numpy as np
import pytest

from spinor_geom.bench.holes import plane_square
from spinor_geom.errors import OptionError
from spinor_geom.measures import hausdorff_distance


def square(n=2, height=0.0):
    """The unit square as a grid of n × n points, at a height."""
    vertices, faces = plane_square(n - 1)
    return vertices / (n - 1) + [0, 0, height], faces


def sphere(times, radius=1.0):
    vertices, faces = igl.upsample(*octahedron(), times)
    return radius * vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces.astype(np.int64)


def octahedron():
    vertices = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    upper = np.array([[k, (k + 1) % 4, 4] for k in range(4)])
    return vertices, np.concatenate([upper, np.stack([upper[:, 1], upper[:, 0], np.full(4, 5)], axis=1)])


def test_parallel_squares_are_as_far_apart_as_their_planes():
    distance = hausdorff_distance(*square(2), *square(7, height=0.25))
    for side in (distance.forward, distance.backward):
        assert side.max == pytest.approx(0.25)
        assert side.mean == pytest.approx(0.25)
    assert distance.max == pytest.approx(0.25)


def test_part_of_a_mesh_is_near_it_but_not_the_other_way_round():
    vertices, faces = square(2)
    distance = hausdorff_distance(vertices, faces[:1], vertices, faces, samples=50_000)
    assert distance.forward.max == pytest.approx(0, abs=1e-12)
    # the far corner (0, 1) of the missing half is √½ from the diagonal, that half's mean distance a third of it
    assert distance.backward.max == pytest.approx(np.sqrt(0.5))
    assert distance.backward.mean == pytest.approx(np.sqrt(0.5) / 6, rel=1e-3)
    assert distance.max == distance.backward.max
    assert distance.mean == distance.backward.mean


def test_concentric_spheres_are_as_far_apart_as_their_radii():
    distance = hausdorff_distance(*sphere(5), *sphere(5, radius=1.1))
    # the flat faces lie up to 3e-4 inside their spheres
    assert distance.max == pytest.approx(0.1, abs=1e-3)
    assert distance.mean == pytest.approx(0.1, abs=1e-3)


def test_bound_by_the_spacing_of_samples_holds():
    rng = np.random.default_rng(0)
    vertices, faces = square(6)
    vertices[:, 2] = 0.3 * rng.normal(size=len(vertices))
    coarse = hausdorff_distance(vertices, faces, *square(2), samples=200).backward
    fine = hausdorff_distance(vertices, faces, *square(2), samples=100_000).backward
    assert coarse.max <= fine.max + 1e-12
    assert fine.max <= coarse.max + coarse.spacing


def test_distance_agrees_with_meshlab():
    import pymeshlab

    rng = np.random.default_rng(1)
    first, second = square(9), square(12)
    first[0][:, 2], second[0][:, 2] = 0.05 * rng.normal(size=81), 0.05 * rng.normal(size=144)
    ours = hausdorff_distance(*first, *second, samples=60_000)
    meshes = pymeshlab.MeshSet(verbose=False)
    for vertices, faces in (first, second):
        meshes.add_mesh(pymeshlab.Mesh(vertices, faces.astype(np.int32)))
    for side, (sampled, target) in ((ours.forward, (0, 1)), (ours.backward, (1, 0))):
        # samples at vertices and edges as well find the largest distance, but do not weigh by area
        anywhere, inside = (
            meshes.get_hausdorff_distance(
                sampledmesh=sampled,
                targetmesh=target,
                samplevert=rim,
                sampleedge=rim,
                sampleface=True,
                samplenum=100_000,
            )
            for rim in (True, False)
        )
        # ours lie 1/200 apart, theirs are random
        assert side.max == pytest.approx(anywhere["max"], rel=0.02)
        assert side.mean == pytest.approx(inside["mean"], rel=0.01)


def test_mesh_without_faces_is_refused():
    vertices, faces = square(2)
    with pytest.raises(OptionError):
        hausdorff_distance(vertices, faces[:0], vertices, faces)
