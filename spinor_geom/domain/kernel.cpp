// Delaunay refinement of plane regions: sizes, first points, insertion, smoothing. Called by kernel.py through ctypes.
//
// Coordinates are those of a region with centre 0 and radius 1. Triangles run counter-clockwise; neighbour k of a
// triangle lies across its edge from vertex k to the next, and -1 is the boundary. No point is put on the boundary.

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <queue>
#include <utility>
#include <vector>

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTiny = 1e-290;
const double kPi = std::acos(-1.0);
// triangles without smaller angles than 25 degrees are kept; above 30 the number of points grows quickly
const double kLeastSine = std::sin(25.0 * kPi / 180);
// a triangle is too large when its circumradius exceeds this times the wanted edge length (equilateral: 1.3 edges)
constexpr double kLargestRadius = 0.75;
// share of that radius, by the mean of the sizes at the vertices, above which the size at the centroid is computed
constexpr double kDoubtful = 0.8;
// a boundary edge subtends at most 110 degrees at new points; 90 would leave no room beside short edges next to long ones
const double kWidestView = std::cos((180 - 110) * kPi / 180);
// longest inner edge between two boundary vertices, in wanted edge lengths; shorter where it cuts off one vertex
constexpr double kLongestBridge = 1.45, kLongestEar = 1.05;
constexpr int kBridgeRounds = 3;
constexpr double kRoundEnough = 0.4;  // smoothing must not reduce the roundness (1: equilateral) of triangles below this
constexpr int kMoves = 2;             // more do not improve the angles
// a point of a poor triangle is tried at eight places around it, at these multiples of the length of its edges
constexpr std::array<double, 6> kPolishing = {0.3, 0.3, 0.15, 0.15, 0.08, 0.08};
constexpr int kAround = 8;
constexpr int kLongestWalk = 64;       // triangles after which a walk to a circumcentre counts as blocked
constexpr double kRoomAtBoundary = 2;  // least distance of lattice points from boundary vertices, in lattice spacings
constexpr int kSizeSamples = 100;      // points at which the largest wanted size is searched
constexpr double kMostRows = 20000;    // of a lattice
constexpr double kFromTips = 0.75, kFromVertices = 1.2;  // least distances of seeds, in edge lengths
constexpr double kLeastSpacing = 0.7;                    // of seeds, in wanted edge lengths
constexpr double kRounding = 1e-13;                      // of the determinants, relative to the sums of their terms

double now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

struct Point {
    double x, y;
};

Point operator+(Point a, Point b) { return {a.x + b.x, a.y + b.y}; }
Point operator-(Point a, Point b) { return {a.x - b.x, a.y - b.y}; }
Point operator*(double s, Point a) { return {s * a.x, s * a.y}; }
double cross(Point a, Point b) { return a.x * b.y - a.y * b.x; }
double dot(Point a, Point b) { return a.x * b.x + a.y * b.y; }
double length(Point a) { return std::sqrt(dot(a, a)); }
double side(Point a, Point b, Point p) { return cross(b - a, p - a); }

// Whether p lies inside the circumcircle of a, b, c by more than rounding.
bool in_circle(Point a, Point b, Point c, Point p) {
    a = a - p, b = b - p, c = c - p;
    const double aa = dot(a, a), bb = dot(b, b), cc = dot(c, c);
    const double ab = cross(a, b), bc = cross(b, c), ca = cross(c, a);
    const double terms = aa * std::abs(bc) + bb * std::abs(ca) + cc * std::abs(ab);
    return aa * bc + bb * ca + cc * ab > kRounding * terms;
}

// Sine of the smallest angle; negative for clockwise triangles.
double smallest_sine(Point a, Point b, Point c) {
    const double ab = length(b - a), bc = length(c - b), ca = length(a - c);
    const double longest = std::max({ab, bc, ca}), shortest = std::min({ab, bc, ca});
    return side(a, b, c) / (longest * (ab + bc + ca - longest - shortest));
}

// Area per sum of squared edges, 1 for an equilateral triangle; not positive for a flipped one.
double roundness(Point a, Point b, Point c) {
    const Point u = b - a, v = c - a, w = c - b;
    return 2 * std::sqrt(3.0) * cross(u, v) / (dot(u, u) + dot(v, v) + dot(w, w));
}

// Search tree of points, each with a radius.
class Tree {
public:
    Tree() = default;

    Tree(std::vector<Point> points, std::vector<double> radii)
        : points_(std::move(points)), radii_(std::move(radii)), order_(points_.size()) {
        std::iota(order_.begin(), order_.end(), 0);
        if (!order_.empty()) build(0, static_cast<int>(order_.size()));
    }

    // Numbers and squared distances of up to `count` nearest points within `squared`, ascending; the number found.
    int nearest(Point p, int count, double squared, int* number, double* distance) const {
        int found = 0;
        if (nodes_.empty()) return 0;
        std::pair<double, int> stack[64];
        int top = 0;
        stack[top++] = {nodes_[0].squared_distance(p), 0};
        while (top) {
            const auto [least, at] = stack[--top];
            if (least > (found < count ? squared : distance[found - 1])) continue;
            const Node& node = nodes_[at];
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
    bool any_around(Point p, Accept accept) const {
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
        Point low, high;
        double radius;
        int first, last, left, right;

        double squared_distance(Point p) const {
            const double x = std::max({low.x - p.x, 0.0, p.x - high.x}), y = std::max({low.y - p.y, 0.0, p.y - high.y});
            return x * x + y * y;
        }
    };

    static constexpr int kLeaf = 8;

    int build(int first, int last) {
        const int at = static_cast<int>(nodes_.size());
        Node node{{kInfinity, kInfinity}, {-kInfinity, -kInfinity}, 0.0, first, last, -1, -1};
        for (int k = first; k < last; ++k) {
            const Point p = points_[order_[k]];
            node.low = {std::min(node.low.x, p.x), std::min(node.low.y, p.y)};
            node.high = {std::max(node.high.x, p.x), std::max(node.high.y, p.y)};
            if (!radii_.empty()) node.radius = std::max(node.radius, radii_[order_[k]]);
        }
        nodes_.push_back(node);
        if (last - first > kLeaf) {
            const bool wide = node.high.x - node.low.x > node.high.y - node.low.y;
            const int middle = (first + last) / 2;
            std::nth_element(order_.begin() + first, order_.begin() + middle, order_.begin() + last, [&](int i, int j) {
                const double a = wide ? points_[i].x : points_[i].y, b = wide ? points_[j].x : points_[j].y;
                return a < b || (a == b && i < j);
            });
            const int left = build(first, middle), right = build(middle, last);
            nodes_[at].left = left;
            nodes_[at].right = right;
        }
        return at;
    }

    std::vector<Point> points_;
    std::vector<double> radii_;
    std::vector<int> order_;
    std::vector<Node> nodes_;
};

}  // namespace

// What kernel.py passes; see `SizeField` and `triangulate_polygon`.
struct Region {
    int64_t boundary_size;
    const Point* boundary;
    const int64_t* after;  // the next vertex on its polygon
    double growth, decay;
    int64_t sample_count;
    const Point* samples;
    const double* log_lengths;  // wanted at the samples
    int64_t neighbours;         // samples of which the mean is taken
};

struct Seeds {
    int64_t count;  // -1: a lattice
    const Point* points;
    const double* spacing;
};

struct Output {
    int64_t most_points;  // inner ones
    double seconds;       // time limit
    Point* points;        // boundary_size + most_points + room for one point beside each bridge
    int64_t* faces;
    int64_t point_count, face_count;
};

namespace {

constexpr int kMostNeighbours = 8;

class SizeField {
public:
    explicit SizeField(const Region& region) : region_(region), own_(region.boundary_size) {
        const int64_t m = region.boundary_size;
        std::vector<Point> boundary(region.boundary, region.boundary + m);
        for (int64_t i = 0; i < m; ++i) {
            const double half = 0.5 * length(boundary[region.after[i]] - boundary[i]);
            own_[i] += half;
            own_[region.after[i]] += half;
        }
        boundary_ = Tree(std::move(boundary), {});
        samples_ = Tree({region.samples, region.samples + region.sample_count}, {});
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
    std::pair<double, int> nearest_vertex(Point p) const {
        int number;
        double squared;
        boundary_.nearest(p, 1, kInfinity, &number, &squared);
        return {std::sqrt(squared), number};
    }

    double operator()(Point p) const {
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
    const Region& region_;
    std::vector<double> own_, local_;
    double least_ = 0, most_ = 0;
    Tree boundary_, samples_;
};

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
        tree_ = Tree(std::move(centres), std::move(radii));
        // the edges that each of m horizontal strips meets
        first_.assign(m + 1, 0);
        for (int round = 0; round < 2; ++round) {
            for (int64_t i = 0; i < m; ++i) {
                const double a = start(i).y, b = end(i).y;
                for (int64_t k = strip(std::min(a, b)); k <= strip(std::max(a, b)); ++k)
                    if (round) edges_[first_[k] + filled_[k]++] = i;
                    else ++first_[k + 1];
            }
            if (!round) {
                std::partial_sum(first_.begin(), first_.end(), first_.begin());
                edges_.resize(first_[m]);
                filled_.assign(m, 0);
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

    // Points inside of the triangular lattice with rows along the x-axis.
    std::vector<Point> lattice(double spacing) const {
        std::vector<Point> points;
        std::vector<double> crossings;
        const double height = std::sqrt(0.75) * spacing;
        for (double row = std::ceil(low_ / height); row * height < high_; ++row) {
            const double y = row * height;
            const int64_t k = strip(y);
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
        const double m = static_cast<double>(region_.boundary_size);
        return static_cast<int64_t>(std::clamp(std::floor((y - low_) / (high_ - low_) * m), 0.0, m - 1));
    }

    const Region& region_;
    double low_, high_;
    Tree tree_;
    std::vector<int64_t> first_, filled_, edges_;
};

// The inner points from which refinement starts: points of a lattice with the largest wanted size as spacing.
std::vector<Point> lattice_points(const Boundary& boundary, const SizeField& size, int64_t most) {
    if (most <= 0) return {};
    const double area = boundary.area(), shortest = boundary.perimeter() / kMostRows;
    double largest = 0;
    for (const Point p : boundary.lattice(std::max(std::sqrt(area / kSizeSamples), shortest)))
        largest = std::max(largest, size(p));
    if (largest == 0) return {};
    const double spacing = std::max({largest, shortest, std::sqrt(area / static_cast<double>(most))});
    std::vector<Point> kept;
    for (const Point p : boundary.lattice(spacing))
        if (size.nearest_vertex(p).first > kRoomAtBoundary * spacing && boundary.has_room(p)) kept.push_back(p);
    return kept;
}

// Tips of equilateral triangles on the boundary edges, and the seeds that are far enough from them. There are no tips if
// two are too near to each other.
std::vector<Point> tips_and_seeds(
    const Region& region, const Boundary& boundary, const SizeField& size, const Seeds& seeds) {
    const int64_t m = region.boundary_size;
    std::vector<Point> tips(m);
    std::vector<double> lengths(m);
    for (int64_t i = 0; i < m; ++i) {
        const Point a = boundary.start(i), edge = boundary.end(i) - a;
        tips[i] = a + 0.5 * edge + std::sqrt(0.75) * Point{-edge.y, edge.x};
        lengths[i] = kFromTips * length(edge);
    }
    const Tree all(tips, lengths);
    bool apart = true;
    for (int64_t i = 0; i < m && apart; ++i)
        apart = !all.any_around(tips[i], [&](int j) { return j != i && length(tips[j] - tips[i]) < lengths[i]; });
    std::vector<Point> kept;
    std::vector<double> around;
    for (int64_t i = 0; i < m && apart; ++i) {
        if (!boundary.has_room(tips[i])) continue;
        kept.push_back(tips[i]);
        around.push_back(lengths[i]);
    }
    const Tree near(kept, around);
    for (int64_t k = 0; k < seeds.count; ++k) {
        const Point p = seeds.points[k];
        const auto [distance, vertex] = size.nearest_vertex(p);
        const auto edge = boundary.end(vertex) - boundary.start(vertex);
        if (distance <= kFromVertices * length(edge) || !boundary.has_room(p)) continue;
        if (near.any_around(p, [](int) { return true; })) continue;
        if (seeds.spacing[k] > kLeastSpacing * size(p)) kept.push_back(p);
    }
    return kept;
}

struct Triangle {
    std::array<int, 3> vertex, across;
};

class Mesh {
public:
    Mesh(const Region& region, const SizeField& size, const Boundary& boundary, Output& output)
        : region_(region),
          size_(size),
          boundary_(boundary),
          output_(output),
          m_(static_cast<int>(region.boundary_size)),
          n_(m_),
          stop_(now() + output.seconds) {
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
                    if (late()) return;
                    const int t = containing(points[k], at);
                    if (t >= 0 && insert(points[k], t, 0)) at = static_cast<int>(triangles_.size()) - 1;
                }
    }

    // Inserts circumcentres, of the largest triangles first, until no triangle is poor, except where there is no room.
    void refine() {
        for (int t = 0; t < static_cast<int>(triangles_.size()); ++t) enqueue(t);
        is_refining_ = true;
        while (!queue_.empty() && n_ < m_ + output_.most_points && !late()) {
            const Poor poor = queue_.top();
            queue_.pop();
            if (version_[poor.triangle] != poor.version || !is_poor(poor) || boundary_.too_near(poor.centre)) continue;
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
                    const auto [triangle, across] = std::pair(triangles_[t], triangles_[t].across[k]);
                    const int a = triangle.vertex[k], b = triangle.vertex[(k + 1) % 3];
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
        for (int round = 0; round < kMoves; ++round) {
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

    bool late() {
        if (++steps_ % 1024 == 0) is_late_ = is_late_ || now() > stop_;
        return is_late_;
    }

    void connect() {
        std::vector<std::array<int, 4>> edges;  // smaller vertex, larger vertex, triangle, place
        for (int t = 0; t < static_cast<int>(triangles_.size()); ++t)
            for (int k = 0; k < 3; ++k) {
                const int a = triangles_[t].vertex[k], b = triangles_[t].vertex[(k + 1) % 3];
                triangles_[t].across[k] = -1;
                edges.push_back({std::min(a, b), std::max(a, b), t, k});
            }
        std::sort(edges.begin(), edges.end());
        for (size_t e = 0; e + 1 < edges.size(); ++e)
            if (edges[e][0] == edges[e + 1][0] && edges[e][1] == edges[e + 1][1]) {
                triangles_[edges[e][2]].across[edges[e][3]] = edges[e + 1][2];
                triangles_[edges[e + 1][2]].across[edges[e + 1][3]] = edges[e][2];
            }
    }

    int opposite(int triangle, int other) const {
        for (int k = 0; k < 3; ++k)
            if (triangles_[triangle].across[k] == other) return triangles_[triangle].vertex[(k + 2) % 3];
        return -1;
    }

    // The triangle that contains p, reached on a straight walk inside the region; -1 if the walk leaves it.
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
    int containing(Point p, int from) const {
        const int found = walk(p, from, triangles_.size());
        if (found >= 0 || !boundary_.is_inside(p)) return found;
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

    // Puts the corners of triangles that a move would flip or make thin back; whether all others can move.
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
        for (size_t left = 100 * triangles_.size(); !stack.empty() && left; --left) {
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

    // Flips edge k of a triangle if it is not Delaunay and the two new triangles are counter-clockwise; the other
    // triangle, or -1 if the edge stays.
    int flipped(int t, int k) {
        const int other = triangles_[t].across[k];
        if (other < 0) return -1;
        const int a = triangles_[t].vertex[k], b = triangles_[t].vertex[(k + 1) % 3], c = triangles_[t].vertex[(k + 2) % 3];
        int j = 0;
        while (triangles_[other].across[j] != t || triangles_[other].vertex[j] != b) ++j;
        const int d = triangles_[other].vertex[(j + 2) % 3];
        if (!in_circle(point(a), point(b), point(c), point(d))) return -1;
        if (side(point(a), point(d), point(c)) <= 0 || side(point(d), point(b), point(c)) <= 0) return -1;
        // a b c and b a d become a d c and d b c
        const int bc = triangles_[t].across[(k + 1) % 3], ca = triangles_[t].across[(k + 2) % 3];
        const int ad = triangles_[other].across[(j + 1) % 3], db = triangles_[other].across[(j + 2) % 3];
        triangles_[t] = {{a, d, c}, {ad, other, ca}};
        triangles_[other] = {{d, b, c}, {db, bc, t}};
        relink(ad, other, t, d);
        relink(bc, t, other, c);
        return other;
    }

    // Replaces neighbour `before` by `after` across the edge of a triangle that starts at a vertex.
    void relink(int triangle, int before, int after, int start) {
        if (triangle < 0) return;
        for (int k = 0; k < 3; ++k)
            if (triangles_[triangle].across[k] == before && triangles_[triangle].vertex[k] == start)
                triangles_[triangle].across[k] = after;
    }

    const Region& region_;
    const SizeField& size_;
    const Boundary& boundary_;
    Output& output_;
    int m_, n_;
    double stop_;
    bool is_late_ = false, is_refining_ = false;
    int64_t steps_ = 0;
    int round_ = 0;
    std::vector<Triangle> triangles_;
    std::vector<double> wanted_;  // edge lengths at the points
    std::vector<int> stamp_, version_, cavity_, starting_;
    std::vector<Edge> rim_;
    std::priority_queue<Poor> queue_;
};

}  // namespace

extern "C" {

// Wanted edge lengths at points.
void sizes(const Region* region, int64_t count, const Point* points, double* lengths) {
    const SizeField size(*region);
    for (int64_t k = 0; k < count; ++k) lengths[k] = size(points[k]);
}

// Refines a constrained Delaunay triangulation of the boundary, which is given in `output`, until the time is over.
void refine(const Region* region, const Seeds* seeds, Output* output) {
    const SizeField size(*region);
    const Boundary boundary(*region);
    Mesh mesh(*region, size, boundary, *output);
    mesh.insert_all(seeds->count < 0 ? lattice_points(boundary, size, output->most_points)
                                     : tips_and_seeds(*region, boundary, size, *seeds));
    mesh.refine();
    mesh.split_long_bridges();
    mesh.smooth();
    mesh.polish();
    mesh.write();
}
}
