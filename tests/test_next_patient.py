"""The arithmetic of the benchmarks on data that the defaults were not tuned on; none of that data is needed here."""

import importlib
from pathlib import Path

import numpy as np
import pytest

import quadriform as qf
from quadriform.errors import OptionError

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.fixture(autouse=True)
def on_path(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)


def module(name):
    return importlib.import_module(f"generalisation.{name}")


def ball(radius, centre=(0.0, 0.0, 0.0), name="endo"):
    shape = qf.Superquadric(semi_axes=(radius,) * 3, translation=centre)
    return qf.DeformableModel({name: shape}, qf.ControlBox.around(shape, (3, 3, 3)))


# --- the table -----------------------------------------------------------------------------------------------------


def benchmark(row, **options):
    rows = module("rows")
    cases = options.pop("cases", [("a", 1), ("b", 2)])
    return rows.Benchmark("bodies", "RMS mm", cases, row, lambda found: f"{len(found)} rows", "1 mm", **options)


def test_the_worst_row_is_first_and_a_refusal_is_the_worst(capsys):
    rows, running = module("rows"), module("running")

    def row(case, strength):
        if case[0] == "b":
            raise OptionError("no such label")
        return rows.Row(float(case[1]), "ok", 0.5, True, {"95 %": 7.0} if case[1] == 3 else {})

    tried = benchmark(row, cases=[("a", 1), ("a", 3), ("b", 2)])
    found = list(running.measured(tried, with_regret=False))
    running.print_table(tried, found)
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")][2:]
    assert [line.split("|")[1].strip() for line in lines] == ["b 2", "a 3", "a 1"]
    assert "exit code 2: no such label" in lines[0] and "| 7 |" in lines[1]
    assert running.summary(tried, found) == "bodies: 3 rows; 1 of 3 without a result; required 1 mm"


def test_the_best_strength_is_that_of_least_error():
    rows, running = module("rows"), module("running")

    def row(case, strength):
        error = 3.0 if strength == "auto" else 1 + abs(np.log10(strength) + 6)
        return rows.Row(error, "ok", 0.5, True)

    for each in running.measured(benchmark(row), with_regret=True):
        assert each.best == pytest.approx((1.0, 1e-6)) and each.ratio == pytest.approx(3)
    assert all(each.best is None for each in running.measured(benchmark(row, has_ladder=False), with_regret=True))


def test_small_errors_count_as_the_least_one_and_no_result_has_no_ratio():
    regret = module("running").regret
    assert regret(0.4, 0.01, least=0.5) == 1 and regret(2.0, 0.01, least=0.5) == 4
    assert np.isnan(regret(1.0, np.inf)) and regret(np.inf, 1.0) == np.inf


def test_wrong_rows_that_are_ok_and_correct_rows_that_are_not_are_counted():
    rows, running = module("rows"), module("running")
    states = [("ok", True), ("ok", False), ("warned: OUTLIERS", True), ("warned: OUTLIERS", False), ("ok", None)]
    found = [running.Measured("x", rows.Row(1.0, status, 0.5, correct), 0.0) for status, correct in states]
    silent, needless = running.status_lines(found)
    assert '1 of 2 "ok" are wrong' in silent and "1 of 2 warned, of 2 correct" in needless


@pytest.mark.parametrize("name", ["voxels", "sunnybrook", "guidepoints", "hearts", "spect", "organs", "scans"])
def test_a_source_without_its_data_is_skipped_with_the_reason(name, tmp_path):
    with pytest.raises(module("rows").Missing, match=r"there is no|igl"):
        module(name).benchmarks(tmp_path, None)


# --- what is compared ----------------------------------------------------------------------------------------------


def test_bodies_are_closed_and_the_same_each_time():
    bodies = module("bodies")
    for number in range(5):
        one, again = bodies.observed(number), bodies.observed(number)
        assert np.array_equal(one.points, again.points) and one.truth.is_closed() and one.truth.volume() > 0
        assert len(one.points) in (150, 500, 2000)


@pytest.mark.parametrize("noise", ["isotropic", "anisotropic", "correlated"])
def test_noise_has_the_standard_deviation_that_is_stated(noise):
    bodies, rng = module("bodies"), np.random.default_rng(1)
    points = 50 * bodies.sampled(qf.Superquadric().mesh(24), 20_000, rng)
    error = bodies.disturbed(noise, points, 2.0, 50.0, rng) - points
    assert np.sqrt((error**2).mean()) == pytest.approx(2, rel=0.1)


def test_a_tenth_of_the_points_are_outliers():
    bodies, rng = module("bodies"), np.random.default_rng(1)
    points = 50 * bodies.sampled(qf.Superquadric().mesh(24), 20_000, rng)
    distances = np.abs(np.linalg.norm(bodies.disturbed("outliers", points, 0.1, 50.0, rng), axis=1) - 50)
    assert (distances > 1).mean() == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize("pattern", ["caps", "strips"])
def test_a_missing_part_of_the_surface_is_without_data(pattern):
    bodies, silent, rng = module("bodies"), module("silent"), np.random.default_rng(3)
    mesh = qf.Mesh(50 * qf.Superquadric().mesh(48).vertices, qf.Superquadric().mesh(48).faces)
    dense = bodies.sampled(mesh, 100_000, rng)
    mask, _ = bodies.seen(pattern, dense, 50.0, rng)
    data = bodies.Observed(mesh, dense[mask], 0.0, 1.7, 50.0)
    assert silent.unsupported(mesh, data) == pytest.approx(100 * (1 - mask.mean()), abs=5)
    assert silent.unsupported(mesh, bodies.Observed(mesh, dense, 0.0, 5.0, 50.0)) == 0


def test_denser_contours_pass_through_the_given_points():
    dense = module("dense")
    loops = dense.contours(0)
    more = dense.densified(loops)
    assert more.shape[1] == dense.TIMES * loops.shape[1]
    assert np.allclose(more[:, :: dense.TIMES], loops)
    later = dense.densified(np.roll(loops, 7, axis=1))  # where a closed contour begins does not matter
    assert np.allclose(later, np.roll(more, 7 * dense.TIMES, axis=1))
    step = np.linalg.norm(np.diff(np.concatenate([more, more[:, :1]], axis=1), axis=1), axis=2)
    assert step.max() < np.linalg.norm(np.diff(loops, axis=1), axis=2).max()


def test_contours_lie_on_the_body():
    dense, bodies = module("dense"), module("bodies")
    mesh = bodies.body(np.random.default_rng([3011, 2]))
    angles = np.arange(40) * 2 * np.pi / 40
    loop = dense._contour(mesh, 10.0, angles)
    ribbon = np.concatenate([loop, loop + np.array([0, 0, 1e-3])])
    flat = qf.Mesh(ribbon, np.array([[k, (k + 1) % 40, k + 40] for k in range(40)]))
    assert qf.surface_distances(flat, mesh)[0].largest < 0.5


def test_a_square_in_the_dual_orientation_has_the_axes_of_its_sides():
    shape = qf.Superquadric(semi_axes=(np.sqrt(2) * 3, np.sqrt(2) * 3, 5), exponents=(0.1, 2.0))
    axes, deviations = module("scans").standard_form(shape, np.ones(3))
    assert np.allclose(axes, [3, 3, 5]) and np.allclose(deviations, [np.sqrt(0.5), np.sqrt(0.5), 1])
    box = qf.Superquadric(semi_axes=(3, 3, 5), exponents=(0.1, 0.1))
    assert np.allclose(module("scans").standard_form(box, np.ones(3))[0], [3, 3, 5])


def test_a_cavity_is_cut_at_the_outer_faces_of_the_slices_with_labels():
    sunnybrook = module("sunnybrook")
    values = np.zeros((4, 4, 9), dtype=np.uint8)
    values[1:3, 1:3, 3:6] = 1
    affine = np.diag([1.0, 1.0, 8.0, 1.0])
    affine[2, 3] = -32.0  # slice 4 lies at 0: the faces are at -12 and 12
    image = qf.Volume(values, affine)
    faces = sunnybrook.stack_faces(image)
    assert sunnybrook.count(image) == pytest.approx(12 * 8 / 1000)
    zone = np.pi * (20**2 * 24 - 2 * 12**3 / 3) / 1000  # of a ball of radius 20 between the two planes
    assert sunnybrook.between(ball(20.0), faces) == pytest.approx(zone, rel=1e-3)
    assert sunnybrook.outside(ball(20.0), faces) == pytest.approx(8, abs=1e-6)
