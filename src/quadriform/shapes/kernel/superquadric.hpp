// Superquadrics in their own frame, divided by the semi-axes: F, its derivatives, and the projection onto the surface.
// The formulas are those of superellipse.py; which norm is taken of what is data: `Kind.codes` of kinds.py.
#pragma once

#include "elementary.hpp"

namespace quadriform {

constexpr double TINY = 1e-300, LEAST_X = 1e-50;
constexpr double EDGE = 1e-12; // of the norm: nearer to zero than this a coordinate is zero but for rounding

// The superellipse's norm of (u, v) and its derivatives by u, v and the exponent.
struct Norm {
    Lane value, by_u, by_v, by_exponent;
};

// Derivative of the norm by u, whose term is this fraction of its sum; zero at u = 0, where it may have an edge.
INLINED Lane by_term(Lane value, Lane fraction, Lane u) {
    const auto aside = size(u) > EDGE * value;
    return aside ? value * fraction / (aside ? u : constant(1)) : Lane{};
}

INLINED Norm norm(Lane u, Lane v, double exponent) { // P10
    const double k = 2 / exponent;
    const Lane size_u = most(size(u), constant(TINY)), size_v = most(size(v), constant(TINY));
    const auto u_leads = size_u > size_v;
    const Lane larger = u_leads ? size_u : size_v, smaller = u_leads ? size_v : size_u;
    const Lane log_ratio = k * logarithm(most(smaller / larger, constant(TINY))),
               ratio = exponential(log_ratio); // of the two terms
    const Lane excess = logarithm(1 + ratio), value = larger * exponential(excess / k);
    const Lane large = 1 / (1 + ratio), small = ratio * large;
    const Lane p = u_leads ? large : small, q = u_leads ? small : large;
    return {value, by_term(value, p, u), by_term(value, q, v), value * (excess - log_ratio * small) / 2};
}

// Terms of F in the order of TERMS in kinds.py: coordinates, the constant 1, the inner and the outer norm.
enum Term { X, Y, Z, ONE, INNER, OUTER };

// Which superellipse norm is taken of which terms; F is the term `over` divided by the term `under`.
struct Kind {
    struct Taken {
        int exponent, u, v;
    } inner, outer;
    int over, under, powers[3];
};

struct Derivatives {
    Lane value, by_point[3], by_exponents[2], by_hole;
};

// By a term itself: a coordinate has a unit gradient, the inner norm the one that is given.
INLINED void add(Derivatives &sum, Lane by, int term, const Derivatives &inner) {
    if (term < ONE) {
        sum.by_point[term] += by;
    } else if (term == INNER) {
        for (int a = 0; a < 3; ++a)
            sum.by_point[a] += by * inner.by_point[a];
        for (int a = 0; a < 2; ++a)
            sum.by_exponents[a] += by * inner.by_exponents[a];
        sum.by_hole += by * inner.by_hole;
    }
}

struct Surface {
    Kind kind;
    double axes[3], exponents[2], rotation[3][3], translation[3], hole;

    // A norm of two terms with its derivatives, by the chain rule.
    INLINED Derivatives norm_of(const Kind::Taken &taken, const Lane (&terms)[5], const Derivatives &inner) const {
        const Norm n = norm(terms[taken.u], terms[taken.v], exponents[taken.exponent]);
        Derivatives result{n.value, {}, {}, Lane{}};
        add(result, n.by_u, taken.u, inner), add(result, n.by_v, taken.v, inner);
        result.by_exponents[taken.exponent] += n.by_exponent;
        return result;
    }

    INLINED Derivatives derivatives(const Lanes3 &q) const { // P1
        Lane terms[5] = {q[0], q[1], q[2], constant(1), Lane{}};
        Derivatives inner = norm_of(kind.inner, terms, Derivatives{});
        inner.value -= hole, inner.by_hole = constant(hole > 0 ? -1 : 0);
        terms[INNER] = inner.value;
        const Derivatives outer = norm_of(kind.outer, terms, inner);
        Derivatives f = kind.over == INNER ? inner : outer;
        if (kind.under == ONE)
            return f;
        Derivatives below = outer;
        if (kind.under == X) {
            below = Derivatives{most(size(q[0]), constant(LEAST_X)), {}, {}, Lane{}};
            below.by_point[0] = q[0] < 0 ? constant(-1) : constant(1);
        }
        f.value /= below.value;
        for (int a = 0; a < 3; ++a)
            f.by_point[a] = (f.by_point[a] - f.value * below.by_point[a]) / below.value;
        for (int a = 0; a < 2; ++a)
            f.by_exponents[a] = (f.by_exponents[a] - f.value * below.by_exponents[a]) / below.value;
        return f;
    }

    // Whether rays from the centre lead to the surface.
    INLINED bool radial() const { return hole == 0 && kind.powers[0] < 0 && kind.powers[1] < 0 && kind.powers[2] < 0; }

    // The surface point on the ray through q, where F is f; a tube's rays begin at its core.
    INLINED void project(Lanes3 &q, Lane f) const {
        if (hole > 0) {
            const Lane s = norm(q[0], q[1], exponents[1]).value, ring = (hole + (s - hole) / f) / s;
            q[0] *= ring, q[1] *= ring, q[2] /= f;
            return;
        }
        for (int a = 0; a < 3; ++a)
            if (kind.powers[a])
                q[a] = kind.powers[a] > 0 ? q[a] * f : q[a] / f; // 2.2
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

    INLINED void gradient_in_world(const Derivatives &at, Lanes3 &gradient) const {
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
        gradient_in_world(derivatives(q), result);
    }

    // Points onto the surface, and the gradient there; along a ray from the centre it is the same.
    INLINED void onto(Lanes3 &points, Lanes3 &gradient) const {
        Lanes3 q;
        scaled(points, q);
        Derivatives at = derivatives(q);
        project(q, at.value);
        if (!radial())
            at = derivatives(q);
        for (int a = 0; a < 3; ++a) {
            points[a] = constant(translation[a]);
            for (int b = 0; b < 3; ++b)
                points[a] += rotation[a][b] * axes[b] * q[b];
        }
        gradient_in_world(at, gradient);
    }
};

} // namespace quadriform
