// Points are taken four at a time, coordinate by coordinate, so that the compiler can use its vector registers; and
// in blocks that any number of threads may share: no sum runs over points, so results do not depend on how many.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__)
#define WIDEST_REGISTERS __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define WIDEST_REGISTERS
#endif
#if defined(__GNUC__)
#define INLINED inline __attribute__((always_inline))
#else
#define INLINED inline
#endif

namespace quadriform {

constexpr int LANES = 4;
constexpr std::size_t BLOCK = 256 * LANES;

using Lane = double __attribute__((vector_size(LANES * sizeof(double)))); // of GCC and Clang; one number of each point
using Lanes3 = Lane[3];
using Lanes33 = Lane[3][3];

// Points first .. first + LANES of (n, 3) rows; the last one again where there are no more.
INLINED void load(const double *rows, std::size_t first, std::size_t n, Lanes3 &into) {
    for (int w = 0; w < LANES; ++w) {
        const double *row = rows + 3 * std::min(first + w, n - 1);
        for (int a = 0; a < 3; ++a)
            into[a][w] = row[a];
    }
}

INLINED void store(const Lanes3 &from, std::size_t first, std::size_t n, double *rows) {
    for (std::size_t w = 0; w < LANES && first + w < n; ++w)
        for (int a = 0; a < 3; ++a)
            rows[3 * (first + w) + a] = from[a][w];
}

// body(start, stop) for blocks of 0 .. n on so many threads.
template <class Body> void in_blocks(std::size_t n, int threads, Body body) {
    std::atomic<std::size_t> next{0};
    auto work = [&] {
        for (std::size_t start; (start = next.fetch_add(BLOCK)) < n;)
            body(start, std::min(start + BLOCK, n));
    };
    std::vector<std::thread> others;
    const auto useful = static_cast<int>(std::min<std::size_t>((n + BLOCK - 1) / BLOCK, 1024));
    for (int t = 1; t < std::min(threads, useful); ++t)
        others.emplace_back(work);
    work();
    for (auto &other : others)
        other.join();
}

} // namespace quadriform
