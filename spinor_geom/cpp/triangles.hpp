// Triangles and their neighbours, in the plane or in space.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "point.hpp"

namespace geometry {

// triangles without smaller angles than 25 degrees are kept. Above 30 the number of points grows quickly
const double kLeastSine = std::sin(25.0 * kPi / 180);
// a point of a poor triangle is tried at eight places around it, at these multiples of the length of its edges
inline constexpr std::array<double, 6> kPolishing = {0.3, 0.3, 0.15, 0.15, 0.08, 0.08};
inline constexpr int kAround = 8;

struct Triangle {
    std::array<int, 3> vertex, across;  // neighbour k lies across the edge from vertex k to the next, and -1 is the boundary
};

class Triangles {
protected:
    void connect() {
        std::vector<std::array<int, 4>> edges;  // smaller vertex, larger vertex, triangle, place
        for (int t = 0; t < static_cast<int>(triangles_.size()); ++t)
            for (int k = 0; k < 3; ++k) {
                const int a = triangles_[t].vertex[k], b = triangles_[t].vertex[(k + 1) % 3];
                triangles_[t].across[k] = -1;
                edges.push_back({std::min(a, b), std::max(a, b), t, k});
            }
        std::sort(edges.begin(), edges.end());
        for (size_t e = 0; e + 1 < edges.size(); ++e) {
            const auto [a, b, t, k] = edges[e];
            const auto [c, d, other, j] = edges[e + 1];
            if (a != c || b != d) continue;
            Triangle &one = triangles_[t], &two = triangles_[other];
            const bool is_same_way = one.vertex[k] == two.vertex[j], is_third = one.across[k] >= 0;
            if (t == other || is_same_way || is_third) throw std::invalid_argument("triangles overlap");
            one.across[k] = other;
            two.across[j] = t;
        }
    }

    int opposite(int triangle, int other) const {
        for (int k = 0; k < 3; ++k)
            if (triangles_[triangle].across[k] == other) return triangles_[triangle].vertex[(k + 2) % 3];
        return -1;
    }

    // The number, in the neighbour across edge k of a triangle, of their common edge.
    int side_of(int t, int k) const {
        const Triangle& other = triangles_[triangles_[t].across[k]];
        int j = 0;
        while (other.across[j] != t || other.vertex[j] != triangles_[t].vertex[(k + 1) % 3]) ++j;
        return j;
    }

    // Replaces edge k of a triangle and its neighbour by the other diagonal: a b c and b a d become a d c and d b c.
    void flip(int t, int k) {
        const int other = triangles_[t].across[k], j = side_of(t, k);
        const int a = triangles_[t].vertex[k], b = triangles_[t].vertex[(k + 1) % 3], c = triangles_[t].vertex[(k + 2) % 3];
        const int d = triangles_[other].vertex[(j + 2) % 3];
        const int bc = triangles_[t].across[(k + 1) % 3], ca = triangles_[t].across[(k + 2) % 3];
        const int ad = triangles_[other].across[(j + 1) % 3], db = triangles_[other].across[(j + 2) % 3];
        triangles_[t] = {{a, d, c}, {ad, other, ca}};
        triangles_[other] = {{d, b, c}, {db, bc, t}};
        relink(ad, other, t, d);
        relink(bc, t, other, c);
    }

    // Replaces neighbour `before` by `after` across the edge of a triangle that starts at a vertex.
    void relink(int triangle, int before, int after, int start) {
        if (triangle < 0) return;
        for (int k = 0; k < 3; ++k)
            if (triangles_[triangle].across[k] == before && triangles_[triangle].vertex[k] == start)
                triangles_[triangle].across[k] = after;
    }

    std::vector<Triangle> triangles_;
};

}  // namespace geometry
