"""Faces of voxels in skewed and mirrored grids, counted one by one; the open end of a stack of slices."""

from itertools import product

import numpy as np
import pytest

from quadriform.imaging import stack_end
from quadriform.imaging.stack_end import closed_but_for, flat_end, open_face, region_up_to
from quadriform.imaging.volume import Volume
from quadriform.imaging.voxel_faces import (
    BACKGROUND,
    CAVITY,
    WALL,
    border_cut_text,
    contact_area,
    enclosed_fraction,
    face_area_vectors,
    faces_between,
)

SKEWED = np.array([[1.5, 0.2, 0.1, 4.0], [-0.3, 2.0, 0.3, -7.0], [0.1, 0.4, 3.0, 2.0], [0, 0, 0, 1]])
MIRRORED = SKEWED @ np.diag([1.0, 1, -1, 1])


def random_tissue(shape=(4, 5, 3), seed=2):
    return np.random.default_rng(seed).integers(0, 3, shape).astype(np.int8)


def plain_faces(tissue, affine, one, other):
    """Centre and area vector of each face between two neighbours, by the three edges of a voxel."""
    edges = affine[:3, :3].T
    found = []
    for at in product(*map(range, tissue.shape)):
        for axis in range(3):
            after = np.array(at) + np.eye(3, dtype=int)[axis]
            if after[axis] == tissue.shape[axis]:
                continue
            area = np.cross(edges[axis - 2], edges[axis - 1])
            area *= np.sign(area @ edges[axis])
            pair = tissue[at], tissue[tuple(after)]
            if pair in ((one, other), (other, one)):
                middle = (np.array(at) + after) / 2
                found.append((affine[:3, :3] @ middle + affine[:3, 3], area if pair[0] == one else -area))
    return found


@pytest.mark.parametrize("affine", [SKEWED, MIRRORED])
def test_faces_between_tissues_lead_from_one_to_the_other(affine):
    tissue = random_tissue()
    centres, areas = faces_between(tissue, CAVITY, WALL, affine)
    expected = plain_faces(tissue, affine, CAVITY, WALL)
    found = sorted(map(tuple, np.round(np.hstack([centres, areas]), 9)))
    assert found == sorted(map(tuple, np.round([np.hstack(each) for each in expected], 9)))
    total = sum(np.linalg.norm(area) for _, area in expected)
    assert contact_area(tissue, CAVITY, WALL, affine) == pytest.approx(total)
    to_air = sum(np.linalg.norm(area) for _, area in plain_faces(tissue, affine, CAVITY, BACKGROUND))
    assert enclosed_fraction(tissue, affine) == pytest.approx(total / (total + to_air))
    assert enclosed_fraction(np.zeros_like(tissue), affine) == 0


@pytest.mark.parametrize("affine", [SKEWED, MIRRORED])
def test_area_vectors_lead_to_the_next_voxel(affine):
    areas, edges = face_area_vectors(affine), affine[:3, :3].T
    for axis in range(3):
        others = np.delete(edges, axis, axis=0)
        np.testing.assert_allclose(others @ areas[axis], 0, atol=1e-12)
        assert areas[axis] @ edges[axis] == pytest.approx(abs(np.linalg.det(affine)))


def test_the_cut_is_the_share_of_the_surface_at_the_border():
    inside = np.zeros((4, 5, 3), dtype=bool)
    inside[0, 1:3, 1] = inside[1, 1, 1] = inside[2, 1, 2] = True
    areas = np.linalg.norm(face_area_vectors(SKEWED), axis=1)
    padded = np.pad(inside, 1)
    total = sum(area * np.count_nonzero(np.diff(padded, axis=axis)) for axis, area in enumerate(areas))
    cut = 2 * areas[0] + areas[2]
    text = border_cut_text(inside, SKEWED)
    assert (
        text == f"the image cuts the object at first i (2 voxels), last k (1 voxels): {cut / total:.1%} of its surface"
    )
    assert border_cut_text(np.pad(inside, 1), SKEWED) == ""


def stack(sections, covered=None, shape=(20, 20), axis=2):
    """A cavity of square sections (side of each slice); wall over the cavity in the slices `covered`."""
    tissue = np.zeros((*shape, len(sections)), dtype=np.int8)
    for k, side in enumerate(sections):
        tissue[:side, :side, k] = CAVITY
    for k in covered or ():
        tissue[..., k][tissue[..., k] == BACKGROUND] = WALL
    return np.moveaxis(tissue, 2, axis)


THICK = {axis: np.diag([*np.where(np.arange(3) == axis, 8.0, 1.5), 1.0]) for axis in range(3)}


@pytest.mark.parametrize("axis", range(3))
def test_a_flat_end_is_the_one_of_the_larger_open_section(axis):
    sections = [0, 6, 8, 10, 10, 0]
    assert flat_end(stack(sections, axis=axis), THICK[axis]) == (axis, -1)
    assert flat_end(stack(sections[::-1], axis=axis), THICK[axis]) == (axis, 0)
    assert flat_end(stack([6, 8, 10, 10], axis=axis), THICK[axis]) == (axis, -1)  # at the end of the image
    assert flat_end(stack(sections, covered=[5], axis=axis), THICK[axis]) is None


@pytest.mark.parametrize("slices", [2, 5, 10])
def test_an_end_is_flat_where_it_is_nearer_to_the_widest_section_than_to_that_of_an_ellipsoid(slices):
    least = np.sqrt(1 - (1 - 1 / slices) ** 2) * 400
    for side in range(1, 20):
        sections = [0, side, *([20] * (slices - 1)), 0]
        covered = [slices + 1]
        expected = (2, 0) if side**2 > least else None
        assert flat_end(stack(sections, covered), THICK[2]) == expected


def test_voxels_that_a_wall_covers_are_not_open():
    across = np.moveaxis(stack([4, 4, 0]), 2, 0)
    assert [stack_end._open_voxels(across, *pair) for pair in ((1, 2), (0, -1), (0, 1))] == [16, 16, 16]
    across[2, :2, :4] = WALL
    assert stack_end._open_voxels(across, 1, 2) == 8


def test_a_region_ends_with_the_labels_of_the_cavity():
    tissue = stack([0, 0, 3, 5, 4, 0])
    region = ((2, 22), (3, 23), (10, 16))
    assert region_up_to(tissue, region, (2, 0)) == ((2, 22), (3, 23), (12, 16))
    assert region_up_to(tissue, region, (2, -1)) == ((2, 22), (3, 23), (10, 15))
    assert region_up_to(tissue, region, (0, -1)) == ((2, 7), (3, 23), (10, 16))


@pytest.mark.parametrize("affine", [SKEWED, MIRRORED])
def test_the_open_face_is_known_or_towards_a_base_or_cuts_the_largest_area(affine):
    tissue = np.zeros((6, 6, 6), dtype=np.int8)
    tissue[0, :2, :2] = tissue[:2, -1, :3] = CAVITY
    cropped = Volume(tissue, affine)
    assert open_face(tissue, cropped, (2, -1), None) == (2, -1)
    areas = face_area_vectors(affine)
    for axis, which in product(range(3), (0, -1)):
        outward = areas[axis] * (-1 if which == 0 else 1)
        assert open_face(tissue, cropped, None, (np.zeros(3), outward)) == (axis, which)
    sizes = {
        (axis, which): (tissue.take(which, axis) == CAVITY).sum() * np.linalg.norm(areas[axis])
        for axis, which in product(range(3), (0, -1))
    }
    assert open_face(tissue, cropped, None, None) == max(sizes, key=sizes.get)
    assert open_face(np.where(tissue == CAVITY, WALL, BACKGROUND).astype(np.int8), cropped, None, None) is None


def test_other_faces_that_cut_are_closed_by_a_layer_of_background():
    tissue = np.zeros((4, 5, 6), dtype=np.int8)
    tissue[0, 1, 1], tissue[2, 4, 2], tissue[1, 1, 0], tissue[1, 1, 5] = CAVITY, WALL, CAVITY, CAVITY
    padded, image = closed_but_for((2, 0), tissue, Volume(tissue, SKEWED))
    np.testing.assert_array_equal(padded, np.pad(tissue, ((1, 0), (0, 1), (0, 1))))
    np.testing.assert_array_equal(image.values, padded)
    np.testing.assert_allclose(image.points_world([[1, 0, 0]]), Volume(tissue, SKEWED).points_world([[0, 0, 0]]))
    assert closed_but_for(None, tissue, Volume(tissue, SKEWED))[0].shape == (5, 6, 8)
