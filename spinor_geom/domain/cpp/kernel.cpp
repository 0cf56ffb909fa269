// Delaunay refinement of plane regions: sizes, first points, insertion, smoothing. Called by kernel.py through ctypes.
//
// Coordinates are those of a region with centre 0 and radius 1. Triangles run counter-clockwise; neighbour k of a
// triangle lies across its edge from vertex k to the next, and -1 is the boundary. No point is put on the boundary.

#include <cstdint>

#include "boundary.hpp"
#include "mesh.hpp"
#include "seeds.hpp"
#include "size_field.hpp"

using namespace plane;

extern "C" {

// Wanted edge lengths at points.
void sizes(const Region* region, int64_t count, const Point* points, double* lengths) {
    const SizeField size(*region);
    for (int64_t k = 0; k < count; ++k) lengths[k] = size(points[k]);
}

// Refines a constrained Delaunay triangulation of the boundary, which is given in `output`, until the time is over.
void refine(const Region* region, const Seeds* seeds, Output* output) {
    const SizeField size(*region);
    const Boundary boundary(*region);
    Mesh mesh(*region, size, boundary, *output);
    mesh.insert_all(seeds->count < 0 ? lattice_points(boundary, size, output->most_points)
                                     : tips_and_seeds(*region, boundary, size, *seeds));
    mesh.refine();
    mesh.split_long_bridges();
    mesh.smooth();
    mesh.polish();
    mesh.write();
}
}
