"""Figs. 1, 2 and 5, and the kinds without a figure: superquadrics, their samples, the box that deforms them."""

import numpy as np
from markupsafe import Markup
from scipy.spatial import cKDTree

from quadriform import examples
from quadriform.examples import ROUNDED_BOX
from quadriform.points import Array
from quadriform.report.paper import drawing
from quadriform.report.paper.kinds import Bent
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, NOT, SAME, Remake, Row, mm, shown
from quadriform.report.paper.subjects import SYNTHETIC
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
        pictures.append((name, drawing.in_space(window, f"superellipsoid, exponents {name}", surface, inches=2.0)))
    words = f"{len(pictures)} superellipsoids with semi-axes 1; above each its exponents of latitude and longitude."
    return Remake(
        "Fig. 1",
        "superellipsoids",
        "p. 40",
        "examples of superellipsoids, a wide variety of shapes. Small exponents are square, 1 is round, 2 has flat "
        "bevels, larger ones are pinched (p. 51).",
        [shown(drawing.tiles(pictures, "fives"), words, SYNTHETIC)],
        [
            *(
                (f"part of its cube that both exponents of {e:g} fill", NONE, NOT, f"{f:.1%}")
                for e, f in filled.items()
            ),
            ("volume of a mesh of 48 cells against the closed form, largest difference", NONE, NOT, f"{worst:.2%}"),
        ],
        f"the same family, {len(pictures)} shapes, from square to pinched: of their cube both exponents of "
        f"{GALLERY[0]:g} fill {filled[GALLERY[0]]:.1%} and of {GALLERY[-1]:g} fill {filled[GALLERY[-1]]:.1%}; a sphere "
        f"fills {np.pi / 6:.1%}, and an octahedron, which has flat sides, {1 / 6:.1%}. The volumes of their meshes are "
        f"those of the closed form to {worst:.2%}.",
    )


def parametrisations(_: Material) -> Remake:
    """Fig. 2."""
    samples = {
        "natural (P2)": examples.rounded_box("natural"),
        "regular (section 2.2)": examples.rounded_box("regular"),
        "ours: projected cube": ROUNDED_BOX.grid(12)[0],
    }
    window = samples["natural (P2)"]
    pictures = {
        f"{name}, {len(points)} points": drawing.in_space(window, name, drawing.cloud(points, size=5))
        for name, points in samples.items()
    }
    far, curved = ([of(points) for points in samples.values()] for of in (_largest_distance, _curved))
    area = _curved_area()
    words = "A rounded box, 100 mm long, on the closed grid of latitude and longitude, and on our grid."
    return Remake(
        "Fig. 2",
        "two parametrisations",
        "p. 41",
        "left the natural parametrisation, whose points depend on the curvature: more where it is large. Right the "
        "regular one, called uniform: rays through a closed grid of latitude and longitude with constant steps.",
        [shown(drawing.tiles(pictures.items()), words, SYNTHETIC)],
        [
            (f"{quantity}, {name}", NONE, *((NOT, value) if name == "projected cube" else (value, NOT)))
            for quantity, values in (
                ("largest distance from the surface to a sample", map(mm, far)),
                (f"samples on the curved {area:.0%} of the area", (f"{fraction:.0%}" for fraction in curved)),
            )
            for name, value in zip(("natural", "regular", "projected cube"), values)
        ],
        _spread(far, curved, area),
    )


def _spread(far: list[float], curved: list[float], area: float) -> str:
    evener = abs(curved[1] - area) < abs(curved[0] - area) and far[1] < far[0]
    return (
        f"the regular parametrisation is {'more' if evener else 'not more'} even than the natural one: no point of the "
        f"surface is farther than {mm(far[1])} from a sample, against {mm(far[0])}, and {curved[1]:.0%} of its "
        f"samples are on the curved {area:.0%} of the area, of the natural one's {curved[0]:.0%}. It is not uniform: a "
        f"grid of latitude and longitude is dense at its poles, each of which it holds {2 * 20 + 1} times. Fits sample "
        f"by a cube projected onto the surface, which has no poles: {mm(far[2])} and {curved[2]:.0%}."
    )


def _largest_distance(points: Array) -> float:
    """The largest distance of a point of the surface from its nearest sample."""
    return float(cKDTree(points).query(ROUNDED_BOX.grid(80)[0])[0].max())


def _curved(points: Array) -> float:
    """Share of the samples where the surface is curved."""
    return float(_is_curved(points).mean())


def _is_curved(points: Array) -> Array:
    normals = ROUNDED_BOX.gradient(points)
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
    words = "A superellipsoid and its box of 4 x 4 x 4 control points, both bent and scaled."
    return Remake(
        "Fig. 5",
        "free-form deformation",
        "p. 43",
        "an object in its initial box, the box, the deformed box, and the deformed object in it: the object follows.",
        [shown(drawing.tiles(_object_and_box(body, undeformed, model)), words, SYNTHETIC)],
        [
            ("volume of the object before and after", NONE, *[f"{volumes[0]:.0f} and {volumes[1]:.0f} ml"] * 2),
            ("proven lower bound of det J inside", NONE, NOT, f"{bound:.2f}"),
        ],
        f"the same deformation; it changes the volume from {volumes[0]:.0f} to {volumes[1]:.0f} ml. Beyond the paper, "
        f"the determinant of the map is proven to be at least {bound:.2f} inside the object, so it "
        f"{'does not fold' if bound > 0 else 'may fold'} there.",
    )


def _object_and_box(body: Superquadric, undeformed: ControlBox, model: DeformableModel) -> list[tuple[str, Markup]]:
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
    return [(name, drawing.in_space(window, name, *artists, zoom=1.0)) for name, artists in pictures]


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
        rows.append((f"after a bend: the superquadric alone, {name}", NONE, *_each(bent, "superquadric_rms")))
        rows.append((f"after a bend: the model, {name}", NONE, *_each(bent, "rms")))
    errors = [f"{bent.error:.2f}" for bent in material.kinds]
    return Remake(
        "Section 2",
        "the other kinds of superquadric",
        "p. 40",
        "there are four kinds; the technique is easily adapted to the supertorus and the superhyperboloids of one and "
        "of two sheets. No figure shows them.",
        [shown(drawing.tiles(pictures), "Points with noise of 0.5 mm, superquadric, bent points, model.", SYNTHETIC)],
        rows,
        f"the same algorithm finds all three: the true surfaces are {', '.join(errors)} mm from the superquadrics "
        f"fitted to points with noise of 0.5 mm. After a bend the refinement is nearer than the superquadric by more "
        f"than {SAME:.0%} in {_nearer(material, 0)} cases by the paper's method and in {_nearer(material, 1)} by "
        f"default. The box around a hyperboloid is that of the part that is cut out of it.",
    )


def _nearer(material: Material, method: int) -> str:
    fits = [bent.fits[method] for bent in material.kinds]
    return f"{sum(fit.rms < (1 - SAME) * fit.superquadric_rms for fit in fits)} of {len(fits)}"


def _each(bent: Bent, quantity: str) -> list[str]:
    return [mm(getattr(fit, quantity)) for fit in bent.fits]


def _kind_pictures(bent: Bent) -> list[tuple[str, Markup]]:
    name = KINDS[bent.truth.kind].title
    meshes = [bent.found.superquadric.mesh(drawing.RESOLUTION), bent.fits[0].model.mesh(resolution=drawing.RESOLUTION)]
    window = np.concatenate([bent.points, bent.bent, *(mesh.vertices for mesh in meshes)])
    artists = {
        f"{name}, {len(bent.points)} points": drawing.cloud(bent.points, size=4),
        "superquadric": drawing.mesh(meshes[0], drawing.BY_PAPER),
        "points after a bend": drawing.cloud(bent.bent, size=4),
        'model, method="paper"': drawing.mesh(meshes[1], drawing.BY_PAPER),
    }
    return [(title, drawing.in_space(window, title, artist, zoom=1.0)) for title, artist in artists.items()]
