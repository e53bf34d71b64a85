"""Fig. 4: distances to a superellipsoid, and the two directions of matching."""

import numpy as np
from matplotlib.axes import Axes
from scipy.spatial import cKDTree

from quadriform.points import Array
from quadriform.report.paper import drawing
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, NOT, Remake, beside, listed, mm, shown
from quadriform.report.paper.robustness import DIRECTIONS, Matching
from quadriform.report.paper.subjects import SYNTHETIC
from quadriform.report.parts import table
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

FLAT = Superquadric(semi_axes=np.array((50.0, 30.0, 30.0)), exponents=np.array((0.6, 1.0)))
"""Its section through the x and z axes is drawn."""
OUTSIDE = np.array([[52.0, 0.0, 38.0]])
"""The point M, left."""
MATCHED = ("data", "points", "data to model, the paper's, mm", "model to data, the usual, mm", "default, mm")


def distances(material: Material) -> Remake:
    """Fig. 4."""
    flat = DeformableModel({"surface": FLAT}, ControlBox.around(FLAT, (2, 2, 2)))
    radial, nearest = FLAT.project(OUTSIDE), flat.closest(OUTSIDE)
    lengths = {
        "radial |M0 M|": float(FLAT.radial_distance(OUTSIDE)[0]),
        "first-order (P4)": float(FLAT.first_order_distance(OUTSIDE)[0]),
        "true |M P|": float(flat.distance(OUTSIDE)[0]),
    }
    pictures = [
        ("distances of M", drawing.plane(lambda axes: _draw_distances(axes, radial[0], nearest[0]), "distances of M")),
        ("two closest points of M", drawing.plane(_draw_matching, "two closest points of M")),
    ]
    words = (
        "Left: the point M, where its ray meets the superellipsoid (M0), and the closest point (P). Right: M on the "
        "model S, the point of the data D nearest to it (P'), and the one whose nearest model point it is (P)."
    )
    found = material.matchings
    over, first = (lengths[name] / lengths["true |M P|"] for name in ("radial |M0 M|", "first-order (P4)"))
    return Remake(
        "Fig. 4",
        "distances, and two closest points",
        "p. 42",
        "left: the approximation |M0 M| of the distance, always greater than the exact one. Right: two ways to compute "
        "the closest data point to M; to get the best approximation it is better to match each data point to its "
        "closest model point (P) than the other way round (P'). No numbers are given.",
        [shown(drawing.tiles(pictures, "charts"), words, SYNTHETIC)],
        [(f"{name} of M", NONE, mm(value), NOT) for name, value in lengths.items()],
        f"|M0 M| is {over:.2f} times the true distance, that of first order {first:.2f} times. " + _judged(found),
        [table(MATCHED, [_row(name, each) for name, each in found.items()])],
    )


def _row(name: str, each: Matching) -> tuple[str, ...]:
    return name, f"{each.count:,}", *(f"{each.directions[d]:.3f}" for d in DIRECTIONS), f"{each.default:.3f}"


def _judged(found: dict[str, Matching]) -> str:
    """One sentence for dense data and one for sparse, from the errors of both directions."""
    sentences = []
    for kind in ("dense", "sparse"):
        each = {name.removeprefix(f"{kind}: "): m for name, m in found.items() if name.startswith(kind)}
        parts = [f"{beside(*(m.directions[d] for d in DIRECTIONS))} on {name} ({_both(m)})" for name, m in each.items()]
        sentences.append(
            f"On {kind} data the error of the paper's direction, beside that of the other, is {listed(parts)}."
        )
    wins = [m.directions[DIRECTIONS[0]] < m.directions[DIRECTIONS[1]] for m in found.values()]
    return f"{' '.join(sentences)} The paper's direction is the nearer one in {sum(wins)} of {len(wins)} cases."


def _both(each: Matching) -> str:
    return " and ".join(f"{each.directions[name]:.3f}" for name in DIRECTIONS) + " mm"


def _draw_distances(axes: Axes, radial: Array, nearest: Array) -> None:
    section = FLAT.natural(np.stack([np.linspace(-np.pi, np.pi, 200), np.zeros(200)], 1))
    axes.plot(section[:, 0], section[:, 2], color=drawing.GREY)
    m = OUTSIDE[0]
    axes.plot([0, m[0]], [0, m[2]], ":", color=drawing.GREY)
    for point, colour in ((radial, drawing.BY_PAPER), (nearest, drawing.BY_DEFAULT)):
        axes.plot([m[0], point[0]], [m[2], point[2]], color=colour)
    offsets = {"O": (5, 5), "M": (5, 3), "M0": (-8, -17), "P": (8, -12)}
    for name, point in (("O", np.zeros(3)), ("M", m), ("M0", radial), ("P", nearest)):
        axes.plot(point[0], point[2], "o", color=drawing.GREY, markersize=4)
        axes.annotate(name, (point[0], point[2]), offsets[name], textcoords="offset points")


def _draw_matching(axes: Axes) -> None:
    """A smooth model S under data D with a deep notch."""
    x = np.linspace(-40, 40, 161)
    model = np.stack([x, 12 - x**2 / 160], 1)
    data = np.stack([x, 27 - x**2 / 160 - 13 * np.exp(-((x - 9) ** 2) / 25)], 1)
    m = model[np.argmin(np.abs(x))]
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
