// Delaunay refinement of plane regions: sizes, first points, insertion, smoothing. Called through kernel.py.
//
// Coordinates are those of a region with centre 0 and radius 1. Triangles run counter-clockwise. Neighbour k of a
// triangle lies across its edge from vertex k to the next, and -1 is the boundary. No point is put on the boundary.

#include <cstdint>

#include "boundary.hpp"
#include "entry.hpp"
#include "mesh.hpp"
#include "seeds.hpp"
#include "size_field.hpp"
#include "space_mesh.hpp"

using namespace geometry;

// Which sources this file was compiled from (see `load` of kernel.py).
ENTRY_POINT uint32_t sources_digest() { return SOURCES_DIGEST; }

// Wanted edge lengths at points. The first parameters are those of a Region.
ENTRY_POINT int sizes(
    int64_t boundary_size, const Point* boundary, const int64_t* after, double growth, double decay,
    int64_t sample_count, const Point* samples, const double* log_lengths, int64_t neighbours,
    int64_t count, const Point* points, double* lengths) {
    return outcome_of([=] {
        const Region region{boundary_size, boundary, after, growth, decay, sample_count, samples, log_lengths, neighbours};
        const SizeField size(region);
        for (int64_t k = 0; k < count; ++k) lengths[k] = size(points[k]);
    });
}

// Refines a constrained Delaunay triangulation of the boundary until the time is over. `points` has room for
// boundary_size + most_points and one point beside each bridge, `faces` for twice as many, after the `counts[1]` given
// ones. `counts` becomes the numbers of points and of faces, and 0 if a limit ended the refinement. `seed_count` is -1
// for a lattice.
ENTRY_POINT int refine(
    int64_t boundary_size, const Point* boundary, const int64_t* after, double growth, double decay,
    int64_t sample_count, const Point* samples, const double* log_lengths, int64_t neighbours,
    int64_t seed_count, const Point* seed_points, const double* seed_spacing,
    int64_t most_points, double seconds, Point* points, int64_t* faces, int64_t* counts) {
    return outcome_of([=] {
        const Region region{boundary_size, boundary, after, growth, decay, sample_count, samples, log_lengths, neighbours};
        const Seeds seeds{seed_count, seed_points, seed_spacing};
        TimeLimit limit(seconds);
        require_numbers(static_cast<size_t>(boundary_size + most_points));
        const SizeField size(region);
        const Boundary edges(region);
        Output output{most_points, points, faces, counts[0], counts[1], counts[2]};
        Mesh mesh(region, size, edges, limit, output);
        mesh.insert_all(
            seed_count < 0 ? lattice_points(edges, size, most_points, limit)
                           : tips_and_seeds(region, edges, size, seeds, limit));
        mesh.refine();
        mesh.split_long_bridges();
        mesh.smooth();
        mesh.polish();
        mesh.write();
    });
}

// Remeshes a surface in space, of which the first `fixed` vertices are kept, until the time is over. The first parameters
// are those of a RegionOf<Point3>. `vertices` has room for `most` ones, `faces` for twice as many. `counts` are the numbers
// of vertices and faces, before and after. `enough` is an angle that is not increased by flips. Without smoothings only
// vertices of triangles with smaller angles move.
ENTRY_POINT int remesh(
    int64_t boundary_size, const Point3* boundary, const int64_t* after, double growth, double decay,
    int64_t sample_count, const Point3* samples, const double* log_lengths, int64_t neighbours,
    int64_t fixed, int64_t taken_count, const int64_t* taken, double enough, int64_t smoothings,
    int64_t most, double seconds, Point3* vertices, int64_t* faces, int64_t* counts) {
    return outcome_of([=] {
        const RegionOf<Point3> region{
            boundary_size, boundary, after, growth, decay, sample_count, samples, log_lengths, neighbours};
        const SizeFieldOf<Point3> size(region);
        TimeLimit limit(seconds);
        std::vector<std::array<int, 3>> given(counts[1]);
        for (int64_t t = 0; t < counts[1]; ++t)
            for (int k = 0; k < 3; ++k) given[t][k] = static_cast<int>(faces[3 * t + k]);
        std::vector<std::array<int, 2>> pairs(taken_count);
        for (int64_t t = 0; t < taken_count; ++t)
            for (int k = 0; k < 2; ++k) pairs[t][k] = static_cast<int>(taken[2 * t + k]);
        space::Mesh mesh({vertices, vertices + counts[0]}, given, static_cast<int>(fixed), pairs, size, enough,
                         static_cast<size_t>(most), limit);
        mesh.flip();
        for (int64_t round = 0; round < std::max<int64_t>(smoothings, 1); ++round) {
            mesh.split();
            mesh.collapse();
            mesh.flip();
            if (smoothings) {
                mesh.smooth();
                mesh.flip();
            }
        }
        mesh.polish();
        mesh.flip();
        std::copy(mesh.vertices().begin(), mesh.vertices().end(), vertices);
        counts[0] = static_cast<int64_t>(mesh.vertices().size());
        counts[1] = static_cast<int64_t>(mesh.triangles().size());
        for (int64_t t = 0; t < counts[1]; ++t)
            for (int k = 0; k < 3; ++k) faces[3 * t + k] = mesh.triangles()[t].vertex[k];
    });
}
