// Points of the plane and of space, and geometry of triangles.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>

namespace geometry {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();
inline constexpr double kTiny = 1e-290;
const double kPi = std::acos(-1.0);
inline constexpr double kRounding = 1e-13;  // of the determinants, relative to the sums of their terms

inline constexpr size_t kMostPoints = size_t{1} << 28;  // so that the indices of their triangles and neighbours are ints

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
inline Point low(Point a, Point b) { return {std::min(a.x, b.x), std::min(a.y, b.y)}; }
inline Point high(Point a, Point b) { return {std::max(a.x, b.x), std::max(a.y, b.y)}; }
inline double coordinate(Point a, int k) { return k == 0 ? a.x : a.y; }
template <class P>
inline constexpr int kDimension = 2;
template <class P>
inline constexpr P kOrigin = {0, 0};

struct Point3 {
    double x, y, z;
};

inline Point3 operator+(Point3 a, Point3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Point3 operator-(Point3 a, Point3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Point3 operator*(double s, Point3 a) { return {s * a.x, s * a.y, s * a.z}; }
inline Point3 cross(Point3 a, Point3 b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
inline double dot(Point3 a, Point3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Point3 low(Point3 a, Point3 b) { return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)}; }
inline Point3 high(Point3 a, Point3 b) { return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)}; }
inline double coordinate(Point3 a, int k) { return k == 0 ? a.x : k == 1 ? a.y : a.z; }
template <>
inline constexpr int kDimension<Point3> = 3;
template <>
inline constexpr Point3 kOrigin<Point3> = {0, 0, 0};

template <class P>
double length(P a) {
    return std::sqrt(dot(a, a));
}
inline double side(Point a, Point b, Point p) { return cross(b - a, p - a); }

// Whether p lies inside the circumcircle of a, b, c by more than rounding.
inline bool in_circle(Point a, Point b, Point c, Point p) {
    a = a - p, b = b - p, c = c - p;
    const double aa = dot(a, a), bb = dot(b, b), cc = dot(c, c);
    const double ab = cross(a, b), bc = cross(b, c), ca = cross(c, a);
    const double terms = aa * std::abs(bc) + bb * std::abs(ca) + cc * std::abs(ab);
    return aa * bc + bb * ca + cc * ab > kRounding * terms;
}

// Sine of the smallest angle, negative for clockwise triangles.
inline double smallest_sine(Point a, Point b, Point c) {
    const double ab = length(b - a), bc = length(c - b), ca = length(a - c);
    const double longest = std::max({ab, bc, ca}), shortest = std::min({ab, bc, ca});
    return side(a, b, c) / (longest * (ab + bc + ca - longest - shortest));
}

// Area per sum of squared edges, 1 for an equilateral triangle and not positive for a flipped one.
inline double roundness(Point a, Point b, Point c) {
    const Point u = b - a, v = c - a, w = c - b;
    return 2 * std::sqrt(3.0) * cross(u, v) / (dot(u, u) + dot(v, v) + dot(w, w));
}

}  // namespace geometry
