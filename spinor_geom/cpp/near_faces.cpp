// Triangles in space near each other: those in a box, and pairs that may cross. Called through kernel.py.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "entry.hpp"
#include "tree.hpp"

namespace {

using namespace geometry;

using Corners = std::array<Point3, 3>;

constexpr double kFlat = 1e-12;  // sine of an angle above which rounding cannot change its sign

Box box_of(const Corners& t) { return Box(Box(t[0], t[1]), Box(t[2], t[2])); }

// The bits of a number from 0 to 1023, with two zeros after each.
uint32_t spread(uint32_t bits) {
    bits = (bits | bits << 16) & 0x030000FF;
    bits = (bits | bits << 8) & 0x0300F00F;
    bits = (bits | bits << 4) & 0x030C30C3;
    return (bits | bits << 2) & 0x09249249;
}

// The order of boxes along a curve on which boxes near each other mostly follow each other (Morton's).
std::vector<int64_t> order_along_curve(const std::vector<Box>& boxes) {
    Box all;
    for (const Box& own : boxes) all = Box(all, own);
    std::vector<std::pair<uint32_t, int64_t>> keys;
    for (const Box& own : boxes) {
        uint32_t key = 0;
        for (int k = 0; k < 3; ++k) {
            const double first = coordinate(all.low, k), size = std::max(coordinate(all.high, k) - first, kTiny);
            const double middle = 0.5 * coordinate(own.low, k) + 0.5 * coordinate(own.high, k);
            const double share = (middle - first) / size;
            key |= spread(share > 0 ? static_cast<uint32_t>(std::min(1023.0, 1024 * share)) : 0) << k;
        }
        keys.emplace_back(key, static_cast<int64_t>(keys.size()));
    }
    std::sort(keys.begin(), keys.end());
    std::vector<int64_t> order;
    for (const auto& [key, number] : keys) order.push_back(number);
    return order;
}

bool equal(Point3 a, Point3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

// Whether the corners of g, except those of f, are clearly on one side of the plane of f. `limit` is a volume.
bool is_beside(const Corners& f, Point3 normal, const Corners& g, const std::array<bool, 3>& is_common, double limit) {
    bool is_above = true, is_below = true;
    for (int k = 0; k < 3; ++k) {
        if (is_common[k]) continue;
        const double height = dot(g[k] - f[0], normal);
        is_above = is_above && height > limit;
        is_below = is_below && height < -limit;
    }
    return is_above || is_below;
}

// Whether the directions a and b are clearly on one side of the direction p.
bool on_one_side(Point p, Point a, Point b, double sign) {
    const auto is_left = [&](Point q) { return sign * cross(p, q) > kFlat * length(p) * length(q); };
    return is_left(a) && is_left(b);
}

// Whether two triangles with common corners clearly have no other common points: their projections along the sum of
// their normals have none.
bool meet_only_at_corners(const Corners& f, const Corners& g, Point3 n, Point3 m, const std::array<int, 3>& partner, int common) {
    const double n_size = length(n), m_size = length(m);
    if (!(n_size > 0 && m_size > 0)) return false;
    const Point3 axis = 1 / n_size * n + (dot(n, m) < 0 ? -1 : 1) / m_size * m;
    // any two directions across the axis
    Point3 u = std::abs(axis.x) < std::abs(axis.y) ? Point3{1, 0, 0} : Point3{0, 1, 0};
    u = cross(axis, u);
    const Point3 v = 1 / length(axis) * cross(axis, u);
    int own = 0;
    while (partner[own] < 0) ++own;
    const Point3 from = f[own];
    const auto flat = [&](Point3 p) { return Point{dot(p - from, u), dot(p - from, v)}; };
    Point p = flat(f[(own + 1) % 3]), q = flat(f[(own + 2) % 3]);
    if (common == 2) {
        const int second = partner[(own + 1) % 3] >= 0 ? (own + 1) % 3 : (own + 2) % 3;
        const Point side = flat(f[second]), apex = flat(f[3 - own - second]);
        const Point other = flat(g[3 - partner[own] - partner[second]]);
        const double least = kFlat * length(side), one = cross(side, apex), two = cross(side, other);
        return one * two < 0 && std::abs(one) > least * length(apex) && std::abs(two) > least * length(other);
    }
    Point r = flat(g[(partner[own] + 1) % 3]), s = flat(g[(partner[own] + 2) % 3]);
    if (cross(p, q) < 0) std::swap(p, q);
    if (cross(r, s) < 0) std::swap(r, s);
    if (!on_one_side(p, q, q, 1) || !on_one_side(r, s, s, 1)) return false;
    return on_one_side(p, r, s, -1) || on_one_side(q, r, s, 1) || on_one_side(r, p, q, -1) || on_one_side(s, p, q, 1);
}

// Whether two triangles clearly have no common points but common corners.
bool are_separated(const Corners& f, const Corners& g, double separation) {
    std::array<int, 3> partner{-1, -1, -1};  // the corner of g that is a corner of f
    std::array<bool, 3> of_f{}, of_g{};
    int common = 0;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            if (equal(f[i], g[j])) partner[i] = j, of_f[i] = of_g[j] = true, ++common;
    if (common > 2) return false;
    const Box both(box_of(f), box_of(g));
    const Point3 extent = both.high - both.low;
    const double size = std::max({extent.x, extent.y, extent.z}), limit = separation * size * size * size;
    const Point3 n = cross(f[1] - f[0], f[2] - f[0]), m = cross(g[1] - g[0], g[2] - g[0]);
    if (is_beside(f, n, g, of_g, limit) || is_beside(g, m, f, of_f, limit)) return true;
    return common > 0 && meet_only_at_corners(f, g, n, m, partner, common);
}

Box box_of(const Point3* points, const int64_t* face) { return box_of(Corners{points[face[0]], points[face[1]], points[face[2]]}); }

}  // namespace

// Sorts faces by the cells of a grid with `cells` ones in each direction. `order` has the faces of one cell after the other,
// those of cell c from starts[c] on. boxes[c] is the box of these faces. Empty cells are left out. `cell_count` becomes the
// number of the others.
ENTRY_POINT int sort_by_cells(
    const Point3* points, int64_t faces, const int64_t* corners, int64_t cells, int64_t* order, int64_t* starts,
    double* boxes, int64_t* cell_count) {
    return outcome_of([=] {
        Box all;
        for (int64_t t = 0; t < faces; ++t) all = Box(all, box_of(points, corners + 3 * t));
        const Point3 extent = all.high - all.low;
        const double size = std::max({extent.x, extent.y, extent.z, kTiny}), per_length = (static_cast<double>(cells) - 0.5) / size;
        std::vector<int64_t> key(faces), next(cells * cells * cells + 1, 0);
        for (int64_t t = 0; t < faces; ++t) {
            const Point3 at = per_length * (box_of(points, corners + 3 * t).low - all.low);
            key[t] = (static_cast<int64_t>(at.x) * cells + static_cast<int64_t>(at.y)) * cells + static_cast<int64_t>(at.z);
            ++next[key[t] + 1];
        }
        auto* box = reinterpret_cast<Box*>(boxes);
        int64_t filled = 0;
        for (size_t c = 0; c + 1 < next.size(); ++c) {
            if (next[c + 1]) starts[filled++] = next[c];
            next[c + 1] += next[c];
        }
        for (int64_t t = 0; t < faces; ++t) order[next[key[t]]++] = t;
        starts[filled] = faces, *cell_count = filled;
        for (int64_t c = 0; c < filled; ++c) {
            box[c] = Box();
            for (int64_t k = starts[c]; k < starts[c + 1]; ++k) box[c] = Box(box[c], box_of(points, corners + 3 * order[k]));
        }
    });
}

// The faces whose boxes meet one of some boxes, from the result of `sort_by_cells`. `found` has room for all of them.
ENTRY_POINT int faces_in_boxes(
    const Point3* points, int64_t faces, const int64_t* corners, const int64_t* order, int64_t cell_count,
    const int64_t* starts, const double* boxes, int64_t wanted_count, const double* wanted, int64_t* found, int64_t* found_count) {
    return outcome_of([=] {
        const auto* box = reinterpret_cast<const Box*>(boxes);
        const auto* first = reinterpret_cast<const Box*>(wanted);
        const std::vector<Box> given(first, first + wanted_count);
        std::vector<Box> ordered;
        for (const int64_t j : order_along_curve(given)) ordered.push_back(given[j]);
        BoxTree tree(ordered);
        *found_count = 0;
        for (int64_t c = 0; c < cell_count; ++c) {
            if (!tree.meets(box[c])) continue;
            for (int64_t k = starts[c]; k < starts[c + 1]; ++k)
                if (tree.meets(box_of(points, corners + 3 * order[k]))) found[(*found_count)++] = order[k];
        }
    });
}

// Pairs of triangles that are not clearly separated: one of `count` and one of `other_count` others, or two of the first
// ones, the smaller number first, if `other_count` is -1. `separation` is a volume per cubed extent of a pair. `pairs` is
// filled with those of successive triangles, as far as all pairs of the last one fit. Its length is `room`, at least the
// number of partners. `done` becomes the number of pairs and the next `first`.
ENTRY_POINT int near_faces(
    int64_t count, const double* triangles, int64_t other_count, const double* others, double separation, int64_t first,
    int64_t room, double seconds, int64_t* pairs, int64_t* done) {
    return outcome_of([=] {
        TimeLimit limit(seconds);
        const auto* f = reinterpret_cast<const Corners*>(triangles);
        const bool is_same = other_count < 0;
        const auto* g = is_same ? f : reinterpret_cast<const Corners*>(others);
        const int64_t partners = is_same ? count : other_count;
        std::vector<Box> boxes, ordered;
        for (int64_t j = 0; j < partners; ++j) boxes.push_back(box_of(g[j]));
        const std::vector<int64_t> order = order_along_curve(boxes);
        for (const int64_t j : order) ordered.push_back(boxes[j]);
        BoxTree tree(ordered);
        done[0] = 0;
        for (done[1] = first; done[1] < count && done[0] + partners <= room; ++done[1]) {
            const int64_t own = is_same ? order[done[1]] : done[1];
            const auto add = [&](int64_t place) {
                int64_t i = own, j = order[place];
                if (is_same && j < i) std::swap(i, j);
                if (are_separated(f[i], g[j], separation)) return;
                pairs[2 * done[0]] = i;
                pairs[2 * done[0] + 1] = j;
                ++done[0];
            };
            if (is_same) {
                tree.each_after(done[1], limit, add);
            } else {
                tree.each(box_of(f[own]), limit, add);
            }
        }
    });
}
