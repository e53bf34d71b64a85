// What Python sees of the kernel: arrays of points in, arrays of points filled.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "closest.hpp"
#include "distances.hpp"

namespace nb = nanobind;
using namespace quadriform;

using In = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using Codes = nb::ndarray<const int, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<double, nb::c_contig, nb::device::cpu>;

static Box make_box(In origin, In to_local, In control) {
    Box box;
    for (int a = 0; a < 3; ++a) {
        box.origin[a] = origin.data()[a];
        box.count[a] = static_cast<int>(control.shape(a));
        for (int b = 0; b < 3; ++b)
            box.to_local[a][b] = to_local.data()[3 * a + b];
    }
    box.control.assign(control.data(), control.data() + control.size());
    box.finish();
    return box;
}

static Kind make_kind(Codes kind) {
    const int *at = kind.data();
    return {{at[0], at[1], at[2]}, {at[3], at[4], at[5]}, at[6], at[7], {at[8], at[9], at[10]}};
}

static Surface make_surface(Codes kind, In axes, In exponents, In rotation, In translation, double hole) {
    Surface surface{make_kind(kind), {}, {}, {}, {}, hole};
    for (int a = 0; a < 3; ++a) {
        surface.axes[a] = axes.data()[a], surface.translation[a] = translation.data()[a];
        for (int b = 0; b < 3; ++b)
            surface.rotation[a][b] = rotation.data()[3 * a + b];
    }
    for (int a = 0; a < 2; ++a)
        surface.exponents[a] = exponents.data()[a];
    return surface;
}

WIDEST_REGISTERS
static void deform_block(const Box &box, const double *points, double *out, std::size_t start, std::size_t stop,
                         std::size_t n) {
    Basis basis(box);
    Lanes3 point, carried;
    Lanes33 unused;
    for (std::size_t first = start; first < stop; first += LANES) {
        load(points, first, n, point);
        evaluate<false>(box, basis, point, carried, unused);
        store(carried, first, n, out);
    }
}

WIDEST_REGISTERS
static void jacobian_block(const Box &box, const double *points, double *out, std::size_t start, std::size_t stop,
                           std::size_t n) {
    Basis basis(box);
    Lanes3 point, carried;
    Lanes33 jacobian;
    for (std::size_t first = start; first < stop; first += LANES) {
        load(points, first, n, point);
        evaluate<true>(box, basis, point, carried, jacobian);
        for (std::size_t w = 0; w < LANES && first + w < n; ++w)
            for (int a = 0; a < 9; ++a)
                out[9 * (first + w) + a] = jacobian[a / 3][a % 3][w];
    }
}

WIDEST_REGISTERS
static void normals_block(const Box &box, const Surface &surface, const double *origins, double *points,
                          double *normals, std::size_t start, std::size_t stop, std::size_t n) {
    Basis basis(box);
    SurfacePoint current;
    Lanes3 origin, normal;
    for (std::size_t first = start; first < stop; first += LANES) {
        load(origins, first, n, origin);
        current.at(box, surface, basis, origin);
        for (int w = 0; w < LANES; ++w)
            put(current.normal(w), normal, w);
        store(current.carried, first, n, points), store(normal, first, n, normals);
    }
}

static void deform(const Box &box, In points, Out out, int threads) {
    const std::size_t n = points.shape(0);
    in_blocks(n, threads, [&](std::size_t i, std::size_t j) { deform_block(box, points.data(), out.data(), i, j, n); });
}

static void jacobian(const Box &box, In points, Out out, int threads) {
    const std::size_t n = points.shape(0);
    in_blocks(n, threads,
              [&](std::size_t i, std::size_t j) { jacobian_block(box, points.data(), out.data(), i, j, n); });
}

static void normals(const Box &box, const Surface &surface, In origins, Out points, Out result, int threads) {
    const std::size_t n = origins.shape(0);
    in_blocks(n, threads, [&](std::size_t i, std::size_t j) {
        normals_block(box, surface, origins.data(), points.data(), result.data(), i, j, n);
    });
}

static void update_foot_points(const Box &box, const Surface &surface, double diagonal, In targets, Out origins,
                               int steps, int threads) {
    const std::size_t n = targets.shape(0);
    in_blocks(n, threads, [&](std::size_t i, std::size_t j) {
        update_block(box, surface, diagonal, targets.data(), origins.data(), i, j, n, steps);
    });
}

static void converge_foot_points(const Box &box, const Surface &surface, double diagonal, In targets, Out origins,
                                 Out points, Out least, Out weak, int steps, int threads) {
    const std::size_t n = targets.shape(0);
    in_blocks(n, threads, [&](std::size_t i, std::size_t j) {
        converge_block(box, surface, diagonal, targets.data(), origins.data(), points.data(), least.data(), weak.data(),
                       i, j, n, steps);
    });
}

// Of all points to each of many superquadrics of a kind: (M, n), (M, parameters, n).
static void distances(Codes kind, In axes, In exponents, In rotations, In translations, In holes, In points, Out out,
                      Out derivatives) {
    const std::size_t n = points.shape(0), parameters = derivatives.shape(1);
    for (std::size_t m = 0; m < axes.shape(0); ++m) {
        Surface surface{make_kind(kind), {}, {}, {}, {}, holes.data()[m]};
        std::copy_n(axes.data() + 3 * m, 3, surface.axes), std::copy_n(exponents.data() + 2 * m, 2, surface.exponents);
        std::copy_n(rotations.data() + 9 * m, 9, &surface.rotation[0][0]),
            std::copy_n(translations.data() + 3 * m, 3, surface.translation);
        distances_to(surface, points.data(), n, out.data() + m * n, derivatives.data() + m * parameters * n,
                     parameters);
    }
}

NB_MODULE(_kernel, m) {
    using NoLock = nb::call_guard<nb::gil_scoped_release>;
    nb::class_<Box>(m, "Box").def("__init__", [](Box *at, In o, In l, In c) { new (at) Box(make_box(o, l, c)); });
    nb::class_<Surface>(m, "Surface").def("__init__", [](Surface *at, Codes k, In a, In e, In r, In t, double h) {
        new (at) Surface(make_surface(k, a, e, r, t, h));
    });
    m.def("deform", &deform, NoLock());
    m.def("jacobian", &jacobian, NoLock());
    m.def("normals", &normals, NoLock());
    m.def("update_foot_points", &update_foot_points, NoLock());
    m.def("converge_foot_points", &converge_foot_points, NoLock());
    m.def("distances", &distances, NoLock());
}
