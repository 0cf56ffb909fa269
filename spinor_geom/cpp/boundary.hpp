// The boundary of a region.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <stdexcept>
#include <vector>

#include "entry.hpp"
#include "size_field.hpp"

namespace geometry {

// a boundary edge subtends at most 110 degrees at new points. 90 would leave no room beside short edges next to long ones
const double kWidestView = std::cos((180 - 110) * kPi / 180);

// The edges of the boundary, and tests of points against them.
class Boundary {
public:
    explicit Boundary(const Region& region) : region_(region), low_(kInfinity), high_(-kInfinity) {
        const int64_t m = region.boundary_size;
        std::vector<Point> centres(m);
        std::vector<double> radii(m);
        for (int64_t i = 0; i < m; ++i) {
            const Point a = start(i), b = end(i);
            centres[i] = 0.5 * (a + b);
            // an edge subtends a right angle on the circle of which it is a diameter, and larger angles inside
            radii[i] = 0.5 * length(b - a);
            low_ = std::min(low_, a.y);
            high_ = std::max(high_, a.y);
        }
        if (!(high_ > low_)) throw std::invalid_argument("a boundary without height");
        tree_ = Tree<Point>(std::move(centres), std::move(radii));
        // The edges that each of some horizontal strips meets: m strips, or fewer where edges are as high as many of
        // them, so that there are at most 4m more entries than edges.
        double rise = 0;
        for (int64_t i = 0; i < m; ++i) rise += std::abs(end(i).y - start(i).y);
        strips_ = static_cast<int64_t>(std::clamp(4 * m * (high_ - low_) / rise, 1.0, static_cast<double>(m)));
        first_.assign(strips_ + 1, 0);
        for (int round = 0; round < 2; ++round) {
            for (int64_t i = 0; i < m; ++i) {
                const double a = start(i).y, b = end(i).y;
                for (int64_t k = strip(std::min(a, b)); k <= strip(std::max(a, b)); ++k)
                    if (round) edges_[first_[k] + filled_[k]++] = i;
                    else ++first_[k + 1];
            }
            if (!round) {
                std::partial_sum(first_.begin(), first_.end(), first_.begin());
                edges_.resize(first_[strips_]);
                filled_.assign(strips_, 0);
            }
        }
    }

    Point start(int64_t edge) const { return region_.boundary[edge]; }
    Point end(int64_t edge) const { return region_.boundary[region_.after[edge]]; }

    // Whether an edge subtends too large an angle at p.
    bool too_near(Point p) const {
        return tree_.any_around(p, [&](int64_t edge) {
            const Point a = start(edge) - p, b = end(edge) - p;
            return dot(a, b) < -kWidestView * std::sqrt(dot(a, a) * dot(b, b));
        });
    }

    // Whether p is inside: the ray to its right crosses an odd number of edges.
    bool is_inside(Point p) const {
        if (!(p.y >= low_ && p.y < high_)) return false;
        bool inside = false;
        const int64_t k = strip(p.y);
        for (int64_t j = first_[k]; j < first_[k + 1]; ++j) {
            const Point a = start(edges_[j]), b = end(edges_[j]);
            if ((a.y <= p.y) == (b.y <= p.y)) continue;
            if ((side(a, b, p) > 0) == (b.y > a.y)) inside = !inside;
        }
        return inside;
    }

    // Number of edges that `is_inside` looks at.
    size_t strip_size(Point p) const {
        const int64_t k = strip(p.y);
        return static_cast<size_t>(first_[k + 1] - first_[k]);
    }

    bool has_room(Point p) const { return is_inside(p) && !too_near(p); }

    double area() const {
        double twice = 0;
        for (int64_t i = 0; i < region_.boundary_size; ++i) twice += cross(start(i), end(i));
        return 0.5 * twice;
    }

    double perimeter() const {
        double sum = 0;
        for (int64_t i = 0; i < region_.boundary_size; ++i) sum += length(end(i) - start(i));
        return sum;
    }

    // Points inside of the triangular lattice with rows along the x-axis. There are fewer rows if the time is over.
    std::vector<Point> lattice(double spacing, TimeLimit& limit) const {
        std::vector<Point> points;
        std::vector<double> crossings;
        const double height = std::sqrt(0.75) * spacing;
        for (double row = std::ceil(low_ / height); row * height < high_; ++row) {
            const double y = row * height;
            const int64_t k = strip(y);
            if (limit.is_over(strip_size({0, y}))) break;
            crossings.clear();
            for (int64_t j = first_[k]; j < first_[k + 1]; ++j) {
                const Point a = start(edges_[j]), b = end(edges_[j]);
                if ((a.y <= y) != (b.y <= y)) crossings.push_back(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
            }
            std::sort(crossings.begin(), crossings.end());
            const double shift = std::fmod(std::abs(row), 2) * 0.5;
            for (size_t j = 0; j + 1 < crossings.size(); j += 2)
                for (double x = std::ceil(crossings[j] / spacing - shift) + shift; x * spacing < crossings[j + 1]; ++x)
                    points.push_back({x * spacing, y});
        }
        return points;
    }

private:
    int64_t strip(double y) const {
        const double count = static_cast<double>(strips_);
        return static_cast<int64_t>(std::clamp(std::floor((y - low_) / (high_ - low_) * count), 0.0, count - 1));
    }

    const Region& region_;
    double low_, high_;
    Tree<Point> tree_;
    int64_t strips_;
    std::vector<int64_t> first_, filled_, edges_;
};

}  // namespace geometry
