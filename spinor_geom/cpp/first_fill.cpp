// Triangulations of closed curves without inner vertices. Called by first_fill.py and flattest_triangulation.py through
// kernel.py.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "entry.hpp"
#include "point.hpp"

// For each chord from vertex i to i + l of a closed curve of n points in space, `split[n * i + l]` is the apex of its
// triangle. `weight` is that of squared diagonals in the cost. Dynamic programming over the lengths of the chords.
ENTRY_POINT int minimum_area_splits(int64_t n, const double* points, double weight, double seconds, int64_t* split) {
    return outcome_of([=] {
        TimeLimit limit(seconds);
        // by start and length, and by end and length, so that the inner loop runs along rows
        std::vector<double> ahead(n * n), behind(n * n), cost_ahead(n * n), cost_behind(n * n), costs(n);
        for (int64_t i = 0; i < n; ++i)
            for (int64_t l = 0; i + l < n; ++l) {
                const double *p = points + 3 * i, *q = points + 3 * (i + l);
                const double x = q[0] - p[0], y = q[1] - p[1], z = q[2] - p[2];
                ahead[n * i + l] = behind[n * (i + l) + l] = std::sqrt(x * x + y * y + z * z);
            }
        for (int64_t d = 2; d < n; ++d)
            for (int64_t i = 0; i + d < n; ++i) {
                limit.require_time(static_cast<size_t>(d));
                const int64_t j = i + d;
                const double *a = &ahead[n * i], *b = &behind[n * j], *before = &cost_ahead[n * i];
                const double *after = &cost_behind[n * j], square = a[d] * a[d];
                for (int64_t l = 1; l < d; ++l) {
                    // Heron: 16 area^2 = ((a + b)^2 - c^2) (c^2 - (a - b)^2)
                    const double sum = a[l] + b[d - l], difference = a[l] - b[d - l];
                    const double sixteen = (sum * sum - square) * (square - difference * difference);
                    costs[l] = 0.25 * std::sqrt(std::max(sixteen, 0.0)) + before[l] + after[d - l];
                }
                const int64_t best = std::min_element(costs.begin() + 1, costs.begin() + d) - costs.begin();
                split[n * i + d] = i + best;
                cost_ahead[n * i + d] = cost_behind[n * j + d] = costs[best] + weight * square;
            }
    });
}

// As `minimum_area_splits`, for the least sum of charges, then the largest of the least cosines between the normals of
// neighbours, then the least area. `around` are the normals beside the edges from each point, NaN for none, `limits` of
// chords from i to j at [i, j] are 1 or, where a chord is forbidden, -inf, and `charges` of triangles i, j, k at
// [i, k, j]. `least` is the sum of charges, and then the least cosine.
ENTRY_POINT int flattest_splits(int64_t n, const double* points, const double* around, const double* limits,
                                const int32_t* charges, int64_t* split, double* least) {
    using geometry::Point3;
    constexpr double kOverCosines = 4;  // more than the difference of two cosines
    struct Chord {
        Point3 normal;  // of the triangle on the chord
        double cosine, area, charge;  // of all triangles beyond the chord
    };
    return outcome_of([=] {
        // by start and length, and by end and length, so that the inner loop runs along rows
        std::vector<Chord> ahead(n * n), behind(n * n);
        const auto point = [](const double* of, int64_t i) { return Point3{of[3 * i], of[3 * i + 1], of[3 * i + 2]}; };
        for (int64_t i = 0; i + 1 < n; ++i) ahead[n * i + 1] = behind[n * (i + 1) + 1] = {point(around, i), 1, 0, 0};
        for (int64_t d = 2; d < n; ++d)
            for (int64_t i = 0; i + d < n; ++i) {
                const int64_t j = i + d;
                const Point3 start = point(points, i), chord = point(points, j) - start;
                Chord best{};
                double most = 0;
                for (int64_t l = 1; l < d; ++l) {
                    const Chord &a = ahead[n * i + l], &b = behind[n * j + d - l];
                    const double charge = charges[n * (n * i + j) + i + l] + a.charge + b.charge;
                    const double limit = std::min({limits[n * i + j], a.cosine, b.cosine});
                    if (l > 1 && limit - kOverCosines * charge < most) continue;
                    Point3 normal = cross(point(points, i + l) - start, chord);
                    const double area = length(normal), size = std::max(area, geometry::kTiny);
                    normal = {normal.x / size, normal.y / size, normal.z / size};
                    // the minimum with NaN is the other number
                    double cosine = std::fmin(std::fmin(limit, dot(normal, a.normal)), dot(normal, b.normal));
                    if (d == n - 1) cosine = std::fmin(cosine, dot(normal, point(around, j)));
                    const double value = cosine - kOverCosines * charge, areas = area + a.area + b.area;
                    if (l > 1 && !(value > most || (value == most && areas < best.area))) continue;
                    most = value;
                    best = {normal, cosine, areas, charge};
                    split[n * i + d] = i + l;
                }
                ahead[n * i + d] = behind[n * j + d] = best;
            }
        least[0] = ahead[n - 1].charge;
        least[1] = ahead[n - 1].cosine;
    });
}
