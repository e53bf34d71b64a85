import numpy as np
import pytest
from numpy.testing import assert_allclose

from quadriform.errors import AffineError, MaskError, OptionError, PointsError
from quadriform.imaging.volume import Volume


def test_spacing_comes_from_the_whole_affine():
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    affine = np.eye(4)
    affine[:3, :3] = turn @ np.diag([2.0, 3.0, -5.0])
    assert_allclose(Volume(np.zeros((2, 2, 2)), affine).spacing, [2, 3, 5], rtol=1e-14)


def test_points_world_is_the_affine(oblique):
    volume = Volume(np.zeros((4, 5, 6)), oblique)
    assert_allclose(volume.points_world([[0, 0, 0]]), [oblique[:3, 3]], rtol=0)
    step = volume.points_world([[1.5, 2, 3]]) - volume.points_world([[0.5, 2, 3]])
    assert_allclose(step, [oblique[:3, 0]], atol=1e-13)


def test_points_world_checks_its_voxels(oblique):
    with pytest.raises(PointsError, match="voxels"):
        Volume(np.zeros((4, 5, 6)), oblique).points_world([[0.0, 1.0]])


def test_a_crop_stays_where_it_was(oblique, rng):
    volume = Volume(rng.random((7, 8, 9)), oblique)
    part = volume.crop(((2, 5), (1, 8), (4, 6)))
    assert part.values.shape == (3, 7, 2)
    assert part.values[1, 2, 1] == volume.values[3, 3, 5]
    assert_allclose(part.points_world([[1, 2, 1]]), volume.points_world([[3, 3, 5]]), atol=1e-12)


def test_the_affine_is_a_copy(oblique):
    volume = Volume(np.zeros((2, 2, 2)), oblique)
    oblique[:] = 0
    assert volume.world_from_voxel[3, 3] == 1


@pytest.mark.parametrize(
    "region",
    [
        ((0, 7), (0, 8), (0, 10)),
        ((-1, 7), (0, 8), (0, 9)),
        ((3, 3), (0, 8), (0, 9)),
        ((5, 2), (0, 8), (0, 9)),
        ((0.0, 7.0), (0, 8), (0, 9)),
        ((0, 7), (0, 8)),
    ],
)
def test_a_region_outside_the_image_is_refused(region):
    with pytest.raises(OptionError, match=r"region.*\(7, 8, 9\)"):
        Volume(np.zeros((7, 8, 9)), np.eye(4)).crop(region)


@pytest.mark.parametrize(
    "change, said",
    [
        (lambda a: a[:3], "shape"),
        (lambda a: np.where(a == a[0, 3], np.nan, a), "finite"),
        (lambda a: np.zeros((4, 4)), "last row"),
        (lambda a: np.diag([1.0, 1.0, 0.0, 1.0]), "singular"),
        (lambda a: np.vstack([a[0], a[0], a[2], a[3]]), "singular"),
        (lambda a: np.diag([1.0, 1.0, 1.0, 2.0]), "last row"),
    ],
)
def test_an_unusable_affine_is_refused(oblique, change, said):
    with pytest.raises(AffineError, match=said):
        Volume(np.zeros((2, 2, 2)), change(oblique))


def test_a_tiny_voxel_is_not_singular():
    assert_allclose(Volume(np.zeros((2, 2, 2)), np.diag([1e-6, 1e-6, 1e-6, 1])).spacing, 1e-6)


@pytest.mark.parametrize("shape", [(4, 4), (4, 4, 4, 2), (0, 4, 4)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(MaskError, match=rf"{shape[-1]}\)"):
        Volume(np.zeros(shape), np.eye(4))


def test_complex_values_are_refused():
    with pytest.raises(MaskError, match="complex"):
        Volume(np.zeros((2, 2, 2), complex), np.eye(4))


def test_nan_voxels_are_counted():
    values = np.zeros((3, 3, 3))
    values[1, 2, 0] = values[2, 0, 0] = np.nan
    with pytest.raises(MaskError, match=r"2 of 27 .*\(1, 2, 0\)"):
        Volume(values, np.eye(4))


def test_unknown_frames_and_units_are_refused():
    with pytest.raises(OptionError, match="space"):
        Volume(np.zeros((2, 2, 2)), np.eye(4), space="XYZ")
    with pytest.raises(OptionError, match="unit"):
        Volume(np.zeros((2, 2, 2)), np.eye(4), unit="inch")
