"""`qf.fit`: bad clouds give one telling error each (ids are rows of the matrix), good ones a whole result."""

import hashlib

import numpy as np
import pytest
from notes import note_of
from shapes_made import even_directions, lumpy, made, turned, two_walls

import quadriform as qf
from quadriform.errors import DegenerateError, OptionError, PointsError

CLOUD, FEWER = lumpy(300), lumpy(150)
QUICK = {"method": "paper", "iterations": 2}
SMALL = {"box": (3, 3, 3)}


@pytest.fixture(scope="module")
def plain():
    """The default fit of the cloud, made once."""
    return qf.fit(CLOUD)


def with_value(value, rows=(7,)):
    cloud = CLOUD.copy()
    cloud[list(rows), 1] = value
    return cloud


def flat(seed=None):
    plane = CLOUD * [1, 1, 0]
    return plane if seed is None else plane @ turned(seed).T + 3


def masked():
    return np.ma.masked_greater(CLOUD, 20)


BAD = [
    ("A1", with_value(np.nan, (7, 9)), PointsError, "2 of 300 rows are not finite, the first at index 7"),
    ("A2", with_value(np.inf), PointsError, "1 of 300 rows are not finite, the first at index 7"),
    ("A2", with_value(-np.inf), PointsError, "not finite"),
    ("A3", np.empty((0, 3)), PointsError, "no points"),
    ("A4", CLOUD[:1], DegenerateError, "equal|distinct"),
    ("A4", CLOUD[:2], DegenerateError, "2 distinct points.*at least 11"),
    ("A4", CLOUD[:3], DegenerateError, "3 distinct points.*at least 11"),
    ("A5", CLOUD[:10], DegenerateError, "10 distinct points.*at least 11"),
    ("A6", np.tile(CLOUD[:6], (2, 1)), DegenerateError, "6 distinct points.*at least 11"),
    ("A7", np.ones((50, 3)), DegenerateError, "zero extent: all 50 points are equal"),
    ("A8", np.outer(np.arange(50.0), [1, 2, 3]), DegenerateError, "collinear.*rank 1 of 3"),
    ("A8", np.outer(np.arange(50.0), [1, 2, 3]) + 1e4, DegenerateError, "collinear.*rank 1 of 3"),
    ("A9", flat(), DegenerateError, "coplanar.*rank 2 of 3"),
    ("A9", flat(4), DegenerateError, "coplanar.*rank 2 of 3"),
    ("A16", 1e-160 * CLOUD, PointsError, "out of range"),
    ("A16", 1e160 * CLOUD, PointsError, "out of range"),
    ("A17", CLOUD > 0, PointsError, "real numbers, found type bool"),
    ("A17", (CLOUD * 1e17).astype(np.int64), PointsError, "2\\^53"),
    ("A19", CLOUD + 0j, PointsError, "complex128"),
    ("A19", CLOUD.astype(object), PointsError, "object"),
    ("A19", CLOUD.astype(str), PointsError, "type <U"),
    ("A19", CLOUD.astype("datetime64[s]"), PointsError, "datetime64"),
    ("A19", masked(), PointsError, "masked"),
    ("A19", np.zeros(20, [("a", float), ("b", float), ("c", float)]), PointsError, "columns named x, y and z"),
    ("A19", [[1, 2, 3], [4, 5]], PointsError, "unequal length"),
    ("A19", None, PointsError, "object"),
    ("A20", CLOUD.T, PointsError, r"expected .* \(n, 3\), found \(3, 300\); try points.T"),
    ("A20", CLOUD[:, :2], PointsError, r"found \(300, 2\)"),
    ("A20", np.ones((9, 4)), PointsError, r"found \(9, 4\)"),
    ("A20", CLOUD.ravel(), PointsError, r"found \(900,\)"),
    ("A20", CLOUD[None], PointsError, r"found \(1, 300, 3\)"),
    ("A20", CLOUD[:3], DegenerateError, "3 distinct points"),
    ("A20", 7.0, PointsError, r"found \(\)"),
]


@pytest.mark.parametrize(("row", "points", "error", "message"), BAD, ids=[f"{k}-{r[0]}" for k, r in enumerate(BAD)])
@pytest.mark.parametrize("door", [qf.fit, qf.fit_superquadric, lambda p: qf.refine(made(), p)])
def test_bad_clouds(door, row, points, error, message):
    with pytest.raises(error, match=message) as caught:
        door(points)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 4


@pytest.mark.parametrize("entry", [qf.fit_superquadric, lambda p: qf.refine(made(), p)])
def test_paths_are_for_fit_alone(entry):
    with pytest.raises(PointsError, match="found a path; only fit reads files"):
        entry("points.xyz")


def test_the_cloud_at_fault_is_named():
    with pytest.raises(PointsError, match=r"endo: points.*not finite"):
        qf.fit({"epi": CLOUD, "endo": with_value(np.nan)})
    with pytest.raises(OptionError, match=r"\['surface'\].*\['endo', 'epi'\].*same names"):
        qf.refine(made(), two_walls(50))
    with pytest.raises(OptionError, match="empty mapping"):
        qf.fit({})


def test_a_slab_is_fitted_and_warned_of():
    """Row A10: thin, not flat. The paper's descent creeps, or says that it did not arrive; the condition is told."""
    slab = CLOUD * [1, 1, 1e-3]
    crept = qf.fit_superquadric(slab, method="paper")
    needed = qf.fit_superquadric(CLOUD, method="paper").iterations
    assert crept.iterations > 5 * needed or crept.warnings.keys() & {"ILL_CONDITIONED", "MAX_ITERATIONS"}
    found = qf.fit_superquadric(slab)
    assert 1e3 < found.condition < 1e6 and 1e3 < crept.condition < 1e6
    assert found.superquadric.semi_axes.min() < 0.1 < 20 < np.sort(found.superquadric.semi_axes)[1]


KINDS_OF_ARRAY = {
    "unmasked": np.ma.masked_array,
    "float32": lambda p: p.astype(np.float32),
    "whole numbers": lambda p: p.astype(np.int32),
}


@pytest.mark.parametrize("kind", KINDS_OF_ARRAY)
def test_the_kind_of_array_does_not_matter(kind):
    """Rows A17 and A19: the same bytes as its contiguous float64 copy; other dresses are among the common checks."""
    rounded = np.round(CLOUD) + 0.0  # whole numbers know no negative zero
    found, plain = (qf.fit(p, **QUICK).model for p in (KINDS_OF_ARRAY[kind](rounded), rounded))
    assert found.box.control_points.tobytes() == plain.box.control_points.tobytes()
    assert found.input_sha256 == plain.input_sha256


def test_the_input_is_left_alone():
    """Row A21: read-only arrays are accepted, and nothing is written anywhere."""
    clouds = two_walls(150)
    for cloud in clouds.values():
        cloud.setflags(write=False)
    before = [hashlib.sha256(cloud.tobytes()).digest() for cloud in clouds.values()]
    starts = {name: qf.fit_superquadric(cloud).superquadric for name, cloud in clouds.items()}
    for regularity in ("svd", "springs", "springs-paper", "svd-position"):
        qf.refine(starts, clouds, regularity=regularity, **QUICK)
    weights = {name: np.arange(150.0) for name in clouds}
    loop = clouds["epi"][:20] + 0.0
    qf.refine(starts, clouds, weights=weights, base=loop, **SMALL)
    assert [weights[name].tolist() for name in clouds] == 2 * [list(range(150))]
    assert loop.tolist() == clouds["epi"][:20].tolist()
    assert [hashlib.sha256(cloud.tobytes()).digest() for cloud in clouds.values()] == before


def test_callers_who_let_numpy_raise():
    """Row D78: nothing inside leans on a silenced overflow."""
    with np.errstate(all="raise"):
        for regularity in ("svd", "springs", "springs-paper", "svd-position"):
            qf.fit(CLOUD, regularity=regularity, **QUICK)
        qf.fit(CLOUD, **SMALL)
        for kind in ("toroid", "hyperboloid1", "hyperboloid2"):
            qf.fit_superquadric(made(kind, (0.7, 1.2)).grid(6)[0], kind)
        wall = two_walls(150)["epi"]
        qf.fit_superquadric(wall + 0.3 * np.sin(wall[:, [1, 2, 0]]))  # some chances to be of it are near 1e-308


@pytest.mark.parametrize("method", ["tangent", "paper"])
def test_a_fit_holds_together(method, plain):
    fit = plain if method == "tangent" else qf.fit(CLOUD, **QUICK)
    assert fit.model.n_parameters == 386
    assert fit.compression_ratio == pytest.approx(3 * 300 / 386)
    assert (fit.n_points, fit.iterations) == (300, len(fit.history))
    assert fit.status == ("warned" if fit.warnings else "ok")
    np.testing.assert_allclose(fit.residuals, fit.model.distance(CLOUD), atol=1e-7)
    assert fit.rms == pytest.approx(np.sqrt((fit.residuals**2).mean()))
    assert fit.rms < fit.superquadric_rms
    assert fit.model.input_sha256 == hashlib.sha256(CLOUD.tobytes()).hexdigest()


def test_the_default_reports_its_uncertainty(plain):
    """Noise, inliers and the spread of the surface, in the unit of the points; the paper's method has no spread."""
    assert plain.status == "ok" and plain.strength > 0 and plain.noise > 0
    assert plain.inliers.shape == (300,) and (plain.inliers > 0.5).all()
    np.testing.assert_allclose(plain.covariance, plain.covariance.T, rtol=1e-9, atol=1e-12 * plain.noise**2)
    assert plain.covariance.shape == (375, 375)
    spread = plain.uncertainty(CLOUD)
    assert spread.shape == (300,) and (spread > 0).all()
    assert np.median(spread) < plain.noise
    assert plain.model.min_jacobian() > 0
    paper = qf.fit(CLOUD, **QUICK)
    assert paper.covariance is None and paper.noise == pytest.approx(paper.rms) and (paper.inliers == 1).all()
    with pytest.raises(OptionError, match="method='tangent'"):
        paper.uncertainty(CLOUD)


def test_a_larger_ruler_gives_larger_numbers(plain):
    """Everything with a length in it scales with the points: noise, covariance, uncertainty."""
    start = qf.fit_superquadric(CLOUD).superquadric
    one = qf.refine(start, CLOUD, **SMALL)
    ten = qf.refine(start.transformed(10, np.zeros(3)), 10 * CLOUD, **SMALL)
    assert ten.noise == pytest.approx(10 * one.noise, rel=1e-4)
    assert ten.strength == pytest.approx(one.strength, rel=1e-4)
    np.testing.assert_allclose(ten.uncertainty(10 * CLOUD), 10 * one.uncertainty(CLOUD), rtol=1e-3)
    assert np.trace(ten.covariance) == pytest.approx(100 * np.trace(one.covariance), rel=1e-3)


def test_outliers_are_detected_and_only_on_request():
    outliers = np.array([[90.0, 10, 0], [-20, 80, 5], [0, 0, -120.0]])
    mixed = np.concatenate([CLOUD, outliers])
    start = qf.fit_superquadric(mixed).superquadric
    fit = qf.refine(start, mixed, **SMALL)
    assert (fit.inliers[300:] < 0.01).all() and (fit.inliers[:300] > 0.5).mean() > 0.97
    assert "300, 301, 302" in note_of(fit, "OUTLIERS")
    clean = qf.refine(start, CLOUD, **SMALL)
    assert np.abs(fit.residuals[:300]).max() < 1.2 * np.abs(clean.residuals).max()
    trusting = qf.refine(start, mixed, robust=False, **SMALL)
    assert (trusting.inliers == 1).all() and not note_of(trusting, "OUTLIERS")
    assert (trusting.residuals[:300] ** 2).mean() > 4 * (fit.residuals[:300] ** 2).mean()


def test_two_surfaces_share_a_box():
    clouds = two_walls(150)
    fit = qf.fit(clouds, **QUICK)
    assert fit.model.n_parameters == 397
    assert list(fit.residuals) == list(fit.model.surfaces) == ["epi", "endo"]
    assert fit.compression_ratio == pytest.approx(3 * 300 / 397)
    assert fit.model.contains(fit.model.mesh("endo", 6).vertices, "epi").all()
    np.testing.assert_allclose(fit.residuals["endo"], fit.model.distance(clouds["endo"], "endo"), atol=1e-6)


def test_partial_and_poor_clouds_are_warned_of_by_the_papers_method_too():
    """Of the default one by the rows 25 and 30 of bad clouds."""
    octant = made(exponents=(1, 1)).surface(np.abs(even_directions(300)))
    assert "PARTIAL_COVERAGE" in qf.fit(octant, **QUICK).warnings
    filled = lumpy(300) * np.cbrt(np.random.default_rng(0).uniform(0, 1, (300, 1)))
    poor = qf.fit(filled, **QUICK)
    assert "POOR_FIT" in poor.warnings
    with pytest.raises(qf.errors.FitError, match="POOR_FIT"):
        poor.require_ok()


def test_points_in_centimetres_are_refined_in_the_unit_of_their_fit():
    """Old bug: the superquadric was in millimetres, the points stayed in centimetres, the unit was forgotten."""
    table = np.rec.fromarrays(FEWER.T, names="x_cm,y_cm,z_cm")
    fit = qf.fit(table, box=(3, 3, 3))
    again = qf.refine(fit.model.surfaces["surface"], table, box=(3, 3, 3))
    assert fit.model.unit == again.model.unit == "mm"
    assert again.rms == pytest.approx(fit.rms, rel=0.05)
    assert "lengths in cm became mm" in again.notes


def in_centimetres(points):
    return np.rec.fromarrays(points.T / 10, names="x_cm,y_cm,z_cm")


def test_a_base_is_in_the_unit_of_the_points():
    """Old bug: of points in centimetres it was taken for millimetres, and lay in the middle of the points."""
    cup = FEWER[FEWER[:, 2] < 10]
    loop = np.array([[9.0, 0, 10], [-9, 9, 10], [0, -9, 10]])
    options = {"strength": 1e-4, **SMALL}
    for base, smaller in (((loop[0], [0, 0, 1.0]), (loop[0] / 10, [0, 0, 1.0])), (loop, loop / 10)):
        fit = qf.fit(cup, base=base, unit="mm", **options)
        again = qf.fit(in_centimetres(cup), base=smaller, **options)
        np.testing.assert_allclose(again.model.landmarks.base.point, fit.model.landmarks.base.point)
        assert again.rms == pytest.approx(fit.rms, rel=1e-6)
    moving = qf.track([in_centimetres(cup), in_centimetres(0.9 * cup)], base=(loop[0] / 10, [0, 0, 1.0]), **options)
    same = qf.track([cup, 0.9 * cup], base=(loop[0], [0, 0, 1.0]), **options)
    assert moving.rms == pytest.approx(same.rms, rel=1e-6)


def test_a_viewpoint_and_a_support_are_in_the_unit_of_the_points():
    """Old bug: of points in centimetres both were taken for millimetres."""
    seen, eye, plane = FEWER[FEWER[:, 2] > 0], np.array([0.0, 0, 500]), np.array([0.0, 0, -60])
    up = [0, 0, 1.0]
    fit = qf.fit(seen, viewpoint=eye, support=(plane, up), unit="mm", **SMALL)
    again = qf.fit(in_centimetres(seen), viewpoint=eye / 10, support=(plane / 10, up), **SMALL)
    assert again.rms == pytest.approx(fit.rms, rel=1e-6)
    with pytest.raises(OptionError, match="viewpoint"):
        qf.fit(in_centimetres(seen), viewpoint=[0, 0, 1.0], **SMALL)


def test_the_largest_error_is_in_the_unit_of_the_points():
    one, other = (
        qf.fit(cloud, box="auto", max_error=error) for cloud, error in ((in_centimetres(FEWER), 0.3), (FEWER, 3.0))
    )
    assert one.model.box.control_points.shape == other.model.box.control_points.shape


def test_lengths_beside_clouds_in_several_units_are_refused():
    walls = two_walls(300)
    inches = np.rec.fromarrays(walls["endo"].T / 25.4, names="x_inch,y_inch,z_inch")
    with pytest.raises(OptionError, match="expected one unit for all clouds"):
        qf.fit({"epi": in_centimetres(walls["epi"]), "endo": inches}, base=([0, 0, 9.0], [0, 0, 1.0]))


def test_points_with_a_weight_need_an_extent():
    """Old bug: one point that counts ended in a division by zero."""
    weights = np.zeros(200)
    weights[7] = 1
    with pytest.raises(DegenerateError, match="zero extent"):
        qf.refine(made(), lumpy(200), weights=weights)
    weights[:10] = 1
    with pytest.raises(DegenerateError, match="10"):
        qf.refine(made(), lumpy(200), weights=weights)


def test_few_points_of_which_one_is_far_away_are_fitted():
    """Old bug: an error of SciPy, for without the far one there are fewer points than parameters."""
    points = np.vstack([10 * even_directions(10), [[300.0, 0, 0]]])
    assert np.isfinite(qf.fit(points).model.box.control_points).all()
