// Signed first-order distances of points to superquadrics and their derivatives, as described in
// fitting/superquadric/levenberg_marquardt.py.
#pragma once

#include "superquadric.hpp"

namespace quadriform {

constexpr double FLATTEST = 1e-3; // least gradient of F, in units of one over the longest semi-axis

struct Evaluated {
    Derivatives at;
    Lanes3 scaled, by_local;
    Lane steepness;
};

INLINED Evaluated evaluated(const Surface &surface, const Lanes3 &local) {
    Evaluated result;
    Lane squared{};
    for (int a = 0; a < 3; ++a)
        result.scaled[a] = local[a] / surface.axes[a];
    result.at = surface.derivatives(result.scaled);
    for (int a = 0; a < 3; ++a) {
        result.by_local[a] = result.at.by_point[a] / surface.axes[a];
        squared += result.by_local[a] * result.by_local[a];
    }
    const double longest = std::max({surface.axes[0], surface.axes[1], surface.axes[2]});
    result.steepness = most(root(squared), constant(FLATTEST / longest));
    return result;
}

// Derivatives by log axes, exponents, a rotation and a shift in the surface's own frame, log(hole - 1).
INLINED Lane distance(const Surface &surface, const Lanes3 &point, Lane (&derivative)[12]) {
    Lanes3 local, foot, normal;
    surface.to_local(point, local);
    const Evaluated at_point = evaluated(surface, local);
    const Lane result = (at_point.at.value - 1) / at_point.steepness; // P4
    for (int a = 0; a < 3; ++a)
        foot[a] = local[a] - result * at_point.by_local[a] / at_point.steepness;
    const Evaluated at_foot = evaluated(surface, foot);
    for (int a = 0; a < 3; ++a) {
        normal[a] = at_foot.by_local[a] / at_foot.steepness;
        derivative[a] = -at_foot.scaled[a] * at_foot.at.by_point[a] / at_foot.steepness;
        derivative[8 + a] = -normal[a];
    }
    for (int a = 0; a < 2; ++a)
        derivative[3 + a] = at_foot.at.by_exponents[a] / at_foot.steepness;
    for (int a = 0; a < 3; ++a) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        derivative[5 + a] = normal[b] * foot[c] - normal[c] * foot[b];
    }
    derivative[11] = at_foot.at.by_hole / at_foot.steepness * (surface.hole - 1);
    return result;
}

// Of (n, 3) points to one surface: (n,) and (parameters, n).
WIDEST_REGISTERS
inline void distances_to(const Surface &surface, const double *points, std::size_t n, double *out, double *derivatives,
                         std::size_t parameters) {
    Lanes3 point;
    Lane derivative[12];
    for (std::size_t first = 0; first < n; first += LANES) {
        load(points, first, n, point);
        const Lane found = distance(surface, point, derivative);
        for (std::size_t w = 0; w < LANES && first + w < n; ++w) {
            out[first + w] = found[w];
            for (std::size_t p = 0; p < parameters; ++p)
                derivatives[p * n + first + w] = derivative[p][w];
        }
    }
}

} // namespace quadriform
