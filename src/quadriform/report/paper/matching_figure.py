"""Fig. 4: distances to a superellipsoid, and the two directions of matching."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from scipy.spatial import cKDTree

from quadriform.fitting.result import rms
from quadriform.points import Array
from quadriform.report.page import texts
from quadriform.report.paper import drawing
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import FIGURES, NOT, SAME, Remake, beside, listed, shown
from quadriform.report.paper.robustness import DIRECTIONS, Matching
from quadriform.report.paper.subjects import SYNTHETIC
from quadriform.report.parts import table, tiles
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

FLAT = Superquadric(semi_axes=np.array((50.0, 30.0, 30.0)), exponents=np.array((0.6, 1.0)))
"""Its section through the x and z axes is drawn."""
OUTSIDE = np.array([[52.0, 0.0, 38.0]])
"""The point M, left."""
INSIDE = np.array([[12.0, 0.0, 0.0]])
"""The point N, left."""
RADIAL, FIRST, TAUBIN = "radial |M0 M|", "first order (P4)", "second order (Taubin)"
EXACT = "exact |M P|"
Lengths = Mapping[str, Array]
"""Distances by the name of their definition."""
ROUNDING = 1e-9
"""A distance is above another if it is by more than this share of it."""


def distances(material: Material) -> Remake:
    """Fig. 4."""
    radial, nearest = FLAT.project(OUTSIDE), _alone(FLAT).closest(OUTSIDE)
    subject = material.crossing
    of_two = _lengths(FLAT, np.concatenate([OUTSIDE, INSIDE]))
    of_data = _lengths(subject.paper.model.superquadric(), subject.cloud)
    pictures = [
        ("distances of M", drawing.plane(lambda axes: _draw_distances(axes, radial[0], nearest[0]), "distances of M")),
        ("two closest points of M", drawing.plane(_draw_matching, "two closest points of M")),
    ]
    found = material.matchings
    return Remake(
        "4",
        _words(of_two, of_data) | {"subject": subject.name} | _judged(found),
        [shown("4", tiles(pictures, "charts"), SYNTHETIC)],
        [],
        [
            table(texts(FIGURES)["4"]["measured"], _distance_rows(of_two, of_data)),
            table(texts(FIGURES)["4"]["matched"], [_row(name, each) for name, each in found.items()]),
        ],
    )


def _alone(superquadric: Superquadric) -> DeformableModel:
    return DeformableModel({"surface": superquadric}, ControlBox.around(superquadric, (2, 2, 2)))


def _lengths(superquadric: Superquadric, points: Array) -> dict[str, Array]:
    """Distances of points (n, 3) to a superellipsoid, (n,) each, the exact one last."""
    return {
        RADIAL: superquadric.radial_distance(points),
        FIRST: superquadric.first_order_distance(points),
        TAUBIN: superquadric.taubin_distance(points),
        EXACT: np.abs(_alone(superquadric).distance(points)),
    }


def _distance_rows(of_two: Lengths, of_data: Lengths) -> list[tuple[str, ...]]:
    exact = of_data[EXACT]
    return [
        (
            name,
            *(f"{length:.3g}" for length in of_two[name]),
            f"{rms(values):.3f}",
            NOT if name == EXACT else f"{_wrong(values, exact):.3f}",
            NOT if name == EXACT else f"{_above(values, exact):.0%}",
        )
        for name, values in of_data.items()
    ]


def _above(values: Array, exact: Array) -> float:
    """Fraction of the points whose distance is overestimated."""
    # points on the surface have two distances of nearly zero, which rounding orders
    return float((values > (1 + ROUNDING) * exact).mean())


def _words(of_two: Lengths, of_data: Lengths) -> dict[str, object]:
    """How near each approximation is, and on which side, for M, for N and for the data."""
    approximations = (RADIAL, FIRST, TAUBIN)
    exact = of_data[EXACT]
    m, n = ([float(of_two[each][k] / of_two[EXACT][k]) for each in approximations] for k in (0, 1))
    wrong = [_wrong(of_data[each], exact) for each in approximations]
    return {
        "m": m,
        "n": n,
        "count": len(exact),
        "above": [_above(of_data[each], exact) for each in approximations],
        "wrong": wrong,
        "precise": "more" if wrong[2] < wrong[1] else "not more",
    }


def _wrong(values: Array, exact: Array) -> float:
    return rms(values - exact)


def _row(name: str, each: Matching) -> tuple[str, ...]:
    return name, f"{each.count:,}", *(f"{each.directions[d]:.3f}" for d in DIRECTIONS), f"{each.default:.3f}"


def _judged(found: dict[str, Matching]) -> dict[str, object]:
    """One sentence for dense data and one for sparse, from the errors of both directions."""
    sentences = []
    for kind in ("dense", "sparse"):
        each = {name.removeprefix(f"{kind}: "): m for name, m in found.items() if name.startswith(kind)}
        parts = [f"{beside(*(m.directions[d] for d in DIRECTIONS))} on {name} ({_both(m)})" for name, m in each.items()]
        sentences.append(
            f"On {kind} data the error of the paper's direction, beside that of the other, is {listed(parts)}."
        )
    pairs = [[m.directions[name] for name in DIRECTIONS] for m in found.values()]
    nearer, farther = (sum(pair[k] < (1 - SAME) * pair[1 - k] for pair in pairs) for k in (0, 1))
    return {"matchings": " ".join(sentences), "nearer": nearer, "farther": farther, "cases": len(pairs)}


def _both(each: Matching) -> str:
    return " and ".join(f"{each.directions[name]:.3f}" for name in DIRECTIONS) + " mm"


def _draw_distances(axes: Axes, radial: Array, nearest: Array) -> None:
    # latitude through the poles at longitude 0: the section in the plane of x and z
    section = FLAT.natural(np.stack([np.linspace(-np.pi, np.pi, 200), np.zeros(200)], 1))
    axes.plot(section[:, 0], section[:, 2], color=drawing.GREY)
    m = OUTSIDE[0]
    axes.plot([0, m[0]], [0, m[2]], ":", color=drawing.GREY)
    for point, colour in ((radial, drawing.BY_PAPER), (nearest, drawing.BY_DEFAULT)):
        axes.plot([m[0], point[0]], [m[2], point[2]], color=colour)
    offsets = {"O": (-14, -8), "M": (5, 3), "M0": (-8, -17), "P": (8, -12), "N": (4, -14)}
    for name, point in (("O", np.zeros(3)), ("N", INSIDE[0]), ("M", m), ("M0", radial), ("P", nearest)):
        axes.plot(point[0], point[2], "o", color=drawing.GREY, markersize=4)
        axes.annotate(name, (point[0], point[2]), offsets[name], textcoords="offset points")


def _draw_matching(axes: Axes) -> None:
    """A smooth model S under data D with a deep notch."""
    x = np.linspace(-40, 40, 161)
    model = np.stack([x, 12 - x**2 / 160], 1)
    data = np.stack([x, 27 - x**2 / 160 - 13 * np.exp(-((x - 9) ** 2) / 25)], 1)
    m = model[np.argmin(np.abs(x))]
    # model to data: M asks for its nearest data point; data to model: the data point that asks for M
    nearest = data[cKDTree(data).query(m)[1]]
    chosen = cKDTree(model).query(data)[1]
    asking = data[np.argmin(np.linalg.norm(model[chosen] - m, axis=1))]
    axes.plot(*model.T, color=drawing.GREY)
    axes.plot(*data.T, color=drawing.ORANGE)
    for point, name, colour in ((nearest, "P'", drawing.PINK), (asking, "P", drawing.BY_PAPER)):
        axes.plot(*np.stack([m, point]).T, color=colour)
        axes.annotate(name, point, (3, 5), textcoords="offset points")
    for name, point in (("M", m), ("S", model[10]), ("D", data[10])):
        axes.annotate(name, point, (-6, -16), textcoords="offset points")
