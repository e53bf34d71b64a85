"""`method="paper"` against a loop written from the text of the paper alone, iteration by iteration.

Where the paper is silent the loop follows docs/conventions.md: the mean of several displacements, the inverse-distance
mean of the four nearest displaced points and of those as near as the fourth, and alpha = strength x model points.
"""

from math import comb

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shapes_made import lumpy

import quadriform as qf
from quadriform.fitting.paper import two_step
from quadriform.points import Frame
from quadriform.shapes.barr import taper
from quadriform.shapes.superquadric import Superquadric

ITERATIONS = 30
"""All that are made by default."""


def lattice(semi_axes, rotation, translation, box):
    """P17 with the sizes of 3.2.1: the control points (k, 3) of the box around a superellipsoid."""
    along = np.meshgrid(*(np.linspace(-1, 1, n) for n in box), indexing="ij")
    return np.stack(along, axis=-1).reshape(-1, 3) * semi_axes @ rotation.T + translation


def deformation_matrix(points, semi_axes, rotation, translation, box):
    """P15, P16 and the products of P18: B (m, k)."""
    stu = ((points - translation) @ rotation + semi_axes) / (2 * semi_axes)
    bernstein = [
        np.stack([comb(n - 1, i) * (1 - v) ** (n - 1 - i) * v**i for i in range(n)], axis=1) for v, n in zip(stu.T, box)
    ]
    return np.einsum("mi,mj,mk->mijk", *bernstein).reshape(len(points), -1)


def springs(box):
    """D of P9: a row for each control point and each of its neighbours, so that each pair is there twice."""
    index = np.arange(np.prod(box)).reshape(box)
    ends = [np.stack([np.delete(index, -1, a).ravel(), np.delete(index, 0, a).ravel()], axis=1) for a in range(3)]
    pairs = np.concatenate([*ends, *(end[:, ::-1] for end in ends)])
    return np.eye(index.size)[pairs[:, 0]] - np.eye(index.size)[pairs[:, 1]]


def displacement_field(x, data):
    """3.2.2: dX (m, 3), and whether two points of the model are equally near to a data point."""
    distance, nearest = cKDTree(x).query(data, k=2)
    count = np.bincount(nearest[:, 0], minlength=len(x))
    there = count > 0
    dx = np.zeros_like(x)
    np.add.at(dx, nearest[:, 0], data)
    dx[there] = dx[there] / count[there, None] - x[there]
    if not there.all():
        far, index = cKDTree(x[there]).query(x[~there], k=8)
        weight = np.where(far <= (1 + 1e-9) * far[:, 3:4], 1 / far, 0)
        dx[~there] = np.einsum("mk,mkd->md", weight, dx[there][index]) / weight.sum(axis=1, keepdims=True)
    return dx, (distance[:, 1] - distance[:, 0]).min() < 1e-12 * distance.max()


def papers_loop(b, p, x, data, least=None, rows=None):
    """3.3: P, X and |X - X_before| after each iteration.

    By P7 with the singular values of P8 above the `least` fraction of the largest, or by P9 with rows sqrt(alpha) D.
    """
    u, w, vt = np.linalg.svd(b, full_matrices=False)
    kept = int((w > (max(b.shape) * np.finfo(float).eps if least is None else least) * w[0]).sum())
    for _ in range(ITERATIONS):
        dx, tie = displacement_field(x, data)
        if tie:
            return
        if rows is None:
            p = p + vt[:kept].T @ (u[:, :kept].T @ dx / w[:kept, None])
        else:
            p = np.linalg.lstsq(np.vstack([b, rows]), np.vstack([x + dx, np.zeros((len(rows), 3))]), rcond=None)[0]
        before, x = x, b @ p
        yield p, x, np.sqrt(((x - before) ** 2).sum(axis=1).mean())


def crossing():
    """Three crossing superquadrics with a global taper, after Fig. 3, moved a little so that nothing is symmetric."""
    arms = [Superquadric(semi_axes=np.where(np.arange(3) == k, 50.0, 30.0), exponents=(0.6, 0.7)) for k in range(3)]
    parts = [arm.grid(10)[0] for arm in arms]
    seen = [
        part[np.all([other.implicit(part) > 1 for other in arms if other is not arm], axis=0)]
        for arm, part in zip(arms, parts)
    ]
    points = taper(np.concatenate(seen), (-0.35, -0.3), 50)
    return points + np.random.default_rng(3).normal(0, 0.1, points.shape)


CLOUDS = {"dense": lumpy(2000), "sparse": lumpy(500), "crossing": crossing()}
WAYS = {
    "P7": ({}, {}),
    "P8": ({"strength": 2e-2}, {"least": 2e-2}),
    "P9": ({"regularity": "springs-paper", "strength": 1e-5}, {"rows": 1e-5}),
}


@pytest.fixture(scope="module")
def begun(request):
    """A cloud and the superquadric that both loops start from."""
    cloud = CLOUDS[request.param]
    return cloud, qf.fit_superquadric(cloud, method="paper").superquadric


@pytest.mark.parametrize(
    ("begun", "box"),
    [*((cloud, (5, 5, 5)) for cloud in CLOUDS), ("sparse", (4, 3, 5))],
    indirect=["begun"],
    scope="module",  # else the superquadric would be fitted anew for each way
)
@pytest.mark.parametrize("way", WAYS)
def test_each_iteration_is_the_papers(begun, way, box, monkeypatch):
    """The surface agrees to 1e-9 r and the box to 1e-6 r in every iteration, until two points are equally near."""
    cloud, surface = begun
    options, given = WAYS[way]
    frame, boxes = Frame.of(cloud), []
    solver = two_step.step_for

    def recorded(*arguments):
        solve, strength = solver(*arguments)

        def step(displacement, control, rest):
            moved = solve(displacement, control, rest)
            boxes.append(frame.to_world(control + moved))
            return moved

        return step, strength

    monkeypatch.setattr(two_step, "step_for", recorded)
    fit = qf.refine(surface, cloud, method="paper", box=box, **options)
    pose, x = (surface.semi_axes, surface.rotation, surface.translation), surface.grid(two_step.MODEL_RESOLUTION)[0]
    b = deformation_matrix(x, *pose, box)
    if "rows" in given:
        given = {"rows": np.sqrt(given["rows"] * len(x)) * springs(box)}
    expected = list(papers_loop(b, lattice(*pose, box), x, cloud, **given))
    assert len(expected) == len(boxes) == fit.iterations == ITERATIONS
    for (p, model, motion), found, record in zip(expected, boxes, fit.history):
        np.testing.assert_allclose(b @ found, model, atol=1e-9 * frame.scale, rtol=0)
        np.testing.assert_allclose(found, p, atol=1e-6 * frame.scale, rtol=0)
        assert record.surface_motion == pytest.approx(motion, abs=1e-9 * frame.scale)
