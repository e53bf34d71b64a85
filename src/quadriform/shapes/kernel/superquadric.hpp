// The four superquadrics in their own frame, divided by the semi-axes: F, its slopes, and the way onto the surface.
// The formulas are those of superellipse.py and kinds.py.
#pragma once

#include "elementary.hpp"

namespace quadriform {

enum class Kind { ellipsoid, toroid, hyperboloid1, hyperboloid2 };

constexpr double TINY = 1e-300, WAIST = 1e-50;
constexpr double EDGE = 1e-12; // of the norm: nearer to zero than this a coordinate is zero but for rounding

// The superellipse's norm of (u, v) and its derivatives by u, v and the exponent.
struct Norm {
    Lane value, by_u, by_v, by_exponent;
};

// Of the norm by u, whose share of the norm it is; at u = 0, where it may have an edge, none to either side.
INLINED Lane slope(Lane value, Lane share, Lane u) {
    const auto aside = size(u) > EDGE * value;
    return aside ? value * share / (aside ? u : constant(1)) : Lane{};
}

INLINED Norm norm(Lane u, Lane v, double exponent) { // P10
    const double k = 2 / exponent;
    const Lane size_u = most(size(u), constant(TINY)), size_v = most(size(v), constant(TINY));
    const auto u_leads = size_u > size_v;
    const Lane larger = u_leads ? size_u : size_v, smaller = u_leads ? size_v : size_u;
    const Lane gap = k * logarithm(most(smaller / larger, constant(TINY))),
               ratio = exponential(gap); // of the two terms
    const Lane excess = logarithm(1 + ratio), value = larger * exponential(excess / k);
    const Lane large = 1 / (1 + ratio), small = ratio * large;
    const Lane p = u_leads ? large : small, q = u_leads ? small : large;
    return {value, slope(value, p, u), slope(value, q, v), value * (excess - gap * small) / 2};
}

struct Slopes {
    Lane value, by_point[3], by_exponents[2], by_hole;
};

struct Surface {
    Kind kind;
    double axes[3], exponents[2], rotation[3][3], translation[3], hole;

    INLINED Slopes slopes(const Lanes3 &q) const {
        if (kind == Kind::ellipsoid || kind == Kind::toroid) { // P1
            const Norm s = norm(q[0], q[1], exponents[1]);
            const Norm f = norm(kind == Kind::toroid ? s.value - hole : s.value, q[2], exponents[0]);
            return {f.value,
                    {f.by_u * s.by_u, f.by_u * s.by_v, f.by_v},
                    {f.by_exponent, f.by_u * s.by_exponent},
                    kind == Kind::toroid ? -f.by_u : Lane{}};
        }
        const Norm c = norm(constant(1), q[2], exponents[0]);
        if (kind == Kind::hyperboloid1) {
            const Norm s = norm(q[0], q[1], exponents[1]);
            const Lane f = s.value / c.value;
            return {f,
                    {s.by_u / c.value, s.by_v / c.value, -f * c.by_v / c.value},
                    {-f * c.by_exponent / c.value, s.by_exponent / c.value},
                    Lane{}};
        }
        const Lane r = most(size(q[0]), constant(WAIST)), x = q[0] < 0 ? -r : r;
        const Norm s = norm(c.value, q[1], exponents[1]);
        return {s.value / r,
                {-s.value / r / x, s.by_v / r, s.by_u * c.by_v / r},
                {s.by_u * c.by_exponent / r, s.by_exponent / r},
                Lane{}};
    }

    // The surface point on the ray through q, where F is f; each kind has its own origin of rays.
    INLINED void project(Lanes3 &q, Lane f) const {
        if (kind == Kind::ellipsoid) {
            for (Lane &x : q)
                x /= f; // 2.2
        } else if (kind == Kind::toroid) {
            const Lane s = norm(q[0], q[1], exponents[1]).value, ring = (hole + (s - hole) / f) / s;
            q[0] *= ring, q[1] *= ring, q[2] /= f;
        } else if (kind == Kind::hyperboloid1) {
            q[0] /= f, q[1] /= f;
        } else {
            q[0] *= f;
        }
    }

    INLINED void to_local(const Lanes3 &points, Lanes3 &local) const {
        for (int a = 0; a < 3; ++a) {
            local[a] = Lane{};
            for (int b = 0; b < 3; ++b)
                local[a] += (points[b] - translation[b]) * rotation[b][a]; // P11
        }
    }

    INLINED void scaled(const Lanes3 &points, Lanes3 &q) const {
        to_local(points, q);
        for (int a = 0; a < 3; ++a)
            q[a] /= axes[a];
    }

    INLINED void turned(const Slopes &at, Lanes3 &gradient) const {
        for (int a = 0; a < 3; ++a) {
            gradient[a] = Lane{};
            for (int b = 0; b < 3; ++b)
                gradient[a] += rotation[a][b] / axes[b] * at.by_point[b];
        }
    }

    // Gradient of F at points, by the world.
    INLINED void gradient(const Lanes3 &points, Lanes3 &result) const {
        Lanes3 q;
        scaled(points, q);
        turned(slopes(q), result);
    }

    // Points onto the surface, and the gradient there; along a ray from the ellipsoid's centre it is the same.
    INLINED void onto(Lanes3 &points, Lanes3 &gradient) const {
        Lanes3 q;
        scaled(points, q);
        Slopes at = slopes(q);
        project(q, at.value);
        if (kind != Kind::ellipsoid)
            at = slopes(q);
        for (int a = 0; a < 3; ++a) {
            points[a] = constant(translation[a]);
            for (int b = 0; b < 3; ++b)
                points[a] += rotation[a][b] * axes[b] * q[b];
        }
        turned(at, gradient);
    }
};

} // namespace quadriform
