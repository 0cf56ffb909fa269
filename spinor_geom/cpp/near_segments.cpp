// Pairs of segments in space that are near each other. Called by near_edges.py through kernel.py.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "entry.hpp"

namespace {

using Vector = std::array<double, 3>;

Vector operator-(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

struct Segment {
    Vector start, along;
    double squared;  // its squared length
};

struct Box {
    Vector low, high;

    bool meets(const Box& other) const {
        for (int k = 0; k < 3; ++k)
            if (low[k] > other.high[k] || other.low[k] > high[k]) return false;
        return true;
    }
};

// Share of a segment at which it is nearest to a point, at `offset` from its start.
double nearest(const Segment& s, const Vector& offset) {
    return s.squared > 0 ? std::clamp(dot(offset, s.along) / s.squared, 0.0, 1.0) : 0.0;
}

// Squared distance of two segments from each other.
double squared_distance(const Segment& s, const Segment& t) {
    const Vector between = t.start - s.start;
    const auto apart = [&](double share, double other) {
        Vector d;
        for (int k = 0; k < 3; ++k) d[k] = between[k] + other * t.along[k] - share * s.along[k];
        return dot(d, d);
    };
    const double product = dot(s.along, t.along), determinant = s.squared * t.squared - product * product;
    double least = std::numeric_limits<double>::infinity();
    if (determinant > 0) {
        const double b = dot(between, s.along), e = dot(between, t.along);
        const double share = std::clamp((b * t.squared - e * product) / determinant, 0.0, 1.0);
        const double other = std::clamp((b * product - e * s.squared) / determinant, 0.0, 1.0);
        least = apart(share, other);
    }
    // the nearest points are inside both, or one of them is an end
    for (const double end : {0.0, 1.0}) {
        Vector from_s, from_t;
        for (int k = 0; k < 3; ++k) {
            from_s[k] = between[k] + end * t.along[k];
            from_t[k] = end * s.along[k] - between[k];
        }
        least = std::min({least, apart(nearest(s, from_s), end), apart(end, nearest(t, from_t))});
    }
    return least;
}

}  // namespace

// Pairs i < j of `count` segments at most `distance` from each other, and some that are farther apart by less than
// rounding. `pairs` is filled with those of i = first, first + 1, ..., as far as all pairs of the last i fit. Its length
// is `room` >= count. `done` becomes the number of pairs and the next `first`.
ENTRY_POINT int near_segments(
    int64_t count, const double* starts, const double* ends, double distance, int64_t first, int64_t room,
    double seconds, int64_t* pairs, int64_t* done) {
    return outcome_of([=] {
        TimeLimit limit(seconds);
        std::vector<Segment> segments(static_cast<size_t>(count));
        // node k of the tree of boxes has the children 2k and 2k + 1. The last nodes are those of the segments
        size_t leaves = 1;
        while (leaves < segments.size()) leaves *= 2;
        constexpr double most = std::numeric_limits<double>::infinity();
        std::vector<Box> boxes(2 * leaves, Box{{most, most, most}, {-most, -most, -most}});
        for (size_t i = 0; i < segments.size(); ++i) {
            Segment& s = segments[i];
            Vector end;
            for (int k = 0; k < 3; ++k) {
                s.start[k] = starts[3 * i + k];
                end[k] = ends[3 * i + k];
                boxes[leaves + i].low[k] = std::min(s.start[k], end[k]) - 0.5 * distance;
                boxes[leaves + i].high[k] = std::max(s.start[k], end[k]) + 0.5 * distance;
            }
            s.along = end - s.start;
            s.squared = dot(s.along, s.along);
        }
        for (size_t node = leaves - 1; node > 0; --node)
            for (int k = 0; k < 3; ++k) {
                boxes[node].low[k] = std::min(boxes[2 * node].low[k], boxes[2 * node + 1].low[k]);
                boxes[node].high[k] = std::max(boxes[2 * node].high[k], boxes[2 * node + 1].high[k]);
            }
        constexpr double rounding = 1e-7;  // of distances of nearly parallel segments, per length
        done[0] = 0;
        std::vector<size_t> stack;
        for (done[1] = first; done[1] < count && done[0] + count - done[1] <= room; ++done[1]) {
            const size_t i = static_cast<size_t>(done[1]);
            // the segments after i, in order: those below the right siblings of its ancestors
            for (size_t ancestor = leaves + i; ancestor > 1; ancestor /= 2)
                if (ancestor % 2 == 0) stack.insert(stack.begin(), ancestor + 1);
            while (!stack.empty()) {
                const size_t node = stack.back();
                stack.pop_back();
                limit.require_time();
                if (!boxes[node].meets(boxes[leaves + i])) continue;
                if (node < leaves) {
                    stack.push_back(2 * node + 1);
                    stack.push_back(2 * node);
                    continue;
                }
                const Segment &s = segments[i], &t = segments[node - leaves];
                const double reach = distance + rounding * std::sqrt(std::max(s.squared, t.squared));
                if (squared_distance(s, t) > reach * reach) continue;
                pairs[2 * done[0]] = done[1];
                pairs[2 * done[0] + 1] = static_cast<int64_t>(node - leaves);
                ++done[0];
            }
        }
    });
}
