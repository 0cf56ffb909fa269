// Segments in space near each other, and near points. Called by near_edges.py through kernel.py.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "entry.hpp"
#include "tree.hpp"

namespace {

using namespace geometry;

constexpr double kParallel = 1e-7;  // rounding of distances of nearly parallel segments, per length
constexpr double kSlack = 1e-12;    // of distances of points, per length

struct Segment {
    Point3 start, along;
    double squared;  // its squared length
};

// Share of a segment at which it is nearest to a point, at `offset` from its start.
double nearest(const Segment& s, Point3 offset) {
    return s.squared > 0 ? std::clamp(dot(offset, s.along) / s.squared, 0.0, 1.0) : 0.0;
}

// Squared distance of two segments from each other.
double squared_distance(const Segment& s, const Segment& t) {
    const Point3 between = t.start - s.start;
    const auto apart = [&](double share, double other) {
        const Point3 d = between + other * t.along - share * s.along;
        return dot(d, d);
    };
    const double product = dot(s.along, t.along), determinant = s.squared * t.squared - product * product;
    double least = kInfinity;
    if (determinant > 0) {
        const double b = dot(between, s.along), e = dot(between, t.along);
        const double share = std::clamp((b * t.squared - e * product) / determinant, 0.0, 1.0);
        const double other = std::clamp((b * product - e * s.squared) / determinant, 0.0, 1.0);
        least = apart(share, other);
    }
    // the nearest points are inside both, or one of them is an end
    for (const double end : {0.0, 1.0}) {
        const Point3 from_s = between + end * t.along, from_t = end * s.along - between;
        least = std::min({least, apart(nearest(s, from_s), end), apart(end, nearest(t, from_t))});
    }
    return least;
}

}  // namespace

// Pairs i < j of `count` segments at most `distance` from each other, and some that are farther apart by less than
// rounding. `pairs` is filled with those of i = first, first + 1, ..., as far as all pairs of the last i fit. Its length
// is `room` >= count. `done` becomes the number of pairs and the next `first`.
ENTRY_POINT int near_segments(
    int64_t count, const Point3* starts, const Point3* ends, double distance, int64_t first, int64_t room,
    double seconds, int64_t* pairs, int64_t* done) {
    return outcome_of([=] {
        TimeLimit limit(seconds);
        std::vector<Segment> segments;
        std::vector<Box> boxes;
        const Point3 margin = 0.5 * Point3{distance, distance, distance};
        for (int64_t i = 0; i < count; ++i) {
            const Point3 along = ends[i] - starts[i];
            segments.push_back({starts[i], along, dot(along, along)});
            const Box own(starts[i], ends[i]);
            boxes.emplace_back(own.low - margin, own.high + margin);
        }
        BoxTree tree(boxes);
        done[0] = 0;
        for (done[1] = first; done[1] < count && done[0] + count - done[1] <= room; ++done[1]) {
            const Segment& s = segments[done[1]];
            tree.each_after(done[1], limit, [&](int64_t j) {
                const Segment& t = segments[j];
                const double reach = distance + kParallel * std::sqrt(std::max(s.squared, t.squared));
                if (squared_distance(s, t) > reach * reach) return;
                pairs[2 * done[0]] = done[1];
                pairs[2 * done[0] + 1] = j;
                ++done[0];
            });
        }
    });
}

// Pairs of one of `count` segments and one of `point_count` points that is at most its radius from it, and some that are
// farther away by less than rounding. `pairs` and `done` are as above, with `room` >= point_count.
ENTRY_POINT int near_points(
    int64_t count, const Point3* starts, const Point3* ends, int64_t point_count, const Point3* points, const double* radii,
    int64_t first, int64_t room, double seconds, int64_t* pairs, int64_t* done) {
    return outcome_of([=] {
        TimeLimit limit(seconds);
        const Tree<Point3> tree({points, points + point_count}, {radii, radii + point_count});
        done[0] = 0;
        for (done[1] = first; done[1] < count && done[0] + point_count <= room; ++done[1]) {
            const Point3 along = ends[done[1]] - starts[done[1]];
            tree.each_along(starts[done[1]], along, kSlack * length(along), limit, [&](int64_t j) {
                pairs[2 * done[0]] = done[1];
                pairs[2 * done[0] + 1] = j;
                ++done[0];
            });
        }
    });
}
