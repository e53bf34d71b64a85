"""Each step from voxels to the points of a ventricle, against plain loops over points and voxels."""

import numpy as np
import pytest

from quadriform.errors import MaskError, OptionError
from quadriform.imaging import ventricle
from quadriform.imaging.isosurface import edge_noise
from quadriform.imaging.segmentation import Labels
from quadriform.imaging.thinning import default_spacing, thinned
from quadriform.imaging.ventricle import ventricle_from_labels, ventricle_from_perfusion
from quadriform.imaging.volume import Volume
from quadriform.imaging.voxel_faces import BACKGROUND, CAVITY, WALL
from quadriform.shapes.landmarks import GIVEN_BASE

AFFINE = np.diag([1.5, 2.0, 4.0, 1.0])
BLOOD, MUSCLE = Labels((1,)), Labels((2,))


@pytest.mark.parametrize("side", [0.3, 1.0, 2.5])
def test_of_the_points_in_each_cube_the_one_nearest_to_its_centre_is_kept(side, rng):
    points = rng.uniform(-3, 3, (80, 3))
    best = {}
    for at, point in enumerate(points):
        scaled = point / side + [0.31830989, 0.36787944, 0.41421356]
        cube = tuple(np.floor(scaled))
        off = np.linalg.norm(scaled - np.floor(scaled) - 0.5)
        best[cube] = min(best.get(cube, (np.inf, 0)), (off, at))
    expected = sorted(at for _, at in best.values())
    np.testing.assert_array_equal(thinned(points, side), points[expected])
    order = rng.permutation(80)
    assert set(map(tuple, thinned(points[order], side))) == set(map(tuple, points[expected]))
    np.testing.assert_array_equal(thinned(points, 0), points)
    assert thinned(points[:0], side).shape == (0, 3)


def test_the_spacing_is_halved_while_points_are_few_and_voxels_allow_it(rng):
    image = Volume(np.zeros((2, 2, 2)), AFFINE)
    few, many = rng.uniform(-9, 9, (900, 3)), rng.uniform(-90, 90, (900, 3))
    assert len(thinned(few, 4.0)) < 750 <= len(thinned(many, 4.0))
    assert default_spacing({"endo": many}, image.spacing) == 4
    assert default_spacing({"endo": many, "epi": few}, image.spacing) == 2  # a half of it is below 1.5
    finer = Volume(np.zeros((2, 2, 2)), np.diag([0.5, 2.0, 4.0, 1.0]))
    assert default_spacing({"endo": few[:700]}, finer.spacing) == 0.5
    least = next(side for side in (4.0, 2.0, 1.0, 0.5) if len(thinned(few, side)) >= 750 or side == 0.5)
    assert default_spacing({"endo": few}, finer.spacing) == least


def test_points_beyond_a_plane_are_cut_off_and_those_on_it_stay():
    heights = np.array([-1.0, -1e-12, 0.0, 0.9e-9, 1.1e-9, 0.5])
    points = np.outer(heights, [0.6, 0, 0.8]) + np.array([3, 2, 1])
    plane = np.array([3.0, 2, 1]), np.array([0.6, 0, 0.8])
    assert ventricle._cut_off(points, plane).tolist() == [False] * 4 + [True] * 2
    assert ventricle._cut_off(1e3 * points, (1e3 * plane[0], plane[1])).tolist() == [False] * 4 + [True] * 2
    assert ventricle._cut_off(points[:0], plane).tolist() == []


def test_the_outermost_points_are_repeated_just_below_the_face():
    image = Volume(np.zeros((2, 2, 2)), AFFINE)
    face = np.array([0.0, 0, 10]), np.array([0.0, 0, 1])
    points = np.array([[0, 0, 8.0], [1, 0, 7.01], [2, 0, 6.99], [3, 0, 6.0]])  # down to three quarters of 4
    found = ventricle._up_to_face(points, face, image)
    np.testing.assert_allclose(found, [*points, [0, 0, 9.96], [1, 0, 8.97]])


@pytest.mark.parametrize("edge", [[0.5, 0, 0], [0, 0.5, 0]])
def test_repeated_points_keep_the_error_of_their_edge(edge):
    image = Volume(np.zeros((2, 2, 2)), AFFINE)
    face = np.array([0.0, 0, 6]), np.array([0.0, 0, 1])  # half a voxel beyond the centres of the second slice
    points = image.points_world([np.add([0, 1, 1], edge)])
    first, repeated = edge_noise(image, ventricle._up_to_face(points, face, image))
    np.testing.assert_array_equal(first, repeated)
    step = 2 * AFFINE[:3, :3] @ edge
    np.testing.assert_allclose(first, np.outer(step, step) / 12)


def test_the_height_of_a_voxel_is_that_along_the_normal_of_its_face():
    skewed = AFFINE.copy()
    skewed[:2, 2] = [0.5, -0.7]
    assert ventricle._height(np.array([0, 0, 1.0]), Volume(np.zeros((2, 2, 2)), skewed)) == 4
    mirrored = Volume(np.zeros((2, 2, 2)), AFFINE @ np.diag([-1.0, 1, 1, 1]))
    assert ventricle._height(np.array([-1.0, 0, 0]), mirrored) == 1.5


@pytest.mark.parametrize(
    ("face", "position", "direction"),
    [
        ((2, -1), (3.75, 5.0, 14.0), (0, 0, 1)),
        ((2, 0), (1.5, 2.0, -2.0), (0, 0, -1)),
        ((0, 0), (-0.75, 2.0, 0.0), (-1, 0, 0)),
        ((1, -1), (3.75, 7.0, 12.0), (0, 1, 0)),
    ],
)
def test_a_base_at_a_face_is_the_outside_of_its_voxels_in_their_middle(face, position, direction):
    cavity = np.zeros((4, 4, 4), dtype=bool)
    cavity[0, 1, 0] = cavity[2, 1, 0] = True
    cavity[2, 2, 3] = cavity[3, 3, 3] = cavity[2, 3, 3] = cavity[3, 2, 3] = True
    found = ventricle._plane_of(face, cavity, Volume(cavity, AFFINE))
    np.testing.assert_allclose(found, (position, direction))


def test_vertices_know_the_tissues_of_both_voxels_of_their_edge():
    tissue = np.zeros((5, 5, 5), dtype=np.int8)
    tissue[2, 2, 2], tissue[3, 2, 2], tissue[1, 2, 2] = CAVITY, WALL, WALL
    cropped = Volume(tissue, AFFINE)
    points, ends = ventricle._surface(tissue == CAVITY, tissue, cropped)
    centre = cropped.points_world([[2, 2, 2]])[0]
    for point, pair in zip(points, ends):
        along = np.sign(np.round(point - centre, 9))
        other = tissue[tuple((np.array([2, 2, 2]) + along).astype(int))]
        assert sorted(pair) == sorted((CAVITY, other))
        np.testing.assert_allclose(np.abs(point - centre).max(), np.abs(along @ (AFFINE[:3, :3] / 2)).max())
    assert len(points) == 6 and (ends == WALL).any(axis=1).sum() == 2
    assert BACKGROUND in ends


def hollow(size=11, wall=2, cut=None):
    """A cube of cavity in a wall, its upper end open from a slice on."""
    values = np.zeros((size, size, size), dtype=np.uint8)
    values[1:-1, 1:-1, 1:-1] = 2
    inner = slice(1 + wall, size - 1 - wall)
    values[inner, inner, inner] = 1
    if cut:
        values[inner, inner, inner.stop : size - 1] = cut
    return Volume(values, AFFINE)


def test_the_share_of_the_cavity_without_wall_is_stated():
    assert "OPEN_WALL" not in ventricle_from_labels(hollow(), cavity=BLOOD, wall=MUSCLE).warnings
    values = hollow().values.copy()
    values[3:8, 3:8, 8:10] = 0  # the cavity meets the background at one of six faces
    found = ventricle_from_labels(Volume(values, AFFINE), cavity=BLOOD, wall=MUSCLE, base=((0, 0, 99), (0, 0, 1)))
    areas = np.array([8.0, 6.0, 3.0])
    share = 25 * areas[2] / (2 * 25 * areas.sum())
    assert found.warnings["OPEN_WALL"].startswith(f"{share:.1%} of the cavity's surface")


def test_cavity_and_wall_that_are_swapped_are_refused():
    """Where they touch the background over equal areas they are not."""
    values = np.zeros((6, 4, 4), dtype=np.uint8)
    values[1:3, 1:3, 1:3], values[3:5, 1:3, 1:3] = 1, 2
    tissue = np.where(values == 1, CAVITY, np.where(values == 2, WALL, BACKGROUND)).astype(np.int8)
    ventricle._check_order(tissue, BLOOD, MUSCLE, AFFINE)
    tissue[4] = BACKGROUND
    with pytest.raises(MaskError, match="swapped"):
        ventricle._check_order(tissue, BLOOD, MUSCLE, AFFINE)


def test_numbers_of_voxels_and_points_are_recorded():
    found = ventricle_from_labels(hollow(), cavity=BLOOD, wall=MUSCLE, base=((0, 0, 26.0), (0, 0, 1)), spacing=0)
    assert (found.record["cavity_voxels"], found.record["wall_voxels"]) == (125, 729 - 125)
    assert found.record["spacing"] == 0
    whole = ventricle_from_labels(hollow(), cavity=BLOOD, wall=MUSCLE, spacing=0)
    for name, points in whole.clouds.items():
        beyond = points[:, 2] > 26 + 1e-6
        assert found.record["beyond_base"][name] == beyond.sum() > 0
        np.testing.assert_allclose(found.clouds[name], points[~beyond])
        np.testing.assert_array_equal(found.clouds[name], found.unthinned[name])
    with pytest.warns(DeprecationWarning, match="isosurfaces is named unthinned"):
        assert found.isosurfaces is found.unthinned
    assert found.base_from == GIVEN_BASE
    assert found.landmarks.base is not None and whole.landmarks.base is None and whole.base_from == ""
    with pytest.raises(OptionError, match="direction that is not 0"):
        ventricle_from_labels(hollow(), cavity=BLOOD, base=((0, 0, 1), (0, 0, 0)))
    with pytest.raises(MaskError, match="epi: all 4 points lie beyond"):
        far = np.ones((4, 3))
        ventricle._finish({"epi": far}, (np.zeros(3), np.array([0, 0, 1.0])), {}, hollow().values, hollow(), 0)


def horseshoe():
    """A bright cup, open upwards, with a dark voxel in its wall."""
    at = np.moveaxis(np.indices((21, 21, 18)), 0, -1) - [10, 10, 12]
    radius = np.linalg.norm(at * [1, 1, 0.8], axis=-1)
    values = np.where((radius > 5) & (radius < 9) & (at[..., 2] < 1), 100.0, 0.0)
    values[10, 10, 4] = 0.0
    return Volume(values, np.diag([2.0, 2.0, 2.0, 1.0]))


def test_points_of_an_open_wall_face_the_cavity_or_the_outside():
    found = ventricle_from_perfusion(horseshoe(), spacing=0)
    centre = np.array([20.0, 20.0, 24.0])
    radius = {name: np.linalg.norm((p - centre) * [1, 1, 0.8], axis=1) for name, p in found.clouds.items()}
    assert radius["endo"].max() < 12.5 and radius["endo"].min() > 8
    assert radius["epi"].min() > 15.5 and radius["epi"].max() < 19.5
    removed, total = sum(found.record["beyond_base"].values()), found.record["beyond_base"]
    whole = removed + sum(map(len, found.unthinned.values()))
    assert found.warnings["OPEN_BASE"] == f"the wall is open; {removed} of {whole} points at its rim are left out"
    assert removed > 0 and set(total) == {"endo", "epi"}
    given = ventricle_from_perfusion(horseshoe(), spacing=0, base=((20, 20, 22.0), (0, 0, 1)))
    assert "OPEN_BASE" not in given.warnings and max(p[:, 2].max() for p in given.clouds.values()) <= 22 + 1e-6
    assert given.base_from != found.base_from == ventricle.OPENING
