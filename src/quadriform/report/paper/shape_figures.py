"""Figs. 1, 2, 4 and 5: superellipsoids, their samples, distances to them, and the box that deforms them."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from quadriform.points import Array
from quadriform.report.paper import drawing
from quadriform.report.paper.remake import NONE, NOT, Remake, mm, shown
from quadriform.report.paper.results import Results
from quadriform.report.paper.subjects import SYNTHETIC
from quadriform.report.parts import svg
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

GALLERY = (0.1, 0.5, 1.0, 1.5, 2.0)
"""Exponents, of latitude down the rows and of longitude along them."""
SQUARE = Superquadric(semi_axes=np.array((50.0, 40.0, 30.0)), exponents=np.array((0.3, 0.3)))
"""A rounded box: curved at its edges alone."""
FLAT = Superquadric(semi_axes=np.array((50.0, 30.0, 30.0)), exponents=np.array((0.6, 1.0)))
"""Its section through the x and z axes is drawn in Fig. 4."""
OUTSIDE = np.array([[52.0, 0.0, 38.0]])
"""The point M of Fig. 4, left."""


def gallery(_: Results) -> Remake:
    """Fig. 1."""
    figure, places = drawing.scene(len(GALLERY), len(GALLERY), 1.7)
    worst = 0.0
    for axes, (e1, e2) in zip(places, ((a, b) for a in GALLERY for b in GALLERY)):
        body = Superquadric(exponents=np.array((e1, e2)))
        mesh = body.mesh(48)
        worst = max(worst, abs(mesh.volume() / body.volume() - 1))
        drawing.draw_mesh(axes, body.mesh(drawing.RESOLUTION), drawing.ORANGE)
        drawing.look_at([axes], np.array([[-1.0, -1, -1], [1, 1, 1]]))
        axes.set_title(f"{e1:g}, {e2:g}", fontsize=8, pad=-4)
    words = f"{len(places)} superellipsoids with semi-axes 1; over each its two exponents."
    return Remake(
        "Fig. 1",
        "superellipsoids",
        "p. 40",
        "superellipsoids of many shapes; small exponents are square, 1 is round, 2 has flat bevels, more are pinched "
        "(p. 51).",
        [shown(drawing.picture(figure, words, 75), words, SYNTHETIC)],
        [("mesh of 48 cells against the closed form of the volume, largest difference", NONE, NOT, f"{worst:.2%}")],
        "the same family. Exponents end at 2 here: beyond it bodies are pinched, and neither a fit nor a mesh of one "
        "can be trusted.",
    )


def parametrisations(_: Results) -> Remake:
    """Fig. 2."""
    angles = np.stack(np.meshgrid(_middles(20) / 2, _middles(40), indexing="ij"), -1).reshape(-1, 2)
    up, around = angles.T
    directions = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], 1)
    samples = {
        "natural, P2": SQUARE.natural(angles),
        "regular, 2.2": SQUARE.surface(directions),
        "ours: blown-up cube": SQUARE.grid(12)[0],
    }
    figure, places = drawing.scene(3)
    drawing.look_at(places, samples["natural, P2"])
    for axes, (name, points) in zip(places, samples.items()):
        drawing.draw_cloud(axes, points, size=5)
        axes.set_title(f"{name}, {len(points)} points", fontsize=9)
    gap = [_widest_gap(points) for points in samples.values()]
    words = "The same rounded box, 100 mm long, sampled in three ways."
    return Remake(
        "Fig. 2",
        "two parametrisations",
        "p. 41",
        "the natural parametrisation crowds points where the surface is curved; rays through an even grid of latitude "
        "and longitude spread them more evenly.",
        [shown(drawing.picture(figure, words), words, SYNTHETIC)],
        [
            ("largest hole between samples, natural", NONE, mm(gap[0]), NOT),
            ("largest hole between samples, regular", NONE, mm(gap[1]), mm(gap[2])),
        ],
        f"the claim holds: the largest hole shrinks from {mm(gap[0])} to {mm(gap[1])}. The paper's grid still crowds "
        "its poles. We sample by a cube blown up to a sphere, which has none.",
    )


def _middles(count: int) -> Array:
    """Even angles over a full turn, none of them at its ends."""
    return np.pi * ((2 * np.arange(count) + 1) / count - 1)


def _widest_gap(points: Array) -> float:
    """The farthest that any point of the surface is from a sample."""
    return float(cKDTree(points).query(SQUARE.grid(80)[0])[0].max())


def distances(_: Results) -> Remake:
    """Fig. 4."""
    flat = DeformableModel({"surface": FLAT}, ControlBox.around(FLAT, (2, 2, 2)))
    radial, nearest = FLAT.project(OUTSIDE), flat.closest(OUTSIDE)
    lengths = {
        "radial": float(FLAT.radial_distance(OUTSIDE)[0]),
        "first order": float(FLAT.first_order_distance(OUTSIDE)[0]),
        "true": float(flat.distance(OUTSIDE)[0]),
    }
    figure = Figure(figsize=(9, 3.6))
    left, right = figure.subplots(1, 2)
    _draw_distances(left, radial[0], nearest[0])
    _draw_matching(right)
    words = "Left: the point M, where its ray meets the superellipsoid (M0), and the closest point (P). Right: M on "
    words += "the superellipsoid, the data point nearest to it (P'), and the one to which it is nearest itself (P)."
    rows = [(f"{name} distance of M", NONE, mm(value), NOT) for name, value in list(lengths.items())[:2]]
    return Remake(
        "Fig. 4",
        "distances, and two closest points",
        "p. 42",
        "the distance along the ray from the centre is never less than the true one; |F - 1| / |grad F| is near it for "
        "points near the surface. Matching each data point to its closest model point is the better choice.",
        [shown(svg(figure, words), words, SYNTHETIC)],
        [*rows, ("true distance of M", NONE, NOT, mm(lengths["true"]))],
        f"the radial distance is {lengths['radial'] / lengths['true']:.2f} times the true one, that of first order "
        f"{lengths['first order'] / lengths['true']:.2f} times. The paper's method matches as the paper prefers; by "
        "default foot points slide over the deformed surface, and the distance to it is the true one.",
    )


def _draw_distances(axes: Axes, radial: Array, nearest: Array) -> None:
    section = FLAT.natural(np.stack([np.linspace(-np.pi, np.pi, 200), np.zeros(200)], 1))
    axes.plot(section[:, 0], section[:, 2], color=drawing.GREY)
    m = OUTSIDE[0]
    axes.plot([0, m[0]], [0, m[2]], ":", color=drawing.GREY)
    for point, colour in ((radial, drawing.BY_PAPER), (nearest, drawing.BY_DEFAULT)):
        axes.plot([m[0], point[0]], [m[2], point[2]], color=colour)
    for name, point in (("O", np.zeros(3)), ("M", m), ("M0", radial), ("P", nearest)):
        axes.plot(point[0], point[2], "o", color=drawing.GREY, markersize=4)
        axes.annotate(name, (point[0], point[2]), (4, 4), textcoords="offset points")
    axes.set_aspect("equal")
    axes.set_axis_off()


def _draw_matching(axes: Axes) -> None:
    """A smooth model S under data D with a deep notch."""
    x = np.linspace(-40, 40, 161)
    model = np.stack([x, 12 - x**2 / 160], 1)
    data = np.stack([x, 27 - x**2 / 160 - 13 * np.exp(-((x - 9) ** 2) / 25)], 1)
    m = model[np.argmin(np.abs(x + 0.0))]
    nearest = data[cKDTree(data).query(m)[1]]
    chosen = cKDTree(model).query(data)[1]
    asking = data[np.argmin(np.linalg.norm(model[chosen] - m, axis=1))]
    axes.plot(*model.T, color=drawing.GREY)
    axes.plot(*data.T, color=drawing.ORANGE)
    for point, name, colour in ((nearest, "P'", drawing.PINK), (asking, "P", drawing.BY_PAPER)):
        axes.plot(*np.stack([m, point]).T, color=colour)
        axes.annotate(name, point, (3, 5), textcoords="offset points")
    axes.annotate("M", m, (-4, -14), textcoords="offset points")
    axes.annotate("S", model[10], (-14, 0), textcoords="offset points")
    axes.annotate("D", data[10], (-14, 0), textcoords="offset points")
    axes.set_aspect("equal")
    axes.set_axis_off()


def free_form(_: Results) -> Remake:
    """Fig. 5."""
    body = Superquadric(semi_axes=np.array((30.0, 20.0, 40.0)), exponents=np.array((0.8, 0.8)))
    before = ControlBox.around(body, (4, 4, 4))
    model = DeformableModel({"surface": body}, before.with_control_points(_bent(before.control_points)))
    figure, places = drawing.scene(4, width=2.6)
    drawing.look_at(places, np.concatenate([model.box.control_points, before.control_points]).reshape(-1, 3), 1.0)
    titles = ("object", "box", "deformed box", "deformed object")
    for axes, title, mesh, box in zip(
        places, titles, (body.mesh(16), None, None, model.mesh(resolution=16)), (before, before, model.box, model.box)
    ):
        drawing.draw_box(axes, box)
        axes.set_title(title, fontsize=9)
        if mesh is not None:
            drawing.draw_mesh(axes, mesh, drawing.ORANGE, 0.6)
    volumes = body.volume(), model.volume()
    words = (
        f"A superellipsoid of {volumes[0] / 1000:.0f} ml, its box of 4 x 4 x 4 control points, both bent and widened."
    )
    return Remake(
        "Fig. 5",
        "free-form deformation",
        "p. 43",
        "an object in a box of control points; when the box is deformed, the object follows.",
        [shown(drawing.picture(figure, words), words, SYNTHETIC)],
        [
            ("volume after deformation", NONE, NOT, f"{volumes[1] / 1000:.0f} ml"),
            ("proven lower bound of det J inside", NONE, NOT, f"{model.min_jacobian():.2f}"),
        ],
        "the same deformation. Beyond the paper, a proven bound of the Jacobian says that the map has no fold inside.",
    )


def _bent(points: Array) -> Array:
    """A bend towards x, and the upper half wider."""
    z = points[..., 2:] / 40
    wide = points * np.concatenate([1 + 0.35 * z, 1 + 0.35 * z, np.ones_like(z)], axis=-1)
    return wide + np.concatenate([25 * z**2, 0 * z, 0 * z], axis=-1)
