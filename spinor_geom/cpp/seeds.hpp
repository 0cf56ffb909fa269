// The inner points from which refinement starts.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "boundary.hpp"

namespace geometry {

inline constexpr double kRoomAtBoundary = 2;  // least distance of lattice points from boundary vertices, in lattice spacings
inline constexpr int kSizeSamples = 100;  // points at which the largest wanted size is searched
inline constexpr double kMostRows = 20000;  // of a lattice
inline constexpr double kFromTips = 0.75, kFromVertices = 1.2;  // least distances of seeds, in edge lengths
inline constexpr double kLeastSpacing = 0.7;  // of seeds, in wanted edge lengths

// The inner points from which refinement starts: points of a lattice with the largest wanted size as spacing.
inline std::vector<Point> lattice_points(
    const Boundary& boundary, const SizeField& size, int64_t most, TimeLimit& limit) {
    if (most <= 0) return {};
    const double area = boundary.area(), shortest = boundary.perimeter() / kMostRows;
    double largest = 0;
    for (const Point p : boundary.lattice(std::max(std::sqrt(area / kSizeSamples), shortest), limit))
        largest = std::max(largest, size(p));
    if (largest == 0) return {};
    const double spacing = std::max({largest, shortest, std::sqrt(area / static_cast<double>(most))});
    std::vector<Point> kept;
    for (const Point p : boundary.lattice(spacing, limit)) {
        if (limit.is_over(boundary.strip_size(p))) break;
        if (size.nearest_vertex(p).first > kRoomAtBoundary * spacing && boundary.has_room(p)) kept.push_back(p);
    }
    return kept;
}

// Tips of equilateral triangles on the boundary edges, and the seeds that are far enough from them. There are no tips if
// two are too near to each other.
inline std::vector<Point> tips_and_seeds(
    const Region& region, const Boundary& boundary, const SizeField& size, const Seeds& seeds, TimeLimit& limit) {
    const int64_t m = region.boundary_size;
    std::vector<Point> tips(m);
    std::vector<double> lengths(m);
    for (int64_t i = 0; i < m; ++i) {
        const Point a = boundary.start(i), edge = boundary.end(i) - a;
        tips[i] = a + 0.5 * edge + std::sqrt(0.75) * Point{-edge.y, edge.x};
        lengths[i] = kFromTips * length(edge);
    }
    const Tree<Point> all(tips, lengths);
    bool apart = true;
    for (int64_t i = 0; i < m && apart && !limit.is_over(); ++i)
        apart = !all.any_around(tips[i], [&](int j) { return j != i && length(tips[j] - tips[i]) < lengths[i]; });
    std::vector<Point> kept;
    std::vector<double> around;
    for (int64_t i = 0; i < m && apart && !limit.is_over(boundary.strip_size(tips[i])); ++i) {
        if (!boundary.has_room(tips[i])) continue;
        kept.push_back(tips[i]);
        around.push_back(lengths[i]);
    }
    const Tree<Point> near(kept, around);
    for (int64_t k = 0; k < seeds.count; ++k) {
        const Point p = seeds.points[k];
        if (limit.is_over(boundary.strip_size(p))) break;
        const auto [distance, vertex] = size.nearest_vertex(p);
        const auto edge = boundary.end(vertex) - boundary.start(vertex);
        if (distance <= kFromVertices * length(edge) || !boundary.has_room(p)) continue;
        if (near.any_around(p, [](int) { return true; })) continue;
        if (seeds.spacing[k] > kLeastSpacing * size(p)) kept.push_back(p);
    }
    return kept;
}

}  // namespace geometry
