"""Rows 34, 35, 38, 41 and 43 of docs/reliability.md: normals, few points, surfaces beyond the box, frames."""

import numpy as np
import pytest
from shapes_made import even_directions, gap, lumpy

import quadriform as qf
from quadriform.errors import OptionError, PointsError
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.segmentation import Labels
from quadriform.imaging.volume import Volume

SMALL = {"box": (3, 3, 3)}
PLY = "ply\nformat ascii 1.0\nelement vertex {}\n" + "".join(f"property double {c}\n" for c in "xyz")
NORMALS = "".join(f"property double n{c}\n" for c in "xyz")


@pytest.mark.parametrize("sign", [1, -1, 0], ids=["34 outward", "34 flipped", "34 zero"])
def test_normals_of_a_file_are_not_read(tmp_path, sign):
    points = lumpy(50)
    rows = "".join(" ".join(map(repr, row)) + "\n" for row in np.hstack([points, sign * points]).tolist())
    (tmp_path / "cloud.ply").write_text(PLY.format(50) + NORMALS + "end_header\n" + rows)
    np.testing.assert_array_equal(qf.read_points(tmp_path / "cloud.ply"), points)


@pytest.mark.parametrize("signs", ["arbitrary", "zero"])
def test_row_34_the_signs_of_normals_do_not_matter(signs):
    """Some are flipped, or all are nothing; how long they are does not matter either."""
    cloud, rng = lumpy(100), np.random.default_rng(3)
    normals = qf.Superquadric(semi_axes=(32, 27, 38)).gradient(cloud)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sign = {"arbitrary": rng.choice([-1.0, 1.0], (100, 1)), "zero": 0}[signs]
    plain = qf.fit(cloud, normals=None if signs == "zero" else normals, box=(2, 2, 2))
    found = qf.fit(cloud, normals=7 * sign * normals, box=(2, 2, 2))
    np.testing.assert_allclose(found.residuals, plain.residuals, atol=1e-12)


def test_row_35_more_control_points_than_points():
    """40 points, 375 coordinates: what holds the box decides the rest, stays near the points and is uncertain there."""
    points = lumpy(40)
    found = qf.fit(points)
    assert found.status == "warned" and "PARTIAL_COVERAGE" in found.warnings
    assert np.isfinite(found.model.box.control_points).all() and np.isfinite(found.covariance).all()
    size = np.ptp(points, axis=0)
    assert (np.ptp(found.model.mesh(resolution=8).vertices, axis=0) < 1.5 * size).all()
    assert found.model.min_jacobian() > 0


def test_row_35_a_box_without_regularisation_is_refused():
    with pytest.raises(OptionError, match="strength=0"):
        qf.fit(lumpy(40), strength=0)


@pytest.mark.parametrize(
    ("count", "strength", "ill_conditioned"), [(40, 1e-12, True), (40, "auto", False), (150, 1e-10, False)]
)
def test_row_35_a_strength_that_leaves_control_points_to_rounding_is_named(count, strength, ill_conditioned):
    """Points in another order, of which sums round otherwise, have the same surface to 1e-6 r unless it is named."""
    points = lumpy(count)
    found, other = (qf.fit(each, strength=strength) for each in (points, points[::-1]))
    assert ("ILL_CONDITIONED" in found.warnings) == ill_conditioned
    one, two = (fit.model.mesh(resolution=8).vertices for fit in (found, other))
    assert ill_conditioned or np.abs(one - two).max() < 1e-6 * np.sqrt(points.var(axis=0).sum())


def side_by_side():
    u = even_directions(300)
    return {"large": u * [3, 2, 4], "small": u * [1, 1.2, 0.8] + [8, 0, 0]}


def test_row_38_the_box_grows_around_all_surfaces():
    found = qf.fit(side_by_side(), **SMALL)
    for name in found.model.surfaces:
        local = found.model.box.local(found.model.superquadric(name).grid(8)[0])
        assert ((local > -1e-9) & (local < 1 + 1e-9)).all()
    assert "OUTSIDE_LATTICE" not in found.warnings


def test_row_38_the_papers_box_does_not_and_says_so():
    found = qf.fit(side_by_side(), method="paper", iterations=2)
    assert found.status == "warned"
    assert found.warnings["OUTSIDE_LATTICE"].startswith("small: 100 %")


def test_row_41_an_empty_frame_is_named():
    with pytest.raises(PointsError, match=r"frame 1: .*there are no points"):
        qf.track([lumpy(100), np.empty((0, 3)), lumpy(100)])


def body(shrink):
    """A label image of a lumpy body without symmetry."""
    affine = np.array([[2.7, 0.4, 0, -33], [-0.4, 2.7, 0, -23], [0, 0, 3.3, -31], [0, 0, 0, 1]])
    at = np.moveaxis(np.indices((23, 21, 20)), 0, -1) @ affine[:3, :3].T + affine[:3, 3]
    at = (at + 2 * np.sin(at[..., [1, 2, 0]] / 9 + [0.3, 1.0, 2.0])) / [20, 15, 24]
    return Volume(((at**2).sum(axis=-1) < shrink).astype(np.uint8), affine)


def turned_over(volume):
    """The same voxels at the same places: axes permuted, one of them backwards."""
    values, affine = volume.values.transpose(2, 0, 1)[::-1], volume.world_from_voxel[:, [2, 0, 1, 3]]
    affine[:3, 3] += (len(values) - 1) * affine[:3, 0]
    affine[:3, 0] *= -1
    return Volume(values, affine)


def test_row_43_each_frame_may_lie_on_a_grid_of_its_own():
    one, two, three = (body(shrink) for shrink in (1.0, 0.9, 0.8))

    def tracked(*volumes):
        return qf.track([points_from_image(v, select=Labels((1,))).points for v in volumes], **SMALL)

    plain, mixed = tracked(one, two, three), tracked(one, turned_over(two), three)
    assert max(gap(a, b) for a, b in zip(plain.models, mixed.models)) < 1e-6
