// Half-edges grouped by edge, and components of graphs. Called by topology.py through kernel.py.

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

#include "entry.hpp"

// The half-edges 3f + k, from corner k of face f to the next one, in the order of their lower, then of their higher ends,
// then of their numbers. Those of edge e begin at starts[e]; `edge_count` becomes the number of edges. `starts` has room for
// 3 faces + 1.
ENTRY_POINT int group_half_edges(
    int64_t faces, const int64_t* corners, int64_t vertices, int64_t* order, int64_t* starts, int64_t* edge_count) {
    return outcome_of([=] {
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
        *edge_count = 0;
        for (int64_t v = 0; v < vertices; ++v) {
            std::sort(found.begin() + first[v], found.begin() + first[v + 1]);
            for (int64_t k = first[v]; k < first[v + 1]; ++k) {
                order[k] = found[k].second;
                if (k == first[v] || found[k].first != found[k - 1].first) starts[(*edge_count)++] = k;
            }
        }
        starts[*edge_count] = count;
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
