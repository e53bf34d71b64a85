"""The compiled loops against the same written out in NumPy, for every kind and odd numbers of points and threads."""

import kernel_oracle as oracle
import numpy as np
import pytest

from quadriform.fitting.superquadric.candidates import Candidates, distances
from quadriform.shapes.closest import MAX_STEPS, _converge, surface_points, update_foot_points
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.threads import WORTH, threads_for

TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
TURN = TURN * np.sign(np.linalg.det(TURN))
PLACED = {"semi_axes": (1.0, 0.8, 0.6), "rotation": TURN, "translation": (0.1, 0.2, -0.3)}
SURFACES = {
    "ellipsoid": Superquadric(exponents=(0.7, 1.3), **PLACED),
    "box": Superquadric(exponents=(0.2, 0.3), **PLACED),
    "toroid": Superquadric("toroid", exponents=(0.7, 1.3), hole_radius=2.0, **PLACED),
    "one sheet": Superquadric("hyperboloid1", exponents=(0.7, 1.3), height=1.0, **PLACED),
    "two sheets": Superquadric("hyperboloid2", exponents=(0.7, 1.3), height=2.0, **PLACED),
}


def deformed(surface, shape=(5, 4, 3)):
    box = ControlBox.around(surface, shape)
    return box.with_control_points(box.rest + 0.05 * np.random.default_rng(2).normal(size=box.rest.shape))


@pytest.fixture(params=SURFACES)
def surface(request):
    return SURFACES[request.param]


@pytest.mark.parametrize("count", [1, 3, 4, 5, 4099])
@pytest.mark.parametrize("shape", [(2, 2, 2), (5, 5, 5), (3, 7, 4)])
def test_points_and_their_derivatives(count, shape, rng):
    surface = SURFACES["ellipsoid"]
    box, points = deformed(surface, shape), rng.normal(size=(count, 3))
    np.testing.assert_allclose(box.deform(points), oracle.carried(box, points), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(box.jacobian(points), oracle.jacobian(box, points), rtol=1e-10, atol=1e-10)


def test_normals(surface, rng):
    box, origins = deformed(surface), surface.project(rng.normal(size=(1001, 3)))
    points, normals = surface_points(surface, box, origins)
    np.testing.assert_allclose(points, oracle.carried(box, origins), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(normals, oracle.normals(surface, box, origins), atol=1e-8)


def pulled(surface, box, rng):
    origins = surface.project(surface.grid(8)[0])
    targets = box.deform(origins) + 0.03 * rng.normal(size=origins.shape)
    return targets, surface.project(origins + 0.03 * rng.normal(size=origins.shape))


def test_updated_foot_points(surface, rng):
    box = deformed(surface)
    targets, origins = pulled(surface, box, rng)
    given = origins.copy()
    gaps = np.abs(
        update_foot_points(surface, box, targets, origins, 3)
        - oracle.update_foot_points(surface, box, targets, origins, 3)
    )
    assert np.quantile(gaps.max(axis=1), 0.95) < 1e-10  # a tie may fall either way
    np.testing.assert_array_equal(origins, given)


def test_converged_foot_points(surface, rng):
    box = deformed(surface)
    targets, origins = pulled(surface, box, rng)
    ours, (there, points, least, weak) = (
        _converge(surface, box, targets, origins),
        oracle.converge_foot_points(surface, box, targets, origins, MAX_STEPS),
    )
    same = np.abs(ours.origins - there).max(axis=1) < 1e-6
    assert same.mean() > 0.97
    lengths = [np.linalg.norm(targets - found, axis=1)[same] for found in (ours.points, points)]
    np.testing.assert_allclose(*lengths, atol=1e-9)
    np.testing.assert_allclose(ours.curvature[same], least[same], atol=1e-3)
    sharp = same & (np.abs(least - 1) > 1e-2)
    assert np.quantile(np.abs(np.einsum("ni,ni->n", ours.direction, weak))[sharp], 0.05) > 0.99


@pytest.mark.parametrize("kind", ["ellipsoid", "toroid", "hyperboloid1", "hyperboloid2"])
def test_distances_and_their_derivatives(kind, rng):
    count = 7
    candidates = Candidates(
        kind,
        rng.normal(0, 0.3, (count, 3)),
        rng.uniform(0.1, 1.9, (count, 2)),
        np.stack([TURN] * count),
        rng.normal(0, 0.1, (count, 3)),
        rng.normal(0, 0.3, (count, 1)),
    )
    points = rng.normal(size=(101, 3))
    for ours, theirs in zip(distances(candidates, points), oracle.distances(candidates, points)):
        np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-9)


def test_axes_planes_and_the_centre_stay_finite():
    surface = SURFACES["ellipsoid"]
    candidates = Candidates.of([surface, SURFACES["box"]])
    special = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1e-200, 0, 1], [1e9, 1, 1]])
    world = special @ TURN.T + surface.translation
    for ours, theirs in zip(distances(candidates, world), oracle.distances(candidates, world)):
        assert np.isfinite(ours).all()
        np.testing.assert_allclose(ours[0], theirs[0], rtol=1e-6, atol=1e-6)


def test_threads_change_nothing(surface, rng, monkeypatch):
    box = deformed(surface)
    origins = surface.project(np.resize(surface.grid(20)[0], (2 * WORTH + 3, 3)))
    targets = box.deform(origins) + 0.03 * rng.normal(size=origins.shape)
    found = []
    for threads in ("1", "3"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        assert threads_for(len(targets)) == int(threads)
        found.append((update_foot_points(surface, box, targets, origins, 2), box.deform(targets)))
    for one, other in zip(*found):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("words", ["", "0", "-2", "many", "2,1"])
def test_odd_words_for_the_number_of_threads(words, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", words)
    assert threads_for(WORTH) >= 1
    assert threads_for(WORTH - 1) == 1
    if words == "2,1":
        assert threads_for(WORTH) == 2
