// Search trees of points and of boxes.

#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <utility>
#include <vector>

#include "entry.hpp"
#include "point.hpp"

namespace geometry {

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
        // the points of a node side by side in memory
        points_ = in_order(points_);
        if (!radii_.empty()) radii_ = in_order(radii_);
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
                    const double d = dot(points_[k] - p, points_[k] - p);
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
        return any_in(
            [&](const Node& node) { return node.squared_distance(p) <= node.radius * node.radius; },
            [&](int k) { return dot(points_[k] - p, points_[k] - p) < radii_[k] * radii_[k] && accept(order_[k]); });
    }

    // Calls a function with the number of each point whose distance from a segment is at most its radius and `slack`.
    template <typename Function>
    void each_along(P start, P along, double slack, TimeLimit& limit, Function function) const {
        const double squared = dot(along, along);
        const P inverse{reciprocal(along.x), reciprocal(along.y), reciprocal(along.z)};
        any_in(
            [&](const Node& node) {
                limit.require_time();
                return node.meets(start, inverse, node.radius + slack);
            },
            [&](int k) {
                const P to = points_[k] - start;
                const double share = squared > 0 ? std::clamp(dot(to, along) / squared, 0.0, 1.0) : 0.0;
                const P off = to - share * along;
                if (dot(off, off) <= (radii_[k] + slack) * (radii_[k] + slack)) function(order_[k]);
                return false;
            });
    }

private:
    struct Node {
        P lowest, highest;
        double radius;
        int first, last, left, right;

        // Whether a segment meets the box, wider by a margin on each side. `inverse` has the reciprocals of its sides.
        bool meets(P start, P inverse, double margin) const {
            double first_share = 0, last_share = 1;
            for (int k = 0; k < kDimension<P>; ++k) {
                const double from = (coordinate(lowest - start, k) - margin) * coordinate(inverse, k);
                const double to = (coordinate(highest - start, k) + margin) * coordinate(inverse, k);
                first_share = std::max(first_share, std::min(from, to));
                last_share = std::min(last_share, std::max(from, to));
            }
            return first_share <= last_share;
        }

        double squared_distance(P p) const {
            const P outside = high(high(lowest - p, p - highest), kOrigin<P>);
            return dot(outside, outside);
        }
    };

    static constexpr int kLeaf = 8;

    // Whether `accept` holds for the place in `order_` of any point below the nodes that `enter` holds for.
    template <typename Enter, typename Accept>
    bool any_in(Enter enter, Accept accept) const {
        if (nodes_.empty()) return false;
        int stack[64], top = 0;
        stack[top++] = 0;
        while (top) {
            const Node& node = nodes_[stack[--top]];
            if (!enter(node)) continue;
            if (node.left >= 0) {
                stack[top++] = node.right;
                stack[top++] = node.left;
                continue;
            }
            for (int k = node.first; k < node.last; ++k)
                if (accept(k)) return true;
        }
        return false;
    }

    static double reciprocal(double side) { return 1 / (side == 0 ? kTiny : side); }

    template <class T>
    std::vector<T> in_order(const std::vector<T>& values) const {
        std::vector<T> ordered;
        for (const int i : order_) ordered.push_back(values[i]);
        return ordered;
    }

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

// A box in space with sides along the axes, empty by default.
struct Box {
    Point3 low{kInfinity, kInfinity, kInfinity}, high{-kInfinity, -kInfinity, -kInfinity};

    Box() = default;
    Box(Point3 a, Point3 b) : low(geometry::low(a, b)), high(geometry::high(a, b)) {}
    Box(const Box& a, const Box& b) : low(geometry::low(a.low, b.low)), high(geometry::high(a.high, b.high)) {}

    bool meets(const Box& other) const {
        return low.x <= other.high.x && other.low.x <= high.x && low.y <= other.high.y && other.low.y <= high.y &&
               low.z <= other.high.z && other.low.z <= high.z;
    }
};

// A binary tree of boxes: node k has the children 2k and 2k + 1, and the last nodes are those of the boxes, in order.
class BoxTree {
public:
    explicit BoxTree(const std::vector<Box>& boxes) : count_(boxes.size()) {
        while (leaves_ < count_) leaves_ *= 2;
        nodes_.resize(2 * leaves_);
        std::copy(boxes.begin(), boxes.end(), nodes_.begin() + static_cast<std::ptrdiff_t>(leaves_));
        for (size_t node = leaves_ - 1; node > 0; --node) nodes_[node] = Box(nodes_[2 * node], nodes_[2 * node + 1]);
    }

    // Whether a box meets one of the boxes.
    bool meets(const Box& box) {
        stack_.assign(1, 1);
        while (!stack_.empty()) {
            const size_t node = stack_.back();
            stack_.pop_back();
            if (!nodes_[node].meets(box)) continue;
            if (node >= leaves_) return true;
            stack_.push_back(2 * node + 1);
            stack_.push_back(2 * node);
        }
        return false;
    }

    // Calls a function with the number of each box that meets a box, in order.
    template <typename Function>
    void each(const Box& box, TimeLimit& limit, Function function) {
        stack_.assign(1, 1);
        search(box, limit, function);
    }

    // Calls a function with the number of each box after number i that meets it, in order.
    template <typename Function>
    void each_after(size_t i, TimeLimit& limit, Function function) {
        // those below the right siblings of its ancestors
        for (size_t ancestor = leaves_ + i; ancestor > 1; ancestor /= 2)
            if (ancestor % 2 == 0) stack_.insert(stack_.begin(), ancestor + 1);
        search(nodes_[leaves_ + i], limit, function);
    }

private:
    template <typename Function>
    void search(const Box& box, TimeLimit& limit, Function function) {
        while (!stack_.empty()) {
            const size_t node = stack_.back();
            stack_.pop_back();
            limit.require_time();
            if (!nodes_[node].meets(box)) continue;
            if (node < leaves_) {
                stack_.push_back(2 * node + 1);
                stack_.push_back(2 * node);
            } else if (node - leaves_ < count_) {  // a box without end meets the empty ones too
                function(static_cast<int64_t>(node - leaves_));
            }
        }
    }

    size_t count_, leaves_ = 1;
    std::vector<Box> nodes_;
    std::vector<size_t> stack_;
};

}  // namespace geometry
