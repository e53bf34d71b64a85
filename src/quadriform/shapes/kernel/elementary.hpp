// Exponential, logarithm and square root of four numbers at once: libraries take them one by one, at ten times the
// cost. Relative errors are a few units in the last place.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "lanes.hpp"

namespace quadriform {

using Bits = std::int64_t __attribute__((vector_size(LANES * sizeof(double))));

constexpr double LN2_HIGH = 0x1.62e42fefa38p-1, LN2_LOW = 0x1.ef35793c7673p-45;
constexpr double SHIFTER = 0x1.8p52; // added to a small whole number, puts it into the lowest bits

INLINED Bits bits_of(Lane x) {
    Bits result;
    std::memcpy(&result, &x, sizeof x);
    return result;
}

INLINED Lane of_bits(Bits x) {
    Lane result;
    std::memcpy(&result, &x, sizeof x);
    return result;
}

INLINED Lane most(Lane a, Lane b) {
    return a > b ? a : b;
}
INLINED Lane least(Lane a, Lane b) {
    return a < b ? a : b;
}
INLINED Lane size(Lane x) {
    return of_bits(bits_of(x) & 0x7fffffffffffffff);
}
INLINED Lane constant(double x) {
    return Lane{} + x;
}

INLINED Lane root(Lane x) {
    Lane result;
    for (int w = 0; w < LANES; ++w)
        result[w] = std::sqrt(x[w]);
    return result;
}

// c0 + c1 x + ... + c15 x^15, four terms at a time: one after the other each would wait for the last (Estrin).
INLINED Lane polynomial(Lane x, const double (&c)[16]) {
    const Lane x2 = x * x, x4 = x2 * x2;
    Lane part[4];
    for (int k = 0; k < 4; ++k)
        part[k] = (c[4 * k] + c[4 * k + 1] * x) + (c[4 * k + 2] + c[4 * k + 3] * x) * x2;
    return (part[0] + part[1] * x4) + (part[2] + part[3] * x4) * (x4 * x4);
}

// e^x for finite x; as at -708 below, where it vanishes for all that is asked of it.
INLINED Lane exponential(Lane x) {
    x = least(most(x, constant(-708)), constant(708));
    const Lane shifted = x * 1.44269504088896340736 + SHIFTER, n = shifted - SHIFTER;
    const Lane r = (x - n * LN2_HIGH) - n * LN2_LOW; // |r| < 0.35
    const Lane sum =
        polynomial(r, {1, 1, 1.0 / 2, 1.0 / 6, 1.0 / 24, 1.0 / 120, 1.0 / 720, 1.0 / 5040, 1.0 / 40320, 1.0 / 362880,
                       1.0 / 3628800, 1.0 / 39916800, 1.0 / 479001600, 1.0 / 6227020800, 0, 0});
    return of_bits(bits_of(sum) + (bits_of(shifted) << 52));
}

// log x for normal positive x: x = 2^e m with m in [0.7, 1.42), and 2 artanh((m - 1) / (m + 1)).
INLINED Lane logarithm(Lane x) {
    const Bits raised = bits_of(x) - 0x3fe6a09e667f3bcd; // the bits of the square root of one half
    const Bits whole = raised >> 52;
    const Lane m = of_bits(bits_of(x) - (whole << 52));
    const Lane e = of_bits(whole + bits_of(constant(SHIFTER))) - SHIFTER;
    const Lane f = (m - 1) / (m + 1), square = f * f;
    const Lane sum = polynomial(square, {2.0 / 3, 2.0 / 5, 2.0 / 7, 2.0 / 9, 2.0 / 11, 2.0 / 13, 2.0 / 15, 2.0 / 17,
                                         2.0 / 19, 2.0 / 21, 2.0 / 23, 0, 0, 0, 0, 0});
    return e * LN2_HIGH + (2 * f + (f * square * sum + e * LN2_LOW));
}

} // namespace quadriform
