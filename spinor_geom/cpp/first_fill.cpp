// Triangulations of least area without inner vertices. Called by first_fill.py through kernel.py.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "entry.hpp"

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
