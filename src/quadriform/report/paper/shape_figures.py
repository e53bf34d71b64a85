"""Figs. 1, 2 and 5, and the kinds without a figure: superquadrics, their samples, the box that deforms them."""

import numpy as np
from scipy.spatial import cKDTree

from quadriform import examples
from quadriform.examples import ROUNDED_BOX
from quadriform.points import Array
from quadriform.report.paper import drawing
from quadriform.report.paper.drawing import Tile
from quadriform.report.paper.kinds import Bent
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, NOT, SAME, Remake, Row, in_mm, mm, shown
from quadriform.report.paper.subjects import SYNTHETIC
from quadriform.report.parts import tiles
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

GALLERY = (0.1, 0.5, 1.0, 2.0, 3.0)
"""Exponents, of latitude and of longitude."""
EDGE = 10.0
"""The surface is called curved where its normal is farther than this from all axes, in degrees."""


def gallery(_: Material) -> Remake:
    """Fig. 1."""
    pictures, worst, filled = [], 0.0, {}
    window = np.array([[-1.0, -1, -1], [1, 1, 1]])
    for e1, e2 in ((a, b) for a in GALLERY for b in GALLERY):
        body = Superquadric(exponents=np.array((e1, e2)))
        worst = max(worst, abs(body.mesh(48).volume() / body.volume() - 1))
        if e1 == e2:
            filled[e1] = body.volume() / 8
        name, surface = f"{e1:g}, {e2:g}", drawing.mesh(body.mesh(2 * drawing.RESOLUTION), drawing.ORANGE)
        picture = drawing.in_space(f"superellipsoid, exponents {name}", window, surface, inches=2.0)[1]
        pictures.append((name, picture))
    rows: list[Row] = [
        (f"part of its cube that both exponents of {e:g} fill", NONE, NOT, f"{part:.1%}") for e, part in filled.items()
    ]
    rows.append(("volume of a mesh of 48 cells against the closed form, largest difference", NONE, NOT, f"{worst:.2%}"))
    words: dict[str, object] = {
        "count": len(pictures),
        "least": GALLERY[0],
        "of_least": filled[GALLERY[0]],
        "most": GALLERY[-1],
        "of_most": filled[GALLERY[-1]],
        "sphere": np.pi / 6,
        "octahedron": 1 / 6,
        "worst": worst,
    }
    return Remake("1", words, [shown("1", tiles(pictures, "fives"), SYNTHETIC, count=len(pictures))], rows)


def parametrisations(_: Material) -> Remake:
    """Fig. 2."""
    samples = {
        "natural (P2)": examples.rounded_box("natural"),
        "regular (section 2.2)": examples.rounded_box("regular"),
        "ours: projected cube": ROUNDED_BOX.grid(12)[0],
    }
    window = samples["natural (P2)"]
    pictures = [
        drawing.in_space(f"{name}, {len(points)} points", window, drawing.cloud(points, size=5))
        for name, points in samples.items()
    ]
    far = [_largest_distance(points) for points in samples.values()]
    curved = [float(_is_curved(points).mean()) for points in samples.values()]
    area = _curved_area()
    rows: list[Row] = [
        (f"{quantity}, {name}", NONE, *((NOT, value) if name == "projected cube" else (value, NOT)))
        for quantity, values in (
            ("largest distance from the surface to a sample", map(mm, far)),
            (f"samples on the curved {area:.0%} of the area", (f"{fraction:.0%}" for fraction in curved)),
        )
        for name, value in zip(("natural", "regular", "projected cube"), values)
    ]
    evener = abs(curved[1] - area) < abs(curved[0] - area) and far[1] < far[0]
    words: dict[str, object] = {
        "evener": "more" if evener else "not more",
        "far": [mm(distance) for distance in far],
        "curved": curved,
        "area": area,
        # a pole ends each of the meridians, of which the closed grid has the first twice
        "pole": 2 * 20 + 1,
    }
    return Remake("2", words, [shown("2", tiles(pictures), SYNTHETIC)], rows)


def _largest_distance(points: Array) -> float:
    """The largest distance of a point of the surface from its nearest sample."""
    return float(cKDTree(points).query(ROUNDED_BOX.grid(80)[0])[0].max())


def _is_curved(points: Array) -> Array:
    normals = ROUNDED_BOX.gradient(points)
    # flat faces of a rounded box have normals along an axis
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(np.abs(normals).max(axis=1) < np.cos(np.radians(EDGE)))


def _curved_area() -> float:
    mesh = ROUNDED_BOX.mesh(80)
    areas = np.linalg.norm(mesh.area_vectors(), axis=1)
    return float(areas[_is_curved(mesh.vertices[mesh.faces].mean(axis=1))].sum() / areas.sum())


def free_form(_: Material) -> Remake:
    """Fig. 5."""
    body = Superquadric(semi_axes=np.array((30.0, 20.0, 40.0)), exponents=np.array((0.8, 0.8)))
    undeformed = ControlBox.around(body, (4, 4, 4))
    model = DeformableModel({"surface": body}, undeformed.with_control_points(_bent(undeformed.control_points)))
    volumes, bound = [body.volume() / 1000, model.volume() / 1000], model.min_jacobian()
    words = {"volumes": volumes, "bound": bound, "folds": "does not fold" if bound > 0 else "may fold"}
    rows: list[Row] = [
        ("volume of the object before and after", NONE, *[f"{volumes[0]:.0f} and {volumes[1]:.0f} ml"] * 2),
        ("proven lower bound of det J inside", NONE, NOT, f"{bound:.2f}"),
    ]
    return Remake("5", words, [shown("5", tiles(_object_and_box(body, undeformed, model)), SYNTHETIC)], rows)


def _object_and_box(body: Superquadric, undeformed: ControlBox, model: DeformableModel) -> list[Tile]:
    window = np.concatenate([model.box.control_points, undeformed.control_points]).reshape(-1, 3)
    meshes = (body.mesh(drawing.RESOLUTION), model.mesh(resolution=drawing.RESOLUTION))
    surfaces = [drawing.mesh(mesh, drawing.ORANGE, 0.6) for mesh in meshes]
    boxes = [drawing.box(undeformed), drawing.box(model.box)]
    pictures = [
        ("object in the initial box", (surfaces[0], boxes[0])),
        ("initial box", (boxes[0],)),
        ("deformed box", (boxes[1],)),
        ("deformed object in the deformed box", (surfaces[1], boxes[1])),
    ]
    return [drawing.in_space(name, window, *artists, zoom=1.0) for name, artists in pictures]


def _bent(points: Array) -> Array:
    """Points bent towards x, with a wider upper half."""
    z = points[..., 2:] / 40
    wide = points * np.concatenate([1 + 0.35 * z, 1 + 0.35 * z, np.ones_like(z)], axis=-1)
    return wide + np.concatenate([25 * z**2, 0 * z, 0 * z], axis=-1)


def other_kinds(material: Material) -> Remake:
    """The three kinds that the paper names and does not draw."""
    pictures = [picture for bent in material.kinds for picture in _kind_pictures(bent)]
    rows: list[Row] = []
    for bent in material.kinds:
        name = KINDS[bent.truth.kind].title
        rows.append((f"error RMS of the superquadric, {name}", NONE, mm(bent.error), NOT))
        alone, refined = zip(*((fit.superquadric_rms, fit.rms) for fit in bent.fits))
        rows.append(in_mm(f"after a bend: the superquadric alone, {name}", alone))
        rows.append(in_mm(f"after a bend: the model, {name}", refined))
    words: dict[str, object] = {
        "errors": ", ".join(f"{bent.error:.2f}" for bent in material.kinds),
        "nearer": [_nearer(material, method) for method in (0, 1)],
    }
    return Remake("kinds", words, [shown("kinds", tiles(pictures), SYNTHETIC)], rows)


def _nearer(material: Material, method: int) -> str:
    fits = [bent.fits[method] for bent in material.kinds]
    return f"{sum(fit.rms < (1 - SAME) * fit.superquadric_rms for fit in fits)} of {len(fits)}"


def _kind_pictures(bent: Bent) -> list[Tile]:
    name = KINDS[bent.truth.kind].title
    meshes = [bent.found.superquadric.mesh(drawing.RESOLUTION), bent.fits[0].model.mesh(resolution=drawing.RESOLUTION)]
    window = np.concatenate([bent.points, bent.bent, *(mesh.vertices for mesh in meshes)])
    artists = {
        f"{name}, {len(bent.points)} points": drawing.cloud(bent.points, size=4),
        "superquadric": drawing.mesh(meshes[0], drawing.BY_PAPER),
        "points after a bend": drawing.cloud(bent.bent, size=4),
        'model, method="paper"': drawing.mesh(meshes[1], drawing.BY_PAPER),
    }
    return [drawing.in_space(title, window, artist, zoom=1.0) for title, artist in artists.items()]
