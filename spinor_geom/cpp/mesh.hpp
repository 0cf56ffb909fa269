// A triangulation that is refined and smoothed.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <queue>
#include <stdexcept>
#include <utility>
#include <vector>

#include "boundary.hpp"
#include "entry.hpp"
#include "triangles.hpp"

namespace geometry {

// a triangle is too large when its circumradius exceeds this times the wanted edge length (equilateral: 1.3 edges)
inline constexpr double kLargestRadius = 0.75;
// share of that radius, by the mean of the sizes at the vertices, above which the size at the centroid is computed
inline constexpr double kDoubtful = 0.8;
// longest inner edge between two boundary vertices, in wanted edge lengths, and the longest one that cuts off one vertex
inline constexpr double kLongestBridge = 1.45, kLongestEar = 1.05;
inline constexpr int kBridgeRounds = 3;
inline constexpr double kRoundEnough = 0.4;  // smoothing must not reduce the roundness (1: equilateral) of triangles below this
inline constexpr int kMoves = 2;  // more do not improve the angles
inline constexpr size_t kLookingAround = 16;  // steps of the time limit: all long edges of the boundary may be near a point
inline constexpr int kLongestWalk = 64;  // triangles after which a walk to a circumcentre counts as blocked

class Mesh : private Triangles {
public:
    Mesh(const Region& region, const SizeField& size, const Boundary& boundary, TimeLimit& limit, Output& output)
        : region_(region),
          size_(size),
          boundary_(boundary),
          limit_(limit),
          output_(output),
          m_(static_cast<int>(region.boundary_size)),
          n_(m_) {
        std::copy(region.boundary, region.boundary + m_, output.points);
        for (int i = 0; i < m_; ++i) wanted_.push_back(size_(region.boundary[i]));
        for (int64_t t = 0; t < output.face_count; ++t) {
            triangles_.emplace_back();
            for (int k = 0; k < 3; ++k) triangles_[t].vertex[k] = static_cast<int>(output.faces[3 * t + k]);
        }
        connect();
        stamp_.assign(triangles_.size(), 0);
        version_.assign(triangles_.size(), 0);
    }

    // Inserts points by levels, the coarse ones first, so that walks and cavities stay short.
    void insert_all(const std::vector<Point>& points) {
        size_t stride = 1;
        while (stride * 16 < points.size()) stride *= 4;
        int at = 0;
        for (size_t before = 0; stride; before = stride, stride /= 4)
            for (size_t k = 0; k < points.size() && n_ < m_ + output_.most_points; k += stride)
                if (!before || k % before) {
                    if (limit_.is_over()) return;
                    const int t = containing(points[k], at);
                    if (t >= 0 && insert(points[k], t, 0)) at = static_cast<int>(triangles_.size()) - 1;
                }
    }

    // Inserts circumcentres, of the largest triangles first, until no triangle is poor, except where there is no room.
    void refine() {
        for (int t = 0; t < static_cast<int>(triangles_.size()); ++t) enqueue(t);
        is_refining_ = true;
        while (!queue_.empty()) {
            const Poor poor = queue_.top();
            queue_.pop();
            const bool is_over = limit_.is_over(kLookingAround);
            const bool is_current = version_[poor.triangle] == poor.version;
            if (!is_over && !(is_current && is_poor(poor) && !boundary_.too_near(poor.centre))) continue;
            if (is_over || n_ >= m_ + output_.most_points) {
                output_.is_complete = false;
                break;
            }
            const int t = walk(poor.centre, poor.triangle, kLongestWalk);
            if (t >= 0) insert(poor.centre, t, 0);
        }
        is_refining_ = false;
    }

    // Splits long inner edges between boundary vertices where there is room.
    void split_long_bridges() {
        struct Bridge {
            double length;
            int triangle, start, end;
            Point place;
        };
        for (int round = 0; round < kBridgeRounds; ++round) {
            std::vector<Bridge> bridges;
            for (int t = 0; t < static_cast<int>(triangles_.size()); ++t)
                for (int k = 0; k < 3; ++k) {
                    const Triangle& triangle = triangles_[t];
                    const int a = triangle.vertex[k], b = triangle.vertex[(k + 1) % 3], across = triangle.across[k];
                    if (across < t || a >= m_ || b >= m_) continue;
                    // an ear cuts off a single convex vertex: it is split sooner, and its point lies farther inside
                    const int here = triangle.vertex[(k + 2) % 3], there = opposite(across, t);
                    const int start = std::min(a, b), end = std::max(a, b);
                    const bool is_next = region_.after[region_.after[start]] == end;
                    const bool is_last = region_.after[region_.after[end]] == start;
                    const bool is_ear = (is_next || is_last) && (here < m_) != (there < m_);
                    const Point tip = point(static_cast<int>(region_.after[is_next ? start : end]));
                    const Point middle = 0.5 * (point(a) + point(b));
                    const double distance = length(point(b) - point(a));
                    if (distance > (is_ear ? kLongestEar : kLongestBridge) * size_(middle))
                        bridges.push_back({distance, t, start, end, is_ear ? tip + 1.1 * (middle - tip) : middle});
                }
            std::sort(bridges.begin(), bridges.end(), [](const Bridge& a, const Bridge& b) {
                return std::pair(-a.length, std::pair(a.start, a.end)) < std::pair(-b.length, std::pair(b.start, b.end));
            });
            const int before = n_;
            for (const Bridge& bridge : bridges) {
                if (limit_.is_over()) return;
                // the output has room for as many points beside bridges as the boundary has
                if (n_ == m_ + output_.most_points + m_ || boundary_.too_near(bridge.place)) continue;
                const int t = containing(bridge.place, bridge.triangle);
                if (t >= 0) insert(bridge.place, t, 0.4 * bridge.length);
            }
            if (n_ == before) break;
        }
    }

    // Moves inner points to the mean of their neighbours, and flips edges until the triangulation is Delaunay. Points
    // stay if they would be too near to the boundary, or would flip a triangle or make it thin.
    void smooth() {
        if (n_ == m_) return;
        for (int round = 0; round < kMoves && !limit_.is_over(triangles_.size()); ++round) {
            std::vector<Point> moved(n_, Point{0, 0});
            std::vector<int> degree(n_, 0);
            for (const Triangle& t : triangles_)
                for (int k = 0; k < 3; ++k) {
                    const int a = t.vertex[k], b = t.vertex[(k + 1) % 3];
                    moved[a] = moved[a] + point(b);
                    ++degree[a];
                }
            for (int i = 0; i < n_; ++i) {
                moved[i] = i < m_ ? point(i) : (1.0 / degree[i]) * moved[i];
                if (i >= m_ && boundary_.too_near(moved[i])) moved[i] = point(i);
            }
            if (!hold_back(moved)) break;
            std::copy(moved.begin(), moved.end(), output_.points);
        }
        flip_all();
    }

    // Moves inner points of triangles with an angle below 25 degrees to the best of a few places nearby.
    void polish() {
        for (const double step : kPolishing) {
            if (limit_.is_over(triangles_.size())) return;
            const std::vector<std::vector<std::pair<int, int>>> stars = worst_stars();
            if (stars.empty()) break;
            for (const auto& star : stars) {
                const int vertex = triangles_[star[0].first].vertex[star[0].second];
                double reach = 0;
                Point mean{0, 0};
                for (const auto& [t, k] : star) {
                    const Point p = point(triangles_[t].vertex[(k + 1) % 3]);
                    reach += length(p - point(vertex)) / static_cast<double>(star.size());
                    mean = mean + (1.0 / static_cast<double>(star.size())) * p;
                }
                Point best = point(vertex);
                double highest = least_sine(star, best);
                for (int place = 0; place <= kAround; ++place) {
                    const double angle = 2 * kPi * place / kAround;
                    const Point around = point(vertex) + step * reach * Point{std::cos(angle), std::sin(angle)};
                    const Point p = place < kAround ? around : mean;
                    const double sine = least_sine(star, p);
                    if (sine > highest && !boundary_.too_near(p)) best = p, highest = sine;
                }
                output_.points[vertex] = best;
            }
            flip_all();
        }
    }

    void write() const {
        output_.point_count = n_;
        output_.face_count = static_cast<int64_t>(triangles_.size());
        for (size_t t = 0; t < triangles_.size(); ++t)
            for (int k = 0; k < 3; ++k) output_.faces[3 * t + k] = triangles_[t].vertex[k];
    }

private:
    struct Poor {
        double excess, radius;
        int triangle, version;
        bool is_thin;
        Point centre;

        bool operator<(const Poor& other) const {
            return std::pair(excess, triangle) < std::pair(other.excess, other.triangle);
        }
    };

    Point point(int i) const { return output_.points[i]; }

    // The triangle that contains p, reached on a straight walk inside the region, or -1 if the walk leaves it.
    int walk(Point p, int t, size_t most_steps) const {
        for (size_t step = 0; step < most_steps; ++step) {
            int way_out = 0;
            double least = kInfinity;
            for (int k = 0; k < 3; ++k) {
                const double s = side(point(triangles_[t].vertex[k]), point(triangles_[t].vertex[(k + 1) % 3]), p);
                if (s < least) least = s, way_out = k;
            }
            if (least >= 0) return t;
            t = triangles_[t].across[way_out];
            if (t < 0) return -1;
        }
        return -1;
    }

    // The triangle that contains p, or -1 if p is outside.
    int containing(Point p, int from) {
        const int found = walk(p, from, triangles_.size());
        if (found >= 0 || limit_.is_over(triangles_.size()) || !boundary_.is_inside(p)) return found;
        for (int t = 0; t < static_cast<int>(triangles_.size()); ++t) {
            const auto& v = triangles_[t].vertex;
            if (side(point(v[0]), point(v[1]), p) >= 0 && side(point(v[1]), point(v[2]), p) >= 0 &&
                side(point(v[2]), point(v[0]), p) >= 0)
                return t;
        }
        return -1;
    }

    struct Edge {
        int start, end, across;
    };

    // Inserts p, which lies in a triangle, unless a vertex that it sees is nearer than `apart` (Bowyer and Watson).
    bool insert(Point p, int within, double apart) {
        ++round_;
        cavity_.assign(1, within);
        stamp_[within] = round_;
        rim_.clear();
        for (size_t next = 0; next < cavity_.size(); ++next) {
            const Triangle& t = triangles_[cavity_[next]];
            for (int k = 0; k < 3; ++k) {
                const int other = t.across[k];
                if (other >= 0 && stamp_[other] == round_) continue;
                const bool sees = side(point(t.vertex[k]), point(t.vertex[(k + 1) % 3]), p) > 0;
                if (other < 0) {
                    if (!sees) return false;
                    continue;
                }
                const auto& v = triangles_[other].vertex;
                if (!sees || in_circle(point(v[0]), point(v[1]), point(v[2]), p)) {
                    stamp_[other] = round_;
                    cavity_.push_back(other);
                }
            }
        }
        for (const int own : cavity_) {
            const Triangle& t = triangles_[own];
            for (int k = 0; k < 3; ++k) {
                const int a = t.vertex[k], b = t.vertex[(k + 1) % 3];
                if (t.across[k] >= 0 && stamp_[t.across[k]] == round_) continue;
                if (side(point(a), point(b), p) <= 0 || length(point(a) - p) <= apart) return false;
                rim_.push_back({a, b, t.across[k]});
            }
        }
        // a cavity with a hole, or a vertex inside, would lose a vertex
        if (rim_.size() != cavity_.size() + 2) return false;
        output_.points[n_] = p;
        wanted_.push_back(size_(p));
        while (cavity_.size() < rim_.size()) {
            cavity_.push_back(static_cast<int>(triangles_.size()));
            triangles_.emplace_back();
            stamp_.push_back(0);
            version_.push_back(0);
        }
        starting_.resize(n_ + 1);
        for (size_t k = 0; k < rim_.size(); ++k) {
            const int t = cavity_[k];
            triangles_[t] = {{rim_[k].start, rim_[k].end, n_}, {rim_[k].across, -1, -1}};
            starting_[rim_[k].start] = t;
            if (rim_[k].across >= 0) {
                Triangle& other = triangles_[rim_[k].across];
                for (int j = 0; j < 3; ++j)
                    if (other.vertex[j] == rim_[k].end) other.across[j] = t;
            }
        }
        for (size_t k = 0; k < rim_.size(); ++k) {
            const int t = cavity_[k], next = starting_[rim_[k].end];
            triangles_[t].across[1] = next;
            triangles_[next].across[2] = t;
        }
        ++n_;
        if (is_refining_)
            for (size_t k = 0; k < rim_.size(); ++k) {
                ++version_[cavity_[k]];
                enqueue(cavity_[k]);
            }
        return true;
    }

    // Adds a triangle to the queue if it may be too large, by the sizes at its vertices, or has too small an angle.
    void enqueue(int t) {
        const auto& v = triangles_[t].vertex;
        const Point a = point(v[0]), b = point(v[1]) - a, c = point(v[2]) - a;
        const double bb = dot(b, b), cc = dot(c, c);
        // a flat triangle gets a huge circle instead of a division by zero
        const double twice = std::max(2 * cross(b, c), std::sqrt(kTiny));
        const Point offset{(c.y * bb - b.y * cc) / twice, (b.x * cc - c.x * bb) / twice};
        const double radius = length(offset);
        const double shortest = std::sqrt(std::min({bb, cc, dot(c - b, c - b)}));
        const double excess = radius / (kLargestRadius * (wanted_[v[0]] + wanted_[v[1]] + wanted_[v[2]]) / 3);
        const bool is_thin = shortest < 2 * radius * kLeastSine;
        if (excess > kDoubtful || is_thin) queue_.push({excess, radius, t, version_[t], is_thin, a + offset});
    }

    // Whether a triangle is thin, or too large by the size at its centroid.
    bool is_poor(const Poor& poor) const {
        const auto& v = triangles_[poor.triangle].vertex;
        return poor.is_thin ||
               poor.radius > kLargestRadius * size_((1.0 / 3) * (point(v[0]) + point(v[1]) + point(v[2])));
    }

    // Puts back the corners of triangles that a move would flip or make thin. Returns whether all others can move.
    bool hold_back(std::vector<Point>& moved) const {
        for (int round = 0; round < 10; ++round) {
            std::vector<int> back;
            for (const Triangle& t : triangles_) {
                const auto& v = t.vertex;
                const double after = roundness(moved[v[0]], moved[v[1]], moved[v[2]]);
                if (after < kRoundEnough && after < roundness(point(v[0]), point(v[1]), point(v[2])))
                    back.insert(back.end(), v.begin(), v.end());
            }
            if (back.empty()) return true;
            for (const int i : back) moved[i] = point(i);
        }
        return false;
    }

    double least_sine(const std::vector<std::pair<int, int>>& star, Point p) const {
        double least = kInfinity;
        for (const auto& [t, k] : star) {
            const auto& v = triangles_[t].vertex;
            least = std::min(least, smallest_sine(p, point(v[(k + 1) % 3]), point(v[(k + 2) % 3])));
        }
        return least;
    }

    // For inner points of poor triangles that are worse than all their neighbours, so that they can move independently:
    // the triangles around each, and its place in them.
    std::vector<std::vector<std::pair<int, int>>> worst_stars() const {
        std::vector<double> key(n_, kInfinity);
        for (const Triangle& t : triangles_) {
            const double sine = smallest_sine(point(t.vertex[0]), point(t.vertex[1]), point(t.vertex[2]));
            if (sine >= kLeastSine) continue;
            for (const int i : t.vertex)
                if (i >= m_) key[i] = std::min(key[i], sine);
        }
        std::vector<int> number(n_, 0);
        const auto is_worse = [&](int a, int b) { return std::pair(key[a], a) < std::pair(key[b], b); };
        for (const Triangle& t : triangles_)
            for (int k = 0; k < 3; ++k) {
                const int a = t.vertex[k], b = t.vertex[(k + 1) % 3];
                number[is_worse(a, b) ? b : a] = -1;
            }
        int count = 0;
        for (int i = 0; i < n_; ++i) number[i] = number[i] == 0 && key[i] < kInfinity ? ++count : 0;
        std::vector<std::vector<std::pair<int, int>>> stars(count);
        for (int t = 0; t < static_cast<int>(triangles_.size()); ++t)
            for (int k = 0; k < 3; ++k)
                if (number[triangles_[t].vertex[k]]) stars[number[triangles_[t].vertex[k]] - 1].emplace_back(t, k);
        return stars;
    }

    // Flips inner edges until each is locally Delaunay.
    void flip_all() {
        std::vector<int> stack(triangles_.size());
        std::iota(stack.begin(), stack.end(), 0);
        // rounding could make cocircular points flip for ever
        for (size_t left = 100 * triangles_.size(); !stack.empty() && left && !limit_.is_over(); --left) {
            const int t = stack.back();
            stack.pop_back();
            for (int k = 0; k < 3; ++k)
                if (const int other = flipped(t, k); other >= 0) {
                    stack.push_back(t);
                    stack.push_back(other);
                    break;
                }
        }
    }

    // Flips edge k of a triangle if it is not Delaunay and the two new triangles are counter-clockwise. Returns the other
    // triangle, or -1 if the edge stays.
    int flipped(int t, int k) {
        const int other = triangles_[t].across[k];
        if (other < 0) return -1;
        const int a = triangles_[t].vertex[k], b = triangles_[t].vertex[(k + 1) % 3], c = triangles_[t].vertex[(k + 2) % 3];
        const int d = triangles_[other].vertex[(side_of(t, k) + 2) % 3];
        if (!in_circle(point(a), point(b), point(c), point(d))) return -1;
        if (side(point(a), point(d), point(c)) <= 0 || side(point(d), point(b), point(c)) <= 0) return -1;
        flip(t, k);
        return other;
    }

    const Region& region_;
    const SizeField& size_;
    const Boundary& boundary_;
    TimeLimit& limit_;
    Output& output_;
    int m_, n_;
    bool is_refining_ = false;
    int round_ = 0;
    std::vector<double> wanted_;  // edge lengths at the points
    std::vector<int> stamp_, version_, cavity_, starting_;
    std::vector<Edge> rim_;
    std::priority_queue<Poor> queue_;
};

}  // namespace geometry
