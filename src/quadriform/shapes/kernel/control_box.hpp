// The free-form deformation at four points at once (paper, appendix B).
#pragma once

#include "lanes.hpp"

namespace quadriform {

struct Box {
    double origin[3], to_local[3][3]; // s, t, u = to_local (x - origin)
    int count[3];                     // control points along each axis
    std::vector<double> control;      // (l + 1, m + 1, n + 1, 3)
    std::vector<double> binomials[3], lower[3];

    void finish() {
        for (int a = 0; a < 3; ++a) {
            binomials[a] = pascal(count[a] - 1);
            lower[a] = count[a] > 1 ? pascal(count[a] - 2) : std::vector<double>();
        }
    }

    static std::vector<double> pascal(int degree) {
        std::vector<double> row(degree + 1, 1.0);
        for (int i = 1; i <= degree; ++i)
            row[i] = row[i - 1] * (degree - i + 1) / i;
        return row;
    }
};

// Room for the basis along each axis and its derivative.
struct Basis {
    typedef double Loose __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double))));
    struct Four { // on the heap, where no alignment is guaranteed
        Loose of;
    };
    std::vector<Four> value[3], derivative[3], up, down;

    explicit Basis(const Box &box) {
        int most = 0;
        for (int a = 0; a < 3; ++a) {
            value[a].resize(box.count[a]);
            derivative[a].resize(box.count[a]);
            most = std::max(most, box.count[a]);
        }
        up.resize(most);
        down.resize(most);
    }

    // B_i(s) = C(l, i) (1 - s)^(l - i) s^i and, if asked, d B_i / ds = l (B_{i-1} - B_i) of degree l - 1.
    template <bool GRADIENT> INLINED void at(const Box &box, int axis, Lane s) {
        const int count = box.count[axis], degree = count - 1;
        up[0].of = down[0].of = Lane{} + 1.0;
        for (int i = 1; i < count; ++i)
            up[i].of = up[i - 1].of * s, down[i].of = down[i - 1].of * (1 - s);
        for (int i = 0; i < count; ++i)
            value[axis][i].of = box.binomials[axis][i] * up[i].of * down[degree - i].of; // a factor of P18, P19
        if (!GRADIENT)
            return;
        for (int i = 0; i < count; ++i) {
            Lane difference{};
            if (i > 0)
                difference += box.lower[axis][i - 1] * up[i - 1].of * down[degree - i].of;
            if (i < degree)
                difference -= box.lower[axis][i] * up[i].of * down[degree - 1 - i].of;
            derivative[axis][i].of = degree * difference;
        }
    }
};

template <class Terms> INLINED void add(Lanes3 &sum, const Terms &terms, Lane factor) {
    for (int a = 0; a < 3; ++a)
        sum[a] += terms[a] * factor;
}

// Where the box carries points, and the derivatives (coordinate by coordinate) if asked.
template <bool GRADIENT>
INLINED void evaluate(const Box &box, Basis &basis, const Lanes3 &point, Lanes3 &carried, Lanes33 &jacobian) {
    for (int axis = 0; axis < 3; ++axis) {
        Lane s{};
        for (int a = 0; a < 3; ++a)
            s += box.to_local[axis][a] * (point[a] - box.origin[a]); // P15, P16
        basis.at<GRADIENT>(box, axis, s);
    }
    Lanes3 sum{}, by_s{}, by_t{}, by_u{};
    const double *control = box.control.data();
    for (int i = 0; i < box.count[0]; ++i) {
        Lanes3 row{}, row_t{}, row_u{};
        for (int j = 0; j < box.count[1]; ++j) {
            Lanes3 line{}, line_u{};
            for (int k = 0; k < box.count[2]; ++k, control += 3) {
                add(line, control, basis.value[2][k].of);
                if (GRADIENT)
                    add(line_u, control, basis.derivative[2][k].of);
            }
            add(row, line, basis.value[1][j].of);
            if (GRADIENT)
                add(row_t, line, basis.derivative[1][j].of);
            if (GRADIENT)
                add(row_u, line_u, basis.value[1][j].of);
        }
        add(sum, row, basis.value[0][i].of); // P19
        if (GRADIENT)
            add(by_s, row, basis.derivative[0][i].of);
        if (GRADIENT)
            add(by_t, row_t, basis.value[0][i].of);
        if (GRADIENT)
            add(by_u, row_u, basis.value[0][i].of);
    }
    for (int a = 0; a < 3; ++a) {
        carried[a] = sum[a];
        for (int b = 0; GRADIENT && b < 3; ++b)
            jacobian[a][b] = by_s[a] * box.to_local[0][b] + by_t[a] * box.to_local[1][b] + by_u[a] * box.to_local[2][b];
    }
}

} // namespace quadriform
