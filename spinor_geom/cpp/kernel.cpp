// Delaunay refinement of plane regions: sizes, first points, insertion, smoothing. Called through kernel.py.
//
// Coordinates are those of a region with centre 0 and radius 1. Triangles run counter-clockwise; neighbour k of a
// triangle lies across its edge from vertex k to the next, and -1 is the boundary. No point is put on the boundary.

#include <cstdint>

#include "boundary.hpp"
#include "entry.hpp"
#include "mesh.hpp"
#include "seeds.hpp"
#include "size_field.hpp"

using namespace plane;

// Which sources this file was compiled from; see `load` of kernel.py.
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
