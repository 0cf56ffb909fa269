// Search tree of points.

#pragma once

#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "point.hpp"

namespace plane {

// Search tree of points, each with a radius.
template <class P>
class Tree {
public:
    Tree() = default;

    Tree(std::vector<P> points, std::vector<double> radii)
        : points_(std::move(points)), radii_(std::move(radii)), order_(points_.size()) {
        require_numbers(order_.size());
        std::iota(order_.begin(), order_.end(), 0);
        if (!order_.empty()) build(0, static_cast<int>(order_.size()));
    }

    // Numbers and squared distances of up to `count` nearest points within `squared`, ascending. Returns the number found.
    int nearest(P p, int count, double squared, int* number, double* distance) const {
        int found = 0;
        if (nodes_.empty()) return 0;
        std::pair<double, int> stack[64];
        int top = 0;
        stack[top++] = {nodes_[0].squared_distance(p), 0};
        while (top) {
            const auto [least, next] = stack[--top];
            if (least > (found < count ? squared : distance[found - 1])) continue;
            const Node& node = nodes_[next];
            if (node.left < 0) {
                for (int k = node.first; k < node.last; ++k) {
                    const int i = order_[k];
                    const double d = dot(points_[i] - p, points_[i] - p);
                    if (d > squared) continue;
                    int at = found;
                    while (at > 0 && (distance[at - 1] > d || (distance[at - 1] == d && number[at - 1] > i))) --at;
                    if (at == count) continue;
                    for (int j = std::min(found, count - 1); j > at; --j) {
                        number[j] = number[j - 1];
                        distance[j] = distance[j - 1];
                    }
                    number[at] = i;
                    distance[at] = d;
                    found = std::min(found + 1, count);
                }
            } else {
                const std::pair left(nodes_[node.left].squared_distance(p), node.left);
                const std::pair right(nodes_[node.right].squared_distance(p), node.right);
                stack[top++] = std::max(left, right);
                stack[top++] = std::min(left, right);
            }
        }
        return found;
    }

    // Whether `accept` holds for any point whose distance from p is less than its radius.
    template <typename Accept>
    bool any_around(P p, Accept accept) const {
        if (nodes_.empty()) return false;
        int stack[64], top = 0;
        stack[top++] = 0;
        while (top) {
            const Node& node = nodes_[stack[--top]];
            if (node.squared_distance(p) > node.radius * node.radius) continue;
            if (node.left >= 0) {
                stack[top++] = node.right;
                stack[top++] = node.left;
                continue;
            }
            for (int k = node.first; k < node.last; ++k) {
                const int i = order_[k];
                if (dot(points_[i] - p, points_[i] - p) < radii_[i] * radii_[i] && accept(i)) return true;
            }
        }
        return false;
    }

private:
    struct Node {
        P lowest, highest;
        double radius;
        int first, last, left, right;

        double squared_distance(P p) const {
            const P outside = high(high(lowest - p, p - highest), kOrigin<P>);
            return dot(outside, outside);
        }
    };

    static constexpr int kLeaf = 8;

    int build(int first, int last) {
        const int at = static_cast<int>(nodes_.size());
        Node node{points_[order_[first]], points_[order_[first]], 0.0, first, last, -1, -1};
        for (int k = first; k < last; ++k) {
            node.lowest = low(node.lowest, points_[order_[k]]);
            node.highest = high(node.highest, points_[order_[k]]);
            if (!radii_.empty()) node.radius = std::max(node.radius, radii_[order_[k]]);
        }
        nodes_.push_back(node);
        if (last - first > kLeaf) {
            const P sides = node.highest - node.lowest;
            int widest = kDimension<P> - 1;
            for (int k = kDimension<P> - 2; k >= 0; --k)
                if (coordinate(sides, k) > coordinate(sides, widest)) widest = k;
            const int middle = (first + last) / 2;
            std::nth_element(order_.begin() + first, order_.begin() + middle, order_.begin() + last, [&](int i, int j) {
                const double a = coordinate(points_[i], widest), b = coordinate(points_[j], widest);
                return a < b || (a == b && i < j);
            });
            const int left = build(first, middle), right = build(middle, last);
            nodes_[at].left = left;
            nodes_[at].right = right;
        }
        return at;
    }

    std::vector<P> points_;
    std::vector<double> radii_;
    std::vector<int> order_;
    std::vector<Node> nodes_;
};

}  // namespace plane
