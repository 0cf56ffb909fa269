// Cotangent Laplacians of triangle meshes, their mean curvature, and equations for it. Called through kernel.py.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include "entry.hpp"
#include "point.hpp"

namespace {

using geometry::Point3;

constexpr double kSmallest = std::numeric_limits<double>::min();
// Least excess of two sides of a mollified triangle over the third, per longest side: it bounds the cotangents.
constexpr double kSlack = 1e-6;

// The area of a triangle from the lengths of its sides (Kahan, Miscalculating area and angles of a needle-like triangle).
double area(double a, double b, double c) {
    if (a < b) std::swap(a, b);
    if (b < c) std::swap(b, c);
    if (a < b) std::swap(a, b);
    return 0.25 * std::sqrt(std::max((a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c)), 0.0));
}

// Entries of a matrix are numbered by int32_t.
void require_numbers(int64_t entries) {
    if (entries > std::numeric_limits<int32_t>::max()) throw std::length_error("entries");
}

// A symmetric sparse matrix by columns: the rows of the entries of column j are rows[starts[j]] to rows[starts[j + 1] - 1].
struct Matrix {
    int32_t *starts, *rows;
    double* values;
};

// The Laplacian of `count` vertices from the lengths of the edges opposite to the corners of faces.
void assemble(int64_t count, int64_t faces, const double* lengths, const int64_t* corners, Matrix matrix) {
    require_numbers(count + 6 * faces);
    double longest = kSmallest;
    for (int64_t k = 0; k < 3 * faces; ++k) longest = std::max(longest, lengths[k]);
    std::vector<int64_t> starts(count + 1, 0);  // two entries for each corner
    for (int64_t k = 0; k < 3 * faces; ++k) starts[corners[k] + 1] += 2;
    for (int64_t j = 0; j < count; ++j) starts[j + 1] += starts[j];
    std::vector<int64_t> next = starts;
    std::vector<std::pair<int32_t, double>> by_row(6 * faces), entries(6 * faces);
    for (int64_t t = 0; t < faces; ++t) {
        const int64_t* v = corners + 3 * t;
        std::array<double, 3> square;
        std::array<double, 3> side;
        // of ratios, because areas are computed from fourth powers
        for (int k = 0; k < 3; ++k) side[k] = lengths[3 * t + k] / longest, square[k] = side[k] * side[k];
        const double eight = 8 * area(side[0], side[1], side[2]);
        for (int k = 0; k < 3; ++k) {
            const int64_t i = v[(k + 1) % 3], j = v[(k + 2) % 3];
            const double value = -(square[(k + 1) % 3] + square[(k + 2) % 3] - square[k]) / eight;  // half a cotangent
            by_row[next[i]++] = {static_cast<int32_t>(j), value};
            by_row[next[j]++] = {static_cast<int32_t>(i), value};
        }
    }
    // row by row, so that the rows of each column ascend
    next = starts;
    for (int64_t i = 0; i < count; ++i)
        for (int64_t k = starts[i]; k < starts[i + 1]; ++k) entries[next[by_row[k].first]++] = {static_cast<int32_t>(i), by_row[k].second};
    int32_t filled = 0;
    for (int64_t j = 0; j < count; ++j) {
        matrix.starts[j] = filled;
        const int64_t first = starts[j], last = starts[j + 1];
        int32_t diagonal = -1;
        double sum = 0;
        for (int64_t k = first; k < last; ++k) {
            const auto [i, value] = entries[k];
            if (diagonal < 0 && i > j) diagonal = filled, matrix.rows[filled++] = static_cast<int32_t>(j);
            if (k > first && entries[k - 1].first == i) {
                matrix.values[filled - 1] += value;
            } else {
                matrix.rows[filled] = i, matrix.values[filled++] = value;
            }
            sum += value;
        }
        if (diagonal < 0 && last > first) diagonal = filled, matrix.rows[filled++] = static_cast<int32_t>(j);
        if (diagonal >= 0) matrix.values[diagonal] = -sum;
    }
    matrix.starts[count] = filled;
}

// A row of a sparse matrix, of which entries are added in any order.
class Row {
public:
    explicit Row(int64_t count) : values_(count, 0.0), used_(count, false) {}

    void add(int32_t column, double value) {
        if (!used_[column]) used_[column] = true, columns_.push_back(column);
        values_[column] += value;
    }
    const std::vector<int32_t>& columns() const { return columns_; }
    double operator[](int32_t column) const { return values_[column]; }
    void sort() { std::sort(columns_.begin(), columns_.end()); }
    void clear() {
        for (const int32_t column : columns_) values_[column] = 0, used_[column] = false;
        columns_.clear();
    }

private:
    std::vector<double> values_;
    std::vector<char> used_;
    std::vector<int32_t> columns_;
};

}  // namespace

// The Laplacian of `count` vertices. `rows` and `values` have room for count + 6 faces entries.
ENTRY_POINT int intrinsic_laplacian(
    int64_t count, int64_t faces, const double* lengths, const int64_t* corners, int32_t* starts, int32_t* rows, double* values) {
    return outcome_of([=] { assemble(count, faces, lengths, corners, {starts, rows, values}); });
}

// The Laplacian of mollified lengths, the areas, at least `least_share` of the barycentric ones, the unit normals and the
// mean curvatures of a mesh's vertices. The squared length of a vector e in a face is e·e + e·Se, with the rows of S in
// `stretch`, three for each face.
ENTRY_POINT int bending(
    int64_t count, const Point3* vertices, int64_t faces, const int64_t* corners, const Point3* stretch, double least_share,
    int32_t* starts, int32_t* rows, double* values, double* areas, Point3* normals, double* curvature) {
    return outcome_of([=] {
        std::vector<double> lengths(3 * faces), third(count, 0.0);
        std::fill(normals, normals + count, Point3{0, 0, 0});
        double largest = 0;
        for (int64_t t = 0; t < faces; ++t) {
            const int64_t* v = corners + 3 * t;
            const Point3 a = vertices[v[0]], b = vertices[v[1]], c = vertices[v[2]], twice = cross(b - a, c - a);
            const double size = length(twice) / 6;
            for (int k = 0; k < 3; ++k) {
                third[v[k]] += size;
                normals[v[k]] = normals[v[k]] + twice;
            }
            const Point3 *row = stretch + 3 * t, edges[] = {c - b, a - c, b - a};
            for (int k = 0; k < 3; ++k) {
                const Point3 e = edges[k];
                lengths[3 * t + k] = std::sqrt(dot(e, e) + dot(e, {dot(row[0], e), dot(row[1], e), dot(row[2], e)}));
            }
            largest = std::max({largest, lengths[3 * t], lengths[3 * t + 1], lengths[3 * t + 2]});
        }
        // fourth powers of the ratios of lengths, in the areas, must not underflow
        const double least = std::max(std::pow(kSmallest, 0.2) * largest, kSmallest);
        for (int64_t t = 0; t < faces; ++t) {
            double* side = &lengths[3 * t];
            const double longest = std::max({side[0], side[1], side[2]});
            const double slack = side[0] + side[1] + side[2] - 2 * longest;
            const double more = std::max(kSlack * std::max(longest, least) - slack, 0.0);
            for (int k = 0; k < 3; ++k) side[k] += more;
        }
        assemble(count, faces, lengths.data(), corners, {starts, rows, values});
        Point3 centre{0, 0, 0};  // about the origin, because the areas are differences of squares
        for (int64_t i = 0; i < count; ++i) centre = centre + 1.0 / static_cast<double>(count) * vertices[i];
        for (int64_t i = 0; i < count; ++i) {
            const Point3 x = vertices[i] - centre;
            Point3 gradient{0, 0, 0};
            double of_squares = 0;
            for (int32_t k = starts[i]; k < starts[i + 1]; ++k) {
                const Point3 y = vertices[rows[k]] - centre;
                gradient = gradient + values[k] * y;
                of_squares += values[k] * dot(y, y);
            }
            const double circumcentric = (2 * dot(x, gradient) - of_squares) / 4;
            areas[i] = std::max({circumcentric, least_share * third[i], std::sqrt(kSmallest)});
            const double size = length(normals[i]);
            normals[i] = size > 0 ? 1 / size * normals[i] : Point3{0, 0, 0};
            curvature[i] = dot(gradient, normals[i]) / (2 * areas[i]);
        }
    });
}

// ½ L W (A + ℓ² G) W L among the first `free` of `count` vertices, with the Laplacian L, the areas A, the diagonal weights
// W and ℓ² = `squared_length`. G is not used if that is 0. `rows` and `values` have room for `room` entries. They
// are not set if `starts[free]` is larger.
ENTRY_POINT int bending_stiffness(
    int64_t count, int64_t free, const int32_t* laplacian_starts, const int32_t* laplacian_rows, const double* laplacian,
    const double* weights, const double* areas, double squared_length, const int32_t* form_starts,
    const int32_t* form_rows, const double* form, int64_t room, int32_t* starts, int32_t* rows, double* values) {
    return outcome_of([=] {
        Row half(count), whole(free);
        std::vector<int64_t> first{0}, next(free + 1, 0);  // the entries up to the diagonal, row by row
        std::vector<std::pair<int32_t, double>> lower;
        for (int64_t i = 0; i < free; ++i) {
            for (int32_t a = laplacian_starts[i]; a < laplacian_starts[i + 1]; ++a) {
                const int32_t j = laplacian_rows[a];
                const double slope = laplacian[a] * weights[j];
                if (weights[j] == 0) continue;
                half.add(j, slope * areas[j]);
                if (squared_length == 0) continue;
                for (int32_t b = form_starts[j]; b < form_starts[j + 1]; ++b)
                    if (weights[form_rows[b]] != 0) half.add(form_rows[b], squared_length * slope * form[b]);
            }
            for (const int32_t j : half.columns()) {
                const double factor = 0.5 * half[j] * weights[j];
                for (int32_t a = laplacian_starts[j]; a < laplacian_starts[j + 1] && laplacian_rows[a] <= i; ++a)
                    whole.add(laplacian_rows[a], factor * laplacian[a]);
            }
            whole.sort();
            for (const int32_t j : whole.columns()) {
                lower.emplace_back(j, whole[j]);
                ++next[i + 1];
                if (j < i) ++next[j + 1];
            }
            first.push_back(static_cast<int64_t>(lower.size()));
            half.clear(), whole.clear();
        }
        for (int64_t i = 0; i < free; ++i) next[i + 1] += next[i];
        require_numbers(next[free]);
        for (int64_t i = 0; i <= free; ++i) starts[i] = static_cast<int32_t>(next[i]);
        if (next[free] > room) return;
        for (int64_t i = 0; i < free; ++i)
            for (int64_t k = first[i]; k < first[i + 1]; ++k) {
                const auto [j, value] = lower[k];
                rows[next[i]] = j, values[next[i]++] = value;
                if (j < i) rows[next[j]] = static_cast<int32_t>(i), values[next[j]++] = value;
            }
    });
}

// L W (A + ℓ² G) at the first `free` of `count` vertices, applied to a function: as in `bending_stiffness`.
ENTRY_POINT int bending_residual(
    int64_t count, int64_t free, const int32_t* laplacian_starts, const int32_t* laplacian_rows, const double* laplacian,
    const double* weights, const double* areas, double squared_length, const int32_t* form_starts,
    const int32_t* form_rows, const double* form, const double* function, double* residual) {
    return outcome_of([=] {
        std::vector<double> pull(count, 0.0);
        for (int64_t j = 0; j < count; ++j) {
            if (weights[j] == 0) continue;
            double sum = 0;
            for (int32_t b = form_starts[j]; b < form_starts[j + 1]; ++b) sum += form[b] * function[form_rows[b]];
            pull[j] = weights[j] * (areas[j] * function[j] + squared_length * sum);
        }
        for (int64_t i = 0; i < free; ++i) {
            residual[i] = 0;
            for (int32_t a = laplacian_starts[i]; a < laplacian_starts[i + 1]; ++a)
                residual[i] += laplacian[a] * pull[laplacian_rows[a]];
        }
    });
}
