// Points of the plane, and geometry of triangles.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>

namespace plane {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTiny = 1e-290;
const double kPi = std::acos(-1.0);
constexpr double kRounding = 1e-13;  // of the determinants, relative to the sums of their terms

constexpr size_t kMostPoints = size_t{1} << 28;  // so that the indices of their triangles and neighbours are ints

inline void require_numbers(size_t points) {
    if (points > kMostPoints) throw std::length_error("points");
}

struct Point {
    double x, y;
};

inline Point operator+(Point a, Point b) { return {a.x + b.x, a.y + b.y}; }
inline Point operator-(Point a, Point b) { return {a.x - b.x, a.y - b.y}; }
inline Point operator*(double s, Point a) { return {s * a.x, s * a.y}; }
inline double cross(Point a, Point b) { return a.x * b.y - a.y * b.x; }
inline double dot(Point a, Point b) { return a.x * b.x + a.y * b.y; }
inline double length(Point a) { return std::sqrt(dot(a, a)); }
inline double side(Point a, Point b, Point p) { return cross(b - a, p - a); }

// Whether p lies inside the circumcircle of a, b, c by more than rounding.
inline bool in_circle(Point a, Point b, Point c, Point p) {
    a = a - p, b = b - p, c = c - p;
    const double aa = dot(a, a), bb = dot(b, b), cc = dot(c, c);
    const double ab = cross(a, b), bc = cross(b, c), ca = cross(c, a);
    const double terms = aa * std::abs(bc) + bb * std::abs(ca) + cc * std::abs(ab);
    return aa * bc + bb * ca + cc * ab > kRounding * terms;
}

// Sine of the smallest angle; negative for clockwise triangles.
inline double smallest_sine(Point a, Point b, Point c) {
    const double ab = length(b - a), bc = length(c - b), ca = length(a - c);
    const double longest = std::max({ab, bc, ca}), shortest = std::min({ab, bc, ca});
    return side(a, b, c) / (longest * (ab + bc + ca - longest - shortest));
}

// Area per sum of squared edges, 1 for an equilateral triangle; not positive for a flipped one.
inline double roundness(Point a, Point b, Point c) {
    const Point u = b - a, v = c - a, w = c - b;
    return 2 * std::sqrt(3.0) * cross(u, v) / (dot(u, u) + dot(v, v) + dot(w, w));
}

}  // namespace plane
