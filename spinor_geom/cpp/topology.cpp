// Half-edges grouped by edge, angles of triangles and between them, components of graphs. Called through kernel.py.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "entry.hpp"
#include "point.hpp"

namespace {

using namespace geometry;

const double kDegree = kPi / 180;

// See `group_half_edges`. Returns the number of edges.
int64_t grouped(int64_t faces, const int64_t* corners, int64_t vertices, int64_t* order, int64_t* starts) {
    const int64_t count = 3 * faces;
    const auto end_of = [=](int64_t h) { return corners[h % 3 == 2 ? h - 2 : h + 1]; };
    std::vector<int64_t> first(vertices + 1, 0);
    for (int64_t h = 0; h < count; ++h) ++first[std::min(corners[h], end_of(h)) + 1];
    std::partial_sum(first.begin(), first.end(), first.begin());
    std::vector<std::pair<int64_t, int64_t>> found(count);  // the higher end, and the half-edge
    std::vector<int64_t> next(first.begin(), first.end());
    for (int64_t h = 0; h < count; ++h) {
        const int64_t a = corners[h], b = end_of(h);
        found[next[std::min(a, b)]++] = {std::max(a, b), h};
    }
    int64_t edges = 0;
    for (int64_t v = 0; v < vertices; ++v) {
        std::sort(found.begin() + first[v], found.begin() + first[v + 1]);
        for (int64_t k = first[v]; k < first[v + 1]; ++k) {
            order[k] = found[k].second;
            if (k == first[v] || found[k].first != found[k - 1].first) starts[edges++] = k;
        }
    }
    starts[edges] = count;
    return edges;
}

// The unit normal of a face, or 0 for an area within the rounding of its sides.
Point3 normal_of(const int64_t* face, const Point3* points) {
    const Point3 a = points[face[0]], u = points[face[1]] - a, v = points[face[2]] - a, n = cross(u, v);
    const double size = length(n), rounding = 4 * std::numeric_limits<double>::epsilon();
    return size > rounding * std::max(dot(u, u), dot(v, v)) ? 1 / size * n : Point3{0, 0, 0};
}

double angle_between(Point3 a, Point3 b) { return std::atan2(length(cross(a, b)), dot(a, b)); }

}  // namespace

// The half-edges 3f + k, from corner k of face f to the next one, in the order of their lower, then of their higher ends,
// then of their numbers. Those of edge e begin at starts[e]. `edge_count` becomes the number of edges. `starts` has room for
// 3 faces + 1.
ENTRY_POINT int group_half_edges(
    int64_t faces, const int64_t* corners, int64_t vertices, int64_t* order, int64_t* starts, int64_t* edge_count) {
    return outcome_of([=] { *edge_count = grouped(faces, corners, vertices, order, starts); });
}

// The angle between the normals of the faces of each half-edge and its twin, in radians, or 0 where the twin is -1.
ENTRY_POINT int crossing_angles(
    int64_t faces, const int64_t* corners, const Point3* points, const int64_t* twin, double* angles) {
    return outcome_of([=] {
        std::vector<Point3> normals(faces);
        for (int64_t t = 0; t < faces; ++t) normals[t] = normal_of(corners + 3 * t, points);
        for (int64_t h = 0; h < 3 * faces; ++h) angles[h] = twin[h] < 0 ? 0 : angle_between(normals[h / 3], normals[twin[h] / 3]);
    });
}

// Angles of the faces of a patch whose first `rim_size` vertices are its rim, each followed by `after`: `smallest` is
// the smallest one of each face that is not between two rim edges, in degrees, infinite for none. `figures` are the
// smallest one between rim edges and the number of half-edges across which the normal turns by more than 90 degrees. Then,
// for the edges of two faces without a vertex of the rim, the largest angle between the faces, its mean square weighted by
// length, and the mean length.
ENTRY_POINT int patch_angles(
    int64_t vertices, const Point3* points, int64_t faces, const int64_t* corners, int64_t rim_size, const int64_t* after,
    double* smallest, double* figures) {
    return outcome_of([=] {
        std::vector<int64_t> order(3 * faces), starts(3 * faces + 1);
        const int64_t edges = grouped(faces, corners, vertices, order.data(), starts.data());
        std::vector<Point3> normals(faces);
        double &at_rim = figures[0], &folds = figures[1], &largest = figures[2], &square = figures[3], &mean = figures[4];
        at_rim = kInfinity;
        for (int64_t t = 0; t < faces; ++t) {
            const int64_t* v = corners + 3 * t;
            std::array<bool, 3> on_rim;
            for (int k = 0; k < 3; ++k) on_rim[k] = v[k] < rim_size && after[v[k]] == v[(k + 1) % 3];
            normals[t] = normal_of(v, points);
            smallest[t] = kInfinity;
            for (int k = 0; k < 3; ++k) {
                const Point3 a = points[v[k]], b = points[v[(k + 1) % 3]], c = points[v[(k + 2) % 3]];
                double& least = on_rim[k] && on_rim[(k + 2) % 3] ? at_rim : smallest[t];
                least = std::min(least, angle_between(b - a, c - a) / kDegree);
            }
        }
        folds = largest = square = mean = 0;
        double total = 0, inner = 0;
        for (int64_t e = 0; e < edges; ++e) {
            if (starts[e + 1] - starts[e] != 2) continue;
            const int64_t here = order[starts[e]], there = order[starts[e] + 1];
            const int64_t a = corners[here], b = corners[here % 3 == 2 ? here - 2 : here + 1];
            const double angle = angle_between(normals[here / 3], normals[there / 3]) / kDegree;
            folds += angle > 90 ? 2 : 0;
            if (std::min(a, b) < rim_size) continue;
            const double size = length(points[b] - points[a]);
            largest = std::max(largest, angle), square += size * angle * angle, total += size, ++inner;
        }
        if (total > 0) square /= total, mean = total / inner;
    });
}

// The connected component, from 0 in the order of their first nodes, of each node of a graph.
ENTRY_POINT int components(int64_t pair_count, const int64_t* pairs, int64_t count, int64_t* labels) {
    return outcome_of([=] {
        const auto root_of = [=](int64_t i) {
            while (labels[i] != i) i = labels[i] = labels[labels[i]];
            return i;
        };
        std::iota(labels, labels + count, int64_t{0});
        for (int64_t k = 0; k < pair_count; ++k) {
            const int64_t a = root_of(pairs[2 * k]), b = root_of(pairs[2 * k + 1]);
            labels[std::max(a, b)] = std::min(a, b);
        }
        // a root is the least node of its component, so it is numbered before the others
        std::vector<int64_t> number(count);
        int64_t found = 0;
        for (int64_t i = 0; i < count; ++i) number[i] = labels[i] == i ? found++ : number[root_of(i)];
        std::copy(number.begin(), number.end(), labels);
    });
}
