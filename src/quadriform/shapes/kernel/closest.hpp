// Foot points on the deformed surface, each by itself: damped steps in the tangent plane, as closest.py describes.
#pragma once

#include "control_box.hpp"
#include "superquadric.hpp"

namespace quadriform {

// As fractions of the box's diagonal.
constexpr double LONGEST = 0.2;     // of all steps
constexpr double KICK = 0.01;       // least step away from a maximum of the distance
constexpr double SURE = 1e-6;       // a shorter step is taken without comparing distances, which rounding decides
constexpr double CONVERGED = 1e-8;  // a shorter step is the last
constexpr double DIFFERENCE = 1e-6; // over which normals are differenced

struct Vector {
    double x[3];
    INLINED double dot(const Vector &o) const { return x[0] * o.x[0] + x[1] * o.x[1] + x[2] * o.x[2]; }
    INLINED double length() const { return std::sqrt(dot(*this)); }
    INLINED Vector operator+(const Vector &o) const { return {x[0] + o.x[0], x[1] + o.x[1], x[2] + o.x[2]}; }
    INLINED Vector operator-(const Vector &o) const { return {x[0] - o.x[0], x[1] - o.x[1], x[2] - o.x[2]}; }
    INLINED Vector operator*(double f) const { return {f * x[0], f * x[1], f * x[2]}; }
    INLINED Vector cross(const Vector &o) const {
        return {x[1] * o.x[2] - x[2] * o.x[1], x[2] * o.x[0] - x[0] * o.x[2], x[0] * o.x[1] - x[1] * o.x[0]};
    }
    INLINED Vector unit() const { return *this * (1 / std::max(length(), TINY)); }
};

INLINED Vector lane(const Lanes3 &of, int w) {
    return {of[0][w], of[1][w], of[2][w]};
}
INLINED void put(const Vector &v, Lanes3 &into, int w) {
    for (int a = 0; a < 3; ++a)
        into[a][w] = v.x[a];
}

// Points of the surface after deformation, and the gradient of F before deformation.
struct SurfacePoint {
    Lanes3 carried, gradient;
    Lanes33 jacobian;

    INLINED void at(const Box &box, const Surface &surface, Basis &basis, const Lanes3 &origins) {
        evaluate<true>(box, basis, origins, carried, jacobian);
        surface.gradient(origins, gradient);
    }

    // The same after origins beside the surface were projected back onto it.
    INLINED void onto(const Box &box, const Surface &surface, Basis &basis, Lanes3 &origins) {
        surface.onto(origins, gradient);
        evaluate<true>(box, basis, origins, carried, jacobian);
    }

    INLINED Vector row(int a, int w) const { return {jacobian[a][0][w], jacobian[a][1][w], jacobian[a][2][w]}; }

    INLINED Vector deformed_direction(const Vector &v, int w) const {
        return {row(0, w).dot(v), row(1, w).dot(v), row(2, w).dot(v)};
    }

    // Unit outward normal of the deformed surface.
    INLINED Vector normal(int w) const {
        const Vector g = lane(gradient, w), r0 = row(0, w), r1 = row(1, w), r2 = row(2, w);
        return Vector{r1.cross(r2).dot(g), r2.cross(r0).dot(g), r0.cross(r1).dot(g)}.unit();
    }

    // Two unit tangents of the undeformed surface.
    INLINED void tangents(int w, Vector &first, Vector &second) const {
        const Vector n = lane(gradient, w).unit();
        int least = 0;
        for (int a = 1; a < 3; ++a)
            if (std::fabs(n.x[a]) < std::fabs(n.x[least]))
                least = a;
        Vector helper{0, 0, 0};
        helper.x[least] = 1;
        first = helper.cross(n).unit();
        second = n.cross(first);
    }
};

// A step in the tangent plane to where the deformed plane is nearest to the target (Gauss and Newton).
INLINED Vector flat_step(const SurfacePoint &current, int w, const Vector &residual, double damping, double diagonal) {
    Vector first, second;
    current.tangents(w, first, second);
    const Vector one = current.deformed_direction(first, w), other = current.deformed_direction(second, w);
    double a = one.dot(one), b = one.dot(other), c = other.dot(other);
    const double slack = (damping + 1e-12) * (a + c) + TINY;
    a += slack, c += slack;
    const double along_first = one.dot(residual), along_second = other.dot(residual), area = a * c - b * b;
    const Vector move =
        first * ((c * along_first - b * along_second) / area) + second * ((a * along_second - b * along_first) / area);
    return move * std::min(1.0, LONGEST * diagonal / std::max(move.length(), TINY));
}

// A few Gauss-Newton steps of (n, 3) origins towards their targets; no foot point gets worse.
WIDEST_REGISTERS
void update_block(const Box &box, const Surface &surface, double diagonal, const double *targets, double *origins,
                  std::size_t start, std::size_t stop, std::size_t n, int steps) {
    Basis basis(box);
    SurfacePoint current, moved;
    for (std::size_t first = start; first < stop; first += LANES) {
        Lanes3 target, origin, trial;
        Lane damping;
        load(targets, first, n, target), load(origins, first, n, origin);
        damping = Lane{} + 1e-9;
        current.at(box, surface, basis, origin);
        for (int step_number = 0; step_number < steps; ++step_number) {
            for (int w = 0; w < LANES; ++w)
                put(lane(origin, w) +
                        flat_step(current, w, lane(target, w) - lane(current.carried, w), damping[w], diagonal),
                    trial, w);
            moved.onto(box, surface, basis, trial);
            for (int w = 0; w < LANES; ++w) {
                const Vector remaining = lane(target, w) - lane(moved.carried, w),
                             residual = lane(target, w) - lane(current.carried, w);
                const bool closer = remaining.dot(remaining) <= residual.dot(residual);
                damping[w] = closer ? 0.1 * damping[w] : std::max(10 * damping[w], 1.0);
                if (!closer)
                    continue;
                put(lane(trial, w), origin, w), put(lane(moved.carried, w), current.carried, w),
                    put(lane(moved.gradient, w), current.gradient, w);
                for (int a = 0; a < 3; ++a)
                    for (int b = 0; b < 3; ++b)
                        current.jacobian[a][b][w] = moved.jacobian[a][b][w];
            }
        }
        store(origin, first, n, origins);
    }
}

// A step of an origin, the gain in squared distance that it predicts, and the least curvature of half the squared
// distance with its undeformed direction.
struct Step {
    Vector move, weak;
    double promised, least;
};

// The Hessian where the deformed tangents are orthonormal is 1 + distance x shape; the shape operator is the
// difference of two nearby normals. A maximum of the distance is left downhill.
INLINED Step newton_step(const Vector (&undeformed)[2], const Vector (&tangents)[2], const Vector (&ahead)[2],
                         const Vector &normal, const Vector &residual, double damping, double diagonal) {
    const double h = DIFFERENCE * diagonal, height = residual.dot(normal);
    double shape[2][2];
    for (int a = 0; a < 2; ++a)
        for (int b = 0; b < 2; ++b)
            shape[a][b] = tangents[a].dot(ahead[b] - normal) / h;
    const double p = 1 + height * shape[0][0], r = 1 + height * shape[1][1];
    const double q = height * (shape[0][1] + shape[1][0]) / 2, half = (p - r) / 2, spread = std::hypot(half, q);
    const double curvature[2] = {(p + r) / 2 - spread, (p + r) / 2 + spread};
    const double angle = 0.5 * std::atan2(q, half), cosine = std::cos(angle), sine = std::sin(angle);
    const double axes[2][2] = {{-sine, cosine}, {cosine, sine}}; // of the smaller and the larger curvature
    Step step{{{0, 0, 0}}, undeformed[0] * axes[0][0] + undeformed[1] * axes[0][1], 0, curvature[0]};
    double along[2], projected[2];
    for (int b = 0; b < 2; ++b) {
        const double size = std::fabs(curvature[b]);
        projected[b] = (tangents[0] * axes[b][0] + tangents[1] * axes[b][1]).dot(residual);
        const double kicked = std::copysign(std::max(std::fabs(projected[b]), KICK * diagonal * size), projected[b]);
        along[b] = (curvature[b] < 0 ? kicked : projected[b]) / (std::max(size, 1e-6) + damping);
        step.move = step.move + (undeformed[0] * axes[b][0] + undeformed[1] * axes[b][1]) * along[b];
    }
    const double shorter = std::min(1.0, LONGEST * diagonal / std::max(step.move.length(), TINY));
    for (int b = 0; b < 2; ++b)
        step.promised += shorter * along[b] * (2 * projected[b] - shorter * curvature[b] * along[b]);
    step.move = step.move * shorter, step.weak = step.weak.unit();
    return step;
}

// Damped Newton steps of four origins until all have converged; a step that leads away is rejected and shortened.
struct Newton {
    const Box &box;
    const Surface &surface;
    double diagonal;
    Basis basis;
    Lanes3 target, origin, trial;
    Lane damping;
    bool active[LANES];
    SurfacePoint current, moved, beside[2];
    Step step[LANES];

    Newton(const Box &b, const Surface &s, double d) : box(b), surface(s), diagonal(d), basis(b) {}

    INLINED void propose() {
        Vector undeformed[LANES][2], tangents[LANES][2];
        Lanes3 shifted[2];
        for (int w = 0; w < LANES; ++w) {
            Vector frame[2];
            current.tangents(w, frame[0], frame[1]);
            const Vector one = current.deformed_direction(frame[0], w), other = current.deformed_direction(frame[1], w);
            double a = one.dot(one), b = one.dot(other), c = other.dot(other);
            const double slack = 1e-14 * (a + c) + TINY;
            a = std::sqrt(a + slack), b /= a, c = std::sqrt(c + slack - b * b);
            const double unroll[2][2] = {{1 / a, 0}, {-b / (a * c), 1 / c}};
            for (int k = 0; k < 2; ++k) {
                undeformed[w][k] = frame[0] * unroll[k][0] + frame[1] * unroll[k][1];
                tangents[w][k] = one * unroll[k][0] + other * unroll[k][1];
                put(lane(origin, w) + undeformed[w][k] * (DIFFERENCE * diagonal), shifted[k], w);
            }
        }
        for (int k = 0; k < 2; ++k)
            beside[k].at(box, surface, basis, shifted[k]);
        for (int w = 0; w < LANES; ++w) {
            const Vector ahead[2] = {beside[0].normal(w), beside[1].normal(w)};
            const Vector residual = lane(target, w) - lane(current.carried, w);
            step[w] = newton_step(undeformed[w], tangents[w], ahead, tangents[w][0].cross(tangents[w][1]).unit(),
                                  residual, damping[w], diagonal);
            put(lane(origin, w) + step[w].move, trial, w);
        }
    }

    INLINED void decide(int w) {
        const Vector residual = lane(target, w) - lane(current.carried, w),
                     step_taken = lane(moved.carried, w) - lane(current.carried, w);
        const double gained = step_taken.dot(residual * 2 - step_taken), length = step[w].move.length();
        if (gained > 0 || length < SURE * diagonal) {
            put(lane(trial, w), origin, w), put(lane(moved.carried, w), current.carried, w),
                put(lane(moved.gradient, w), current.gradient, w);
            for (int a = 0; a < 3; ++a)
                for (int b = 0; b < 3; ++b)
                    current.jacobian[a][b][w] = moved.jacobian[a][b][w];
        }
        damping[w] = gained < 0.25 * step[w].promised ? 10 * std::max(damping[w], 1e-2) : 0.1 * damping[w];
        active[w] = length > CONVERGED * diagonal && damping[w] < 1e8;
    }
};

WIDEST_REGISTERS
void converge_block(const Box &box, const Surface &surface, double diagonal, const double *targets, double *origins,
                    double *points, double *least, double *weak, std::size_t start, std::size_t stop, std::size_t n,
                    int steps) {
    Newton s(box, surface, diagonal);
    for (std::size_t first = start; first < stop; first += LANES) {
        Lanes3 direction;
        Lane curvature;
        load(targets, first, n, s.target), load(origins, first, n, s.origin);
        s.damping = Lane{} + 1e-6, std::fill(s.active, s.active + LANES, true);
        s.current.at(box, surface, s.basis, s.origin);
        for (int step_number = 0;
             step_number < steps && std::any_of(s.active, s.active + LANES, [](bool a) { return a; }); ++step_number) {
            s.propose();
            s.moved.onto(box, surface, s.basis, s.trial);
            for (int w = 0; w < LANES; ++w) {
                if (!s.active[w])
                    continue;
                curvature[w] = s.step[w].least, put(s.step[w].weak, direction, w);
                s.decide(w);
            }
        }
        store(s.origin, first, n, origins), store(s.current.carried, first, n, points),
            store(direction, first, n, weak);
        for (std::size_t w = 0; w < LANES && first + w < n; ++w)
            least[first + w] = curvature[w];
    }
}

} // namespace quadriform
