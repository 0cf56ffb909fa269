// A triangulation in space whose edges get wanted lengths and whose angles are increased.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <set>
#include <stdexcept>
#include <utility>
#include <vector>

#include "entry.hpp"
#include "size_field.hpp"
#include "triangles.hpp"

namespace space {

using namespace geometry;

inline constexpr double kShortest = 0.6, kLongest = 4.0 / 3;  // edges, in wanted lengths
const double kThin = 10 * kPi / 180, kThinSlope = std::tan(kThin), kGood = std::asin(kLeastSine);
inline constexpr int kMostRounds = 50, kMostSplits = 30, kFlipsBetween = 2;
inline constexpr double kLeastGain = 1e-3;  // of an angle by a flip
inline constexpr int kCorrections = 10;  // of a smoothing that turns triangles over
inline constexpr double kMostTurned = 0.5;  // cosine of the largest angle by which a triangle may be turned
inline constexpr double kMostBent = 0.5;  // cosine of the largest angle by which a flip may bend a flatter pair of triangles

// The normal of a triangle, or 0 without area.
inline Point3 normal(Point3 a, Point3 b, Point3 c) {
    const Point3 n = cross(b - a, c - a);
    const double size = length(n);
    return size > 0 ? 1 / size * n : n;
}

// The sine of the smallest angle of a triangle, or 0 with equal vertices.
inline double smallest_sine(Point3 a, Point3 b, Point3 c) {
    const double ab = length(b - a), bc = length(c - b), ca = length(a - c);
    const double longest = std::max({ab, bc, ca}), shortest = std::min({ab, bc, ca});
    const double product = longest * (ab + bc + ca - longest - shortest);
    return product > 0 ? std::min(1.0, length(cross(b - a, c - a)) / product) : 0;
}

inline double smallest_angle(Point3 a, Point3 b, Point3 c) { return std::asin(smallest_sine(a, b, c)); }

inline double angle_at(Point3 a, Point3 b, Point3 c) { return std::atan2(length(cross(b - a, c - a)), dot(b - a, c - a)); }

// Whether a change turns a triangle over, or takes its area.
inline bool is_turned(Point3 before, Point3 after) { return dot(before, before) > 0 && !(dot(before, after) > kMostTurned); }

class Mesh : private Triangles {
public:
    // The first `fixed` vertices are kept. `taken` pairs of them are not joined by inner edges.
    Mesh(std::vector<Point3> vertices, const std::vector<std::array<int, 3>>& faces, int fixed,
         const std::vector<std::array<int, 2>>& taken, const SizeFieldOf<Point3>& size, double enough, size_t most,
         TimeLimit& limit)
        : x_(std::move(vertices)), fixed_(fixed), size_(size), enough_(enough), most_(most), limit_(limit) {
        for (const auto& face : faces) triangles_.push_back({face, {-1, -1, -1}});
        connect();
        for (const Point3 p : x_) wanted_.push_back(size_(p));
        at_.assign(x_.size(), -1);
        for (int t = 0; t < count(); ++t) {
            note(t);
            for (int k = 0; k < 3; ++k) add_edge(vertex(t, k), vertex(t, k + 1));
        }
        for (const auto& pair : taken) taken_.insert(std::minmax(pair[0], pair[1]));
        changed_.assign(triangles_.size(), true);
        require_surface();
    }

    // Halves inner edges that are too long, chords with small angles, and taken chords.
    void split() {
        struct Long {
            double excess, length;
            int triangle, side;
        };
        for (int round = 0; round < kMostSplits && x_.size() < most_ && !limit_.is_over(); ++round) {
            std::vector<Long> found;
            for (int t = 0; t < count(); ++t)
                for (int k = 0; k < 3; ++k) {
                    const int other = across(t, k), a = vertex(t, k), b = vertex(t, k + 1);
                    if (other < 0 || a > b) continue;
                    const double side = distance(a, b);
                    double excess = 0;
                    if (is_taken(a, b) || is_thin_chord(t, k)) excess = kInfinity;
                    // only the longest edges of both triangles: next to a longer rim edge the halves would be too long
                    else if (side >= std::max(longest(t), longest(other))) excess = relative_length(a, b);
                    if (excess > kLongest) found.push_back({excess, side, t, k});
                }
            if (found.empty()) return;
            std::sort(found.begin(), found.end(), [](const Long& a, const Long& b) {
                return std::pair(-a.excess, -a.length) < std::pair(-b.excess, -b.length);
            });
            std::vector<char> used(triangles_.size(), false);
            const std::vector<Point3> normals = vertex_normals();
            for (const Long& one : found) {
                if (used[one.triangle] || x_.size() >= most_ || limit_.is_over()) continue;
                const int other = across(one.triangle, one.side);
                if (used[other]) continue;
                halve(one.triangle, one.side, normals);
                used.resize(triangles_.size(), true);
                used[one.triangle] = used[other] = true;
            }
            flip(kFlipsBetween);  // without flips, thin triangles would be halved very often
        }
    }

    // Collapses inner edges that are too short, or opposite to a thin angle, unless that makes an angle too small or an edge too long.
    void collapse() {
        struct Short {
            double length;
            int triangle, side;
        };
        std::set<std::pair<int, int>> refused;
        std::vector<char> dead(triangles_.size(), false);
        while (!limit_.is_over()) {
            std::vector<Short> found;
            std::vector<double> least(x_.size(), 1.0);  // sines
            for (int t = 0; t < count(); ++t) {
                if (dead[t]) continue;
                const double sine = smallest_sine(x_[vertex(t, 0)], x_[vertex(t, 1)], x_[vertex(t, 2)]);
                for (int k = 0; k < 3; ++k) {
                    const int a = vertex(t, k), b = vertex(t, k + 1);
                    least[a] = std::min(least[a], sine);
                    if (a > b || across(t, k) < 0 || b < fixed_) continue;
                    const double relative = relative_length(a, b);
                    if ((relative < kShortest || is_opposite_to_thin(t, k)) && !refused.count({a, b})) found.push_back({relative, t, k});
                }
            }
            std::sort(found.begin(), found.end(), [](const Short& a, const Short& b) { return a.length < b.length; });
            std::vector<char> used(x_.size(), false);  // vertices beside collapsed edges
            bool is_done = true;
            for (const Short& one : found) {
                if (dead[one.triangle] || limit_.is_over()) continue;
                const int a = vertex(one.triangle, one.side), b = vertex(one.triangle, one.side + 1);
                if (used[a] || used[b]) continue;
                const auto around_a = a < fixed_ ? Star() : star(a), around_b = star(b);
                bool is_free = true;
                for (const auto* around : {&around_a, &around_b})
                    for (const auto& [t, k] : *around) is_free = is_free && !used[vertex(t, k + 1)];
                if (!is_free) continue;
                const double enough = std::min({least[a], least[b], kLeastSine});
                if (!can_collapse(one.triangle, one.side, enough, around_a, around_b)) {
                    refused.insert({a, b});
                    continue;
                }
                for (const auto* around : {&around_a, &around_b})
                    for (const auto& [t, k] : *around) used[vertex(t, k + 1)] = true;
                used[a] = used[b] = true;
                collapse(one.triangle, one.side, around_b);
                dead[one.triangle] = dead[across(one.triangle, one.side)] = true;
                is_done = false;
            }
            if (is_done) break;
            // whatever the numbers of the vertices, edges beside collapsed ones are tried again
            for (auto one = refused.begin(); one != refused.end();)
                one = used[one->first] || used[one->second] ? refused.erase(one) : std::next(one);
        }
        remove(dead);
    }

    // Flips inner edges where that increases the smallest angle of the two triangles.
    void flip(int rounds = kMostRounds) {
        struct Gain {
            double gain, length;
            int triangle, side;
        };
        for (int round = 0; round < rounds && !limit_.is_over(); ++round) {
            std::vector<Gain> found;
            for (int t = 0; t < count(); ++t)
                for (int k = 0; k < 3; ++k) {
                    const int other = across(t, k);
                    if (other < t || !(changed_[t] || changed_[other])) continue;
                    const double gain = gain_of_flip(t, k);
                    if (gain > kLeastGain) found.push_back({gain, distance(vertex(t, k), vertex(t, k + 1)), t, k});
                }
            std::fill(changed_.begin(), changed_.end(), false);
            if (found.empty()) return;
            std::sort(found.begin(), found.end(), [](const Gain& a, const Gain& b) {
                return std::pair(-a.gain, -a.length) < std::pair(-b.gain, -b.length);
            });
            std::vector<char> used(triangles_.size(), false);
            for (const Gain& one : found) {
                if (limit_.is_over()) return;
                changed_[one.triangle] = true;
                if (used[one.triangle]) continue;
                const int other = across(one.triangle, one.side);
                changed_[other] = true;
                if (used[other]) continue;
                const int c = vertex(one.triangle, one.side + 2), d = opposite(other, one.triangle);
                if (has_edge(c, d)) continue;
                used[one.triangle] = used[other] = true;
                remove_edge(vertex(one.triangle, one.side), vertex(one.triangle, one.side + 1));
                Triangles::flip(one.triangle, one.side);
                add_edge(c, d);
                note(one.triangle);
                note(other);
            }
        }
    }

    // Moves inner vertices, in their tangent planes, to the weighted mean of the triangles around them.
    void smooth() {
        std::vector<Point3> step(x_.size(), kOrigin<Point3>), normals = step;
        std::vector<double> total(x_.size(), 0);
        for (const Triangle& t : triangles_) {
            const Point3 a = x_[t.vertex[0]], b = x_[t.vertex[1]], c = x_[t.vertex[2]], twice = cross(b - a, c - a);
            const double wanted = wanted_[t.vertex[0]] + wanted_[t.vertex[1]] + wanted_[t.vertex[2]];
            const double weight = length(twice) / (wanted * wanted);
            for (const int i : t.vertex) {
                step[i] = step[i] + weight / 3 * (a + b + c);
                normals[i] = normals[i] + twice;
                total[i] += weight;
            }
        }
        for (int i = 0; i < static_cast<int>(x_.size()); ++i) {
            const double squared = dot(normals[i], normals[i]);
            step[i] = i < fixed_ || !(total[i] > 0) ? kOrigin<Point3> : 1 / total[i] * step[i] - x_[i];
            if (squared > 0) step[i] = step[i] - dot(step[i], normals[i]) / squared * normals[i];
        }
        for (int round = 0; round < kCorrections; ++round) {
            bool is_good = true;
            std::vector<int> back;
            for (const Triangle& t : triangles_) {
                const auto [i, j, k] = t.vertex;
                const Point3 a = x_[i] + step[i], b = x_[j] + step[j], c = x_[k] + step[k];
                if (!is_turned(normal(x_[i], x_[j], x_[k]), normal(a, b, c))) {
                    const double after = smallest_sine(a, b, c);
                    if (after >= kLeastSine || after >= smallest_sine(x_[i], x_[j], x_[k])) continue;
                }
                back.insert(back.end(), t.vertex.begin(), t.vertex.end());
                is_good = false;
            }
            if (is_good) {
                for (int i = fixed_; i < static_cast<int>(x_.size()); ++i) move(i, x_[i] + step[i]);
                std::fill(changed_.begin(), changed_.end(), true);
                return;
            }
            for (const int i : back) step[i] = kOrigin<Point3>;
        }
    }

    // Moves single vertices of triangles with small angles if that increases the smallest angle around them.
    void polish() {
        const double enough = std::min(enough_, kGood);
        std::vector<double> steps(kPolishing.begin(), kPolishing.end());
        // small steps first if a smaller angle is enough, so that vertices move less
        if (enough < kGood) std::reverse(steps.begin(), steps.end());
        for (const double step : steps) {
            if (limit_.is_over(triangles_.size())) return;
            std::vector<double> least(x_.size(), kPi);
            for (int t = 0; t < count(); ++t)
                for (const int i : triangles_[t].vertex) least[i] = std::min(least[i], angle_of(t));
            std::vector<int> poor;
            for (int i = fixed_; i < static_cast<int>(x_.size()); ++i)
                if (least[i] < enough) poor.push_back(i);
            std::sort(poor.begin(), poor.end(), [&](int i, int j) { return least[i] < least[j]; });
            std::vector<char> used(x_.size(), false);
            for (const int i : poor) {
                if (used[i]) continue;
                for (const auto& [t, k] : star(i))
                    for (const int j : triangles_[t].vertex) used[j] = true;
                improve(i, step * wanted_[i], least[i]);
            }
        }
    }

    const std::vector<Point3>& vertices() const { return x_; }
    const std::vector<Triangle>& triangles() const { return triangles_; }

private:
    using Star = std::vector<std::pair<int, int>>;

    // The triangles around each inner vertex must form one closed fan.
    void require_surface() const {
        std::vector<size_t> found(x_.size(), 0);
        for (int t = 0; t < count(); ++t)
            for (int k = 0; k < 3; ++k) {
                ++found[vertex(t, k)];
                if (across(t, k) < 0 && std::max(vertex(t, k), vertex(t, k + 1)) >= fixed_)
                    throw std::invalid_argument("an edge of the boundary has no kept vertices");
            }
        for (int i = fixed_; i < static_cast<int>(x_.size()); ++i)
            if (found[i] && star(i).size() != found[i]) throw std::invalid_argument("several fans around a vertex");
    }

    int count() const { return static_cast<int>(triangles_.size()); }
    int vertex(int t, int k) const { return triangles_[t].vertex[k % 3]; }
    int across(int t, int k) const { return triangles_[t].across[k]; }
    double distance(int a, int b) const { return length(x_[b] - x_[a]); }
    double relative_length(int a, int b) const { return 2 * distance(a, b) / (wanted_[a] + wanted_[b]); }
    double angle_of(int t) const { return smallest_angle(x_[vertex(t, 0)], x_[vertex(t, 1)], x_[vertex(t, 2)]); }
    Point3 normal_of(int t) const { return normal(x_[vertex(t, 0)], x_[vertex(t, 1)], x_[vertex(t, 2)]); }
    double longest(int t) const {
        return std::max({distance(vertex(t, 0), vertex(t, 1)), distance(vertex(t, 1), vertex(t, 2)), distance(vertex(t, 2), vertex(t, 0))});
    }

    void move(int i, Point3 p) {
        x_[i] = p;
        wanted_[i] = size_(p);
    }

    void note(int t) {
        for (const int i : triangles_[t].vertex) at_[i] = t;
    }

    // Edges between two kept vertices, around which the triangles may form several fans, are listed.
    void add_edge(int a, int b) {
        if (std::max(a, b) < fixed_) chords_.insert(std::minmax(a, b));
    }
    void remove_edge(int a, int b) { chords_.erase(std::minmax(a, b)); }
    bool is_taken(int a, int b) const { return std::max(a, b) < fixed_ && taken_.count(std::minmax(a, b)); }

    // Whether two vertices are joined by an edge, or must not be.
    bool has_edge(int a, int b) const {
        if (std::max(a, b) < fixed_) return chords_.count(std::minmax(a, b)) || is_taken(a, b);
        for (const auto& [t, k] : star(std::max(a, b)))
            if (vertex(t, k + 1) == std::min(a, b)) return true;
        return false;
    }

    // The triangles around an inner vertex, and its place in them.
    Star star(int i) const {
        Star found;
        int t = at_[i];
        do {
            int k = 0;
            while (vertex(t, k) != i) ++k;
            found.emplace_back(t, k);
            t = across(t, k);
        } while (t != at_[i]);
        return found;
    }

    // An edge between two kept vertices with a small angle at one of them. Edges opposite to a small angle do not
    // count, because halving them would halve this angle.
    bool is_thin_chord(int t, int k) const {
        if (vertex(t, k) >= fixed_ || vertex(t, k + 1) >= fixed_) return false;
        double beside = kPi, opposite = kPi;
        for (const auto& [s, j] : {std::pair(t, k), std::pair(across(t, k), side_of(t, k))}) {
            const Point3 a = x_[vertex(s, j)], b = x_[vertex(s, j + 1)], c = x_[vertex(s, j + 2)];
            beside = std::min({beside, angle_at(a, b, c), angle_at(b, c, a)});
            opposite = std::min(opposite, angle_at(c, a, b));
        }
        return beside < kThin && opposite > 2 * kThin;
    }

    // Whether an edge is opposite to an angle that is too small.
    bool is_opposite_to_thin(int t, int k) const {
        const Point3 a = x_[vertex(t, k)], b = x_[vertex(t, k + 1)];
        for (const int i : {vertex(t, k + 2), opposite(across(t, k), t)}) {
            const Point3 u = a - x_[i], v = b - x_[i];
            if (length(cross(u, v)) <= kThinSlope * dot(u, v)) return true;
        }
        return false;
    }

    // Area-weighted unit normals of the vertices.
    std::vector<Point3> vertex_normals() const {
        std::vector<Point3> sums(x_.size(), kOrigin<Point3>);
        for (const Triangle& t : triangles_) {
            const Point3 twice = cross(x_[t.vertex[1]] - x_[t.vertex[0]], x_[t.vertex[2]] - x_[t.vertex[0]]);
            for (const int i : t.vertex) sums[i] = sums[i] + twice;
        }
        for (Point3& n : sums)
            if (length(n) > 0) n = 1 / length(n) * n;
        return sums;
    }

    // The middle of the cubic curve along an edge that is orthogonal to the normals at its ends. It is the midpoint
    // on a rough surface, and for a kept end, where the normal is that of one side only.
    Point3 middle(int a, int b, const std::vector<Point3>& normals) const {
        const Point3 edge = x_[b] - x_[a], straight = 0.5 * (x_[a] + x_[b]);
        if (std::min(a, b) < fixed_ || !(dot(normals[a], normals[b]) > kMostTurned)) return straight;
        return straight + 0.125 * (dot(edge, normals[b]) * normals[b] - dot(edge, normals[a]) * normals[a]);
    }

    void halve(int t, int k, const std::vector<Point3>& normals) {
        const int other = across(t, k), j = side_of(t, k), p = static_cast<int>(x_.size());
        const int a = vertex(t, k), b = vertex(t, k + 1), c = vertex(t, k + 2), d = vertex(other, j + 2);
        const int bc = across(t, (k + 1) % 3), ca = across(t, (k + 2) % 3);
        const int ad = across(other, (j + 1) % 3), db = across(other, (j + 2) % 3);
        const int s = count(), o = s + 1;
        x_.push_back(middle(a, b, normals));
        wanted_.push_back(size_(x_[p]));
        at_.push_back(-1);
        remove_edge(a, b);
        triangles_[t] = {{a, p, c}, {o, s, ca}};
        triangles_[other] = {{b, p, d}, {s, o, db}};
        triangles_.push_back({{p, b, c}, {other, bc, t}});
        triangles_.push_back({{p, a, d}, {t, ad, other}});
        relink(bc, t, s, c);
        relink(ad, other, o, d);
        changed_.resize(triangles_.size(), true);
        for (const int each : {t, other, s, o}) {
            note(each);
            changed_[each] = true;
        }
    }

    double gain_of_flip(int t, int k) const {
        const int other = across(t, k), i = vertex(t, k), j = vertex(t, k + 1);
        const Point3 a = x_[i], b = x_[j], c = x_[vertex(t, k + 2)], d = x_[opposite(other, t)];
        const double before = std::min(smallest_sine(a, b, c), smallest_sine(b, a, d));
        const double after = std::min(smallest_sine(a, d, c), smallest_sine(b, c, d));
        if (!(after > before)) return 0;  // before the arc sines, which take longer
        const double gain = std::min(std::asin(after), enough_) - std::asin(before);
        if (!(gain > kLeastGain)) return 0;
        const Point3 n = normal(a, b, c), m = normal(b, a, d), v = normal(a, d, c), w = normal(b, c, d);
        const bool is_over = dot(v, n + m) < 0 || dot(w, n + m) < 0;
        return is_over || dot(v, w) < std::min(dot(n, m), kMostBent) ? 0 : gain;
    }

    // Where the ends of an edge meet when it is collapsed: at its midpoint, or at its kept vertex.
    Point3 meeting(int a, int b) const { return a < fixed_ ? x_[a] : 0.5 * (x_[a] + x_[b]); }

    // Whether the triangles at an edge's ends a and b stay good if it is collapsed. Edges that get too long are halved
    // later. Only thin triangles are worth that.
    bool can_collapse(int t, int k, double enough, const Star& around_a, const Star& around_b) const {
        const int a = vertex(t, k), b = vertex(t, k + 1), other = across(t, k), c = vertex(t, k + 2), d = opposite(other, t);
        const bool is_thin = is_opposite_to_thin(t, k);
        const Point3 p = meeting(a, b);
        const double wanted = a < fixed_ ? wanted_[a] : size_(p);
        for (const auto* around : {&around_b, &around_a})
            for (const auto& [s, i] : *around) {
                if (s == t || s == other) continue;
                const int u = vertex(s, i + 1), v = vertex(s, i + 2);
                // with a third common neighbour two faces would have the same vertices
                if (around == &around_b && u != c && u != d && has_edge(a, u)) return false;
                if (!is_thin && length(x_[u] - p) > 0.5 * kLongest * (wanted + wanted_[u])) return false;
                if (is_turned(normal_of(s), normal(p, x_[u], x_[v])) || smallest_sine(p, x_[u], x_[v]) < enough) return false;
            }
        return true;
    }

    // Replaces b by a in the triangles around b, and joins the neighbours of the two triangles at the edge.
    void collapse(int t, int k, const Star& around_b) {
        const int a = vertex(t, k), b = vertex(t, k + 1), other = across(t, k), j = side_of(t, k);
        move(a, meeting(a, b));
        at_[b] = -1;
        for (const auto& [s, i] : around_b) {
            triangles_[s].vertex[i] = a;
            if (s != t && s != other) add_edge(a, vertex(s, i + 1)), add_edge(a, vertex(s, i + 2));
        }
        for (const auto& [gone, side] : {std::pair(t, k), std::pair(other, j)}) {
            const int first = across(gone, (side + 1) % 3), last = across(gone, (side + 2) % 3);
            relink(first, gone, last, vertex(gone, side + 2));
            relink(last, gone, first, a);
            for (const int each : {first, last})
                if (each >= 0) note(each);
        }
    }

    void improve(int i, double reach, double least) {
        const auto around = star(i);
        Point3 mean = kOrigin<Point3>, along = mean;
        double nearest = kInfinity;
        for (const auto& [t, k] : around) {
            const Point3 to = x_[vertex(t, k + 1)] - x_[i];
            mean = mean + cross(to, x_[vertex(t, k + 2)] - x_[i]);
            if (length(to) < nearest) nearest = length(to), along = to;
        }
        const double size = length(mean);
        if (!(size > 0)) return;
        mean = 1 / size * mean;
        // the first direction is that of the nearest neighbour, so that results do not depend on coordinates
        along = along - dot(along, mean) * mean;
        if (!(length(along) > 0)) return;
        along = reach / length(along) * along;
        const Point3 aside = cross(mean, along), from = x_[i];
        Point3 best = from;
        for (int place = 0; place < kAround; ++place) {
            const double turn = 2 * kPi * place / kAround;
            const Point3 p = from + std::cos(turn) * along + std::sin(turn) * aside;
            double angle = kPi;
            for (const auto& [t, k] : around) {
                const Point3 u = x_[vertex(t, k + 1)], v = x_[vertex(t, k + 2)];
                angle = is_turned(normal(from, u, v), normal(p, u, v)) ? 0 : std::min(angle, smallest_angle(p, u, v));
                if (angle <= least) break;
            }
            if (angle > least) best = p, least = angle;
        }
        for (const auto& [t, k] : around) changed_[t] = true;
        move(i, best);
    }

    // Removes triangles, and vertices without any that need not be kept.
    void remove(const std::vector<char>& dead) {
        std::vector<int> number(triangles_.size(), -1), place(x_.size(), -1);
        int faces = 0, left = 0;
        for (int t = 0; t < count(); ++t)
            if (!dead[t]) number[t] = faces++;
        for (int i = 0; i < static_cast<int>(x_.size()); ++i) {
            if (i >= fixed_ && at_[i] < 0) continue;
            place[i] = left;
            x_[left] = x_[i], wanted_[left] = wanted_[i], ++left;
        }
        x_.resize(left), wanted_.resize(left), at_.resize(left);
        for (int t = 0; t < count(); ++t) {
            if (dead[t]) continue;
            Triangle one = triangles_[t];
            for (int k = 0; k < 3; ++k) {
                one.vertex[k] = place[one.vertex[k]];
                if (one.across[k] >= 0) one.across[k] = number[one.across[k]];
            }
            triangles_[number[t]] = one;
        }
        triangles_.resize(faces);
        for (int t = 0; t < faces; ++t) note(t);
        changed_.assign(faces, true);
    }

    std::vector<Point3> x_;
    int fixed_;
    const SizeFieldOf<Point3>& size_;
    double enough_;  // angles from this on are not increased by flips
    size_t most_;  // vertices
    TimeLimit& limit_;
    std::vector<double> wanted_;  // lengths at the vertices
    std::vector<int> at_;  // a triangle at each inner vertex
    std::vector<char> changed_;  // triangles whose edges may have to be flipped
    std::set<std::pair<int, int>> chords_, taken_;
};

}  // namespace space
