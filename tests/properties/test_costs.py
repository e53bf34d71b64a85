"""M12, M15 to M17: many inputs at once; what fewer points, and what a richer model, cost at best; halves of data."""

import numpy as np
from clouds_made import noisy_egg
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from shapes_made import lumpy, made

import quadriform as qf
from quadriform.cli.main import main
from quadriform.shapes.control_box import ControlBox

CLOUD = lumpy(200)


def cost(superquadric, points):
    """P3, the criterion of the paper's first stage."""
    return ((superquadric.implicit(points) - 1) ** 2).sum()


def best(points):
    return cost(qf.fit_superquadric(points, method="paper").superquadric, points)


def test_fewer_points_cost_no_more():
    """M15: each half for itself, and both together, against the whole."""
    halves = CLOUD[::2], CLOUD[1::2]
    whole = best(CLOUD)
    assert max(map(best, halves)) <= whole * (1 + 1e-9)
    assert sum(map(best, halves)) <= whole * (1 + 1e-9)


def plainer(points, kept):
    """Least P3 of the spheres (4 numbers) or ellipsoids (9) near the cloud's moments, by SciPy."""
    centre, spread = points.mean(axis=0), np.sqrt(3 * points.var(axis=0).mean())

    def surface(numbers):
        turn = Rotation.from_rotvec(numbers[6:]).as_matrix() if kept == 9 else np.eye(3)
        axes = np.exp(numbers[3:6]) if kept == 9 else np.exp(np.repeat(numbers[3], 3))
        return qf.Superquadric(semi_axes=spread * axes, rotation=turn, translation=centre + spread * numbers[:3])

    found = least_squares(lambda numbers: surface(numbers).implicit(points) - 1, np.zeros(kept), xtol=1e-12, ftol=1e-12)
    return cost(surface(found.x), points)


def test_a_superquadric_costs_no_more_than_an_ellipsoid_nor_that_than_a_sphere():
    """M16: the same criterion, P3."""
    costs = [plainer(CLOUD, 4), plainer(CLOUD, 9), best(CLOUD)]
    assert costs[1] <= costs[0] * (1 + 1e-9) and costs[2] <= costs[1] * (1 + 1e-9)
    assert costs[2] < 0.99 * costs[1] < 0.9 * costs[0]


def test_a_finer_box_costs_no_more():
    """M16: the same pairs, boxes of which each holds the one before; none at all costs most."""
    surface = made()
    points = surface.grid(12)[0]
    wanted = np.sin(points[:, [1, 2, 0]])
    costs = [(wanted**2).sum()]
    for side in range(2, 7):
        rows = ControlBox.around(surface, (side, side, side)).matrix(points)
        step = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        costs.append(((rows @ step - wanted) ** 2).sum())
    assert (np.diff(costs) <= 1e-9 * costs[0]).all()
    assert costs[-1] < 0.01 * costs[0]


def test_many_inputs_at_once_are_each_alone(tmp_path, monkeypatch, capsys, blank_figures):
    """M12: in either order."""
    monkeypatch.chdir(tmp_path)
    for name, seed in (("a", 1), ("b", 2)):
        np.savetxt(f"{name}.xyz", lumpy(60, seed), fmt="%.17g")
    quick = ("--method", "paper", "--iterations", "2")
    for out, names in (("ab", ["a.xyz", "b.xyz"]), ("ba", ["b.xyz", "a.xyz"])):
        assert main(["fit", *names, "-o", out, *quick]) == 0
    for name in "ab":
        assert main(["fit", f"{name}.xyz", "-o", f"alone-{name}", *quick]) == 0
        alone = (tmp_path / f"alone-{name}" / "model.json").read_bytes()
        assert all((tmp_path / out / name / "model.json").read_bytes() == alone for out in ("ab", "ba"))


def test_two_halves_of_the_data_agree_within_what_they_say_of_themselves():
    """M17: everywhere within five of their standard deviations together, which are no larger than need be."""
    points = noisy_egg(1000)
    one, other = (qf.fit(points[start::2], box=(4, 4, 4)) for start in (0, 1))
    vertices = one.model.mesh(resolution=8).vertices
    sigma = np.hypot(one.uncertainty(vertices), other.uncertainty(vertices))
    ratio = np.abs(other.model.distance(vertices)) / sigma
    assert ratio.max() < 5
    assert 0.4 < np.sqrt((ratio**2).mean()) < 2
