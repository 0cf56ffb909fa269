// Regions, and the edge lengths wanted in them.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "tree.hpp"

namespace geometry {

// What Python passes (see `SizeField` and `triangulate_polygon` there).
template <class P>
struct RegionOf {
    int64_t boundary_size;
    const P* boundary;
    const int64_t* after;  // the next vertex on its polygon
    double growth, decay;
    int64_t sample_count;
    const P* samples;
    const double* log_lengths;  // wanted at the samples
    int64_t neighbours;         // samples of which the mean is taken
};
using Region = RegionOf<Point>;

struct Seeds {
    int64_t count;  // -1: a lattice
    const Point* points;
    const double* spacing;
};

struct Output {
    int64_t most_points;  // inner ones
    Point* points;
    int64_t* faces;
    int64_t &point_count, &face_count;
    int64_t& is_complete;  // 0 if the limit on points or on time ended the refinement
};

inline constexpr int kMostNeighbours = 8;

template <class P>
class SizeFieldOf {
public:
    explicit SizeFieldOf(const RegionOf<P>& region) : region_(region), own_(region.boundary_size) {
        const int64_t m = region.boundary_size;
        std::vector<P> boundary(region.boundary, region.boundary + m);
        for (int64_t i = 0; i < m; ++i) {
            const double half = 0.5 * length(boundary[region.after[i]] - boundary[i]);
            own_[i] += half;
            own_[region.after[i]] += half;
        }
        boundary_ = Tree<P>(std::move(boundary), {});
        samples_ = Tree<P>({region.samples, region.samples + region.sample_count}, {});
        local_ = own_;
        int number[kMostNeighbours];
        double squared[kMostNeighbours];
        std::vector<std::pair<int, double>> near;
        std::vector<int> start{0};
        for (int64_t i = 0; i < m; ++i) {
            const int found = boundary_.nearest(region.boundary[i], kMostNeighbours, kInfinity, number, squared);
            for (int k = 0; k < found; ++k) near.emplace_back(number[k], region.growth * std::sqrt(squared[k]));
            start.push_back(static_cast<int>(near.size()));
        }
        for (int round = 0; round < 4; ++round) {
            const std::vector<double> before = local_;
            for (int64_t i = 0; i < m; ++i)
                for (int k = start[i]; k < start[i + 1]; ++k)
                    local_[i] = std::min(local_[i], before[near[k].first] + near[k].second);
        }
        least_ = *std::min_element(local_.begin(), local_.end());
        most_ = *std::max_element(own_.begin(), own_.end());
    }

    // Mean length of the two edges at a boundary vertex.
    double own(int64_t vertex) const { return own_[vertex]; }

    // Distance from the nearest boundary vertex, and its number.
    std::pair<double, int> nearest_vertex(P p) const {
        int number;
        double squared;
        boundary_.nearest(p, 1, kInfinity, &number, &squared);
        return {std::sqrt(squared), number};
    }

    double operator()(P p) const {
        int number[kMostNeighbours];
        double squared[kMostNeighbours], wanted = kInfinity;
        if (region_.sample_count) {
            const int found =
                samples_.nearest(p, static_cast<int>(region_.neighbours), kInfinity, number, squared);
            double sum = 0, total = 0;
            for (int k = 0; k < found; ++k) {
                const double weight = 1 / std::max(squared[k], kTiny);
                sum += weight * region_.log_lengths[number[k]];
                total += weight;
            }
            wanted = std::exp(sum / total);
        }
        // Farther from the boundary the bounds have no effect. In the middle of a disk all vertices are equally far, and
        // the search for the nearest ones would visit them all.
        double far = (wanted - least_) / region_.growth;
        if (region_.decay < kInfinity) far = std::max(far, (most_ - wanted) / region_.decay);
        const int found = boundary_.nearest(p, 3, far * far, number, squared);
        if (found && region_.decay < kInfinity)
            wanted = std::max(wanted, own_[number[0]] - region_.decay * std::sqrt(squared[0]));
        for (int k = 0; k < found; ++k)
            wanted = std::min(wanted, local_[number[k]] + region_.growth * std::sqrt(squared[k]));
        return wanted;
    }

private:
    const RegionOf<P>& region_;
    std::vector<double> own_, local_;
    double least_ = 0, most_ = 0;
    Tree<P> boundary_, samples_;
};
using SizeField = SizeFieldOf<Point>;

}  // namespace geometry
