// Factors L D Lᵀ of symmetric sparse matrices, without pivoting. Called by elimination.py through kernel.py.
//
// A matrix is given by its columns, both halves: the rows of column j are rows[starts[j]] to rows[starts[j + 1] - 1].

#include <algorithm>
#include <cstdint>
#include <vector>

#include "entry.hpp"

namespace {

// Orders the columns by approximate minimum degree (Amestoy, Davis & Duff 1996, An approximate minimum degree ordering
// algorithm), on a quotient graph: an eliminated variable becomes an element, the set of the variables that it joined.
class Ordering {
public:
    Ordering(int32_t n, const int32_t* starts, const int32_t* rows)
        : left_(n), neighbours_(n), elements_(n), variables_(n), mark_(n, -1), seen_(n, -1), beyond_(n, 0), degree_(n, -1),
          first_(n, -1), next_(n, -1), last_(n, -1) {
        for (int32_t j = 0; j < n; ++j) {
            for (int32_t k = starts[j]; k < starts[j + 1]; ++k)
                if (rows[k] != j) neighbours_[j].push_back(rows[k]);
            set_degree(j, static_cast<int32_t>(neighbours_[j].size()));
        }
    }

    void run(int64_t* order) {
        for (int32_t degree = 0; left_; ++degree)
            while (first_[degree] >= 0) {
                const int32_t p = first_[degree];
                order = eliminate(p, order);
                degree = std::max(std::min(degree, least_), 0);
                if (!left_) return;
            }
    }

private:
    // Moves a variable to the list of a degree; to none of degree -1, after its elimination.
    void set_degree(int32_t i, int32_t degree) {
        if (degree == degree_[i]) return;
        if (degree_[i] >= 0) {
            (last_[i] < 0 ? first_[degree_[i]] : next_[last_[i]]) = next_[i];
            if (next_[i] >= 0) last_[next_[i]] = last_[i];
        }
        degree_[i] = degree;
        if (degree < 0) return;
        next_[i] = first_[degree], last_[i] = -1;
        if (next_[i] >= 0) last_[next_[i]] = i;
        first_[degree] = i;
    }

    // Eliminates a variable, and those that then are joined to the same ones.
    int64_t* eliminate(int32_t p, int64_t* order) {
        std::vector<int32_t> joined;
        mark_[p] = p;
        const auto join = [&](int32_t i) {
            if (mark_[i] != p) mark_[i] = p, joined.push_back(i);
        };
        for (const int32_t i : neighbours_[p]) join(i);
        for (const int32_t e : elements_[p]) {
            for (const int32_t i : variables_[e]) join(i);
            variables_[e] = {};  // absorbed
        }
        neighbours_[p] = elements_[p] = {};
        const auto remove = [&](int32_t i) { set_degree(i, -1), --left_, *order++ = i; };
        remove(p);
        // the number of variables of each element near by that are not joined
        for (const int32_t i : joined)
            for (const int32_t e : elements_[i]) {
                if (seen_[e] != p) seen_[e] = p, beyond_[e] = static_cast<int32_t>(variables_[e].size());
                --beyond_[e];
            }
        auto& kept = variables_[p];
        for (const int32_t i : joined) {
            auto& near = neighbours_[i];
            near.erase(std::remove_if(near.begin(), near.end(), [&](int32_t j) { return mark_[j] == p; }), near.end());
            auto& at = elements_[i];
            // an element of joined variables only is absorbed as well
            at.erase(std::remove_if(at.begin(), at.end(), [&](int32_t e) { return variables_[e].empty() || !beyond_[e]; }), at.end());
            if (near.empty() && at.empty()) remove(i);
            else kept.push_back(i);
        }
        const auto others = static_cast<int32_t>(kept.size()) - 1;
        least_ = left_;
        for (const int32_t i : kept) {
            int32_t degree = others + static_cast<int32_t>(neighbours_[i].size());
            for (const int32_t e : elements_[i]) degree += beyond_[e];
            elements_[i].push_back(p);
            degree = std::min({degree, degree_[i] + others, left_ - 1});
            set_degree(i, degree);
            least_ = std::min(least_, degree);
        }
        return order;
    }

    int32_t left_, least_ = 0;
    std::vector<std::vector<int32_t>> neighbours_, elements_;  // of variables
    std::vector<std::vector<int32_t>> variables_;              // of elements
    std::vector<int32_t> mark_, seen_, beyond_;
    std::vector<int32_t> degree_, first_, next_, last_;  // the variables by degree: -1 for none before or after
};

std::vector<int32_t> inverse(int64_t n, const int64_t* order) {
    std::vector<int32_t> place(n);
    for (int64_t k = 0; k < n; ++k) place[order[k]] = static_cast<int32_t>(k);
    return place;
}

}  // namespace

// The order in which the columns are eliminated; the parent of each column, in that order, in the elimination tree, or -1;
// and where the columns of L, without its diagonal, start.
ENTRY_POINT int eliminate(
    int64_t n, const int32_t* starts, const int32_t* rows, int64_t* order, int64_t* parent, int64_t* factor_starts) {
    return outcome_of([=] {
        Ordering(static_cast<int32_t>(n), starts, rows).run(order);
        const std::vector<int32_t> place = inverse(n, order);
        std::vector<int64_t> flag(n), count(n, 0);
        for (int64_t k = 0; k < n; ++k) {
            parent[k] = -1, flag[k] = k;
            for (int32_t e = starts[order[k]]; e < starts[order[k] + 1]; ++e)
                for (int64_t i = place[rows[e]]; i < k && flag[i] != k; i = parent[i]) {
                    if (parent[i] < 0) parent[i] = k;
                    ++count[i], flag[i] = k;
                }
        }
        factor_starts[0] = 0;
        for (int64_t k = 0; k < n; ++k) factor_starts[k + 1] = factor_starts[k] + count[k];
    });
}

// The factors, row by row (Davis 2005, Algorithm 849: a concise sparse Cholesky factorization package). Where a pivot is 0
// the rest of the diagonal is 0.
ENTRY_POINT int factor(
    int64_t n, const int32_t* starts, const int32_t* rows, const double* values, const int64_t* order, const int64_t* parent,
    const int64_t* factor_starts, int32_t* factor_rows, double* factor_values, double* diagonal) {
    return outcome_of([=] {
        const std::vector<int32_t> place = inverse(n, order);
        std::vector<double> row(n, 0.0);
        std::vector<int64_t> flag(n), pattern(n), path(n), filled(factor_starts, factor_starts + n);
        std::fill(diagonal, diagonal + n, 0.0);
        for (int64_t k = 0; k < n; ++k) {
            int64_t top = n;
            flag[k] = k;
            for (int32_t e = starts[order[k]]; e < starts[order[k] + 1]; ++e) {
                int64_t i = place[rows[e]], length = 0;
                if (i > k) continue;
                row[i] += values[e];
                for (; flag[i] != k; i = parent[i]) path[length++] = i, flag[i] = k;
                while (length) pattern[--top] = path[--length];
            }
            double pivot = row[k];
            row[k] = 0;
            for (; top < n; ++top) {
                const int64_t i = pattern[top];
                const double value = row[i], share = value / diagonal[i];
                row[i] = 0;
                for (int64_t e = factor_starts[i]; e < filled[i]; ++e) row[factor_rows[e]] -= factor_values[e] * value;
                pivot -= share * value;
                factor_rows[filled[i]] = static_cast<int32_t>(k), factor_values[filled[i]++] = share;
            }
            if (pivot == 0) return;
            diagonal[k] = pivot;
        }
    });
}

// Replaces `columns` right-hand sides of n numbers, one after the other, by the solutions.
ENTRY_POINT int solve_factored(
    int64_t n, const int64_t* order, const int64_t* factor_starts, const int32_t* factor_rows, const double* factor_values,
    const double* diagonal, int64_t columns, double* sides) {
    return outcome_of([=] {
        std::vector<double> x(n);
        for (int64_t column = 0; column < columns; ++column) {
            double* side = sides + n * column;
            for (int64_t k = 0; k < n; ++k) x[k] = side[order[k]];
            for (int64_t k = 0; k < n; ++k)
                for (int64_t e = factor_starts[k]; e < factor_starts[k + 1]; ++e) x[factor_rows[e]] -= factor_values[e] * x[k];
            for (int64_t k = n - 1; k >= 0; --k) {
                x[k] /= diagonal[k];
                for (int64_t e = factor_starts[k]; e < factor_starts[k + 1]; ++e) x[k] -= factor_values[e] * x[factor_rows[e]];
            }
            for (int64_t k = 0; k < n; ++k) side[order[k]] = x[k];
        }
    });
}
