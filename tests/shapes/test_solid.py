"""The overlap of a surface with a body whose inside is known, beside volumes that have formulas."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapes_made import made

from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.solid import Overlap, Solid
from quadriform.shapes.superquadric import Superquadric

SIZE, SPACING = 60, np.array([1.0, 0.8, 1.5])
MIDDLE = SPACING * SIZE / 2


def ball(radius: float, centre=(0, 0, 0)) -> Mesh:
    found = made(semi_axes=(radius,) * 3, exponents=(1, 1)).mesh(48)
    return Mesh(found.vertices - found.vertices.mean(axis=0) + MIDDLE + centre, found.faces)


def filled_ball(radius: float, is_whole: bool = True) -> Solid:
    """Voxels whose centre is in a ball around the middle."""
    centres = np.moveaxis(np.indices((SIZE,) * 3), 0, -1) * SPACING
    filled = ((centres - MIDDLE) ** 2).sum(axis=-1) < radius**2
    return Solid(filled, np.diag([*SPACING, 1.0]), is_whole)


@pytest.mark.parametrize("radius", [6.0, 12.0, 18.0])
def test_concentric_balls(radius):
    least, most = sorted([radius, 12.0])
    expected = 2 * least**3 / (least**3 + most**3)
    assert filled_ball(12.0).overlap(ball(radius), None).dice == pytest.approx(expected, abs=0.01)


def test_counts_of_single_voxels():
    one, three, none = np.array([[1, 0, 0, 0], [1, 1, 1, 0], [0, 0, 0, 0]], dtype=bool)
    assert Overlap.of(one, three) == Overlap(1 / 2, 2.0, 2 * 2**0.5)
    assert Overlap.of(three, one) == Overlap(1 / 2, -2 / 3, 2 * 2**0.5 / 3)
    assert Overlap.of(none, one) == Overlap(0.0, 1.0, 2.0)
    assert Overlap.of(none, none) == Overlap(0.0, 0.0, 0.0)


@pytest.mark.parametrize("radius", [11.0, 12.0, 12.5])
def test_volumes_are_compared(radius):
    found = filled_ball(12.0).overlap(ball(radius), None)
    assert found.larger == pytest.approx((radius / 12) ** 3 - 1, abs=0.02)
    assert found.uncertain < 0.03


def test_of_few_voxels_a_difference_may_be_chance():
    """Balls of a few voxels, in 20 places of the grid: their counts scatter by about what is put down to chance."""
    rng = np.random.default_rng(1)
    centres = np.moveaxis(np.indices((12,) * 3), 0, -1).reshape(-1, 3)
    size = 4 / 3 * np.pi * 3**3
    for middle in rng.uniform(5, 7, (20, 3)):
        filled = (((centres - middle) ** 2).sum(axis=1) < 9).reshape(12, 12, 12)
        shape = ball(3.0, middle - MIDDLE)
        shape = Mesh(shape.vertices + rng.normal(0, 0.3, 3), shape.faces)
        found = Solid(filled, np.eye(4)).overlap(shape, None)
        assert abs(found.larger) <= found.uncertain + 0.05 and found.uncertain < 0.15
        assert abs(filled.sum() / size - 1) < 0.2


def test_balls_side_by_side():
    """Two equal balls at a distance of their radius have 5 / 16 of a ball in common."""
    assert filled_ball(12.0).overlap(ball(12.0, (12.0, 0, 0)), None).dice == pytest.approx(5 / 16, abs=0.01)
    assert filled_ball(12.0).overlap(ball(12.0, (30.0, 0, 0)), None).dice == 0


def test_what_reaches_beyond_the_voxels_counts_as_outside_only_where_the_body_is_whole():
    whole, cut = (Solid(np.ones((40, 40, 20), dtype=bool), np.eye(4), is_whole) for is_whole in (True, False))
    cube = Superquadric(semi_axes=(20, 20, 20), exponents=(0.1, 0.1), translation=(19.5,) * 3).mesh(48)
    assert whole.overlap(cube, None).dice == pytest.approx(2 / 3, abs=0.02)
    assert cut.overlap(cube, None).dice == pytest.approx(1.0, abs=0.02)


def test_beyond_a_base_nothing_counts():
    """A ball, and one whose upper half is missing: the same below its middle."""
    whole = filled_ball(12.0)
    below = np.arange(SIZE) * SPACING[2] <= MIDDLE[2]
    half = Solid(whole.filled & below, whole.world_from_voxel)
    base = BasePlane(MIDDLE, np.array([0.0, 0.0, 1.0]))
    assert half.overlap(ball(12.0), base).dice == pytest.approx(1.0, abs=0.01)
    assert half.overlap(ball(12.0), None).dice == pytest.approx(2 / 3, abs=0.05)


@pytest.mark.parametrize(("height", "dice", "larger"), [(0.5, 1.0, 0.0), (1.0, 2 / 3, 1.0), (2.5, 2 / 3, 1.0)])
def test_voxels_count_whose_centre_is_below_a_base_or_on_it(height, dice, larger):
    """A layer of voxels at the height 0, and a box around three such layers; one layer beyond the body is asked."""
    layer = Solid(np.ones((4, 4, 1), dtype=bool), np.eye(4))
    block = Superquadric(semi_axes=(2.1, 2.1, 1.4), exponents=(0.1, 0.1), translation=(1.5, 1.5, 1)).mesh(32)
    found = layer.overlap(block, BasePlane(np.array([7.0, 0.0, height]), np.array([0.0, 0.0, 1.0])))
    assert (found.dice, found.larger) == (pytest.approx(dice), larger)
    assert found.uncertain == pytest.approx(2 * (16 * larger) ** 0.5 / 16)


def test_the_inside_of_a_mesh_in_any_place_and_unit():
    rng = np.random.default_rng(0)
    shape = made(semi_axes=(30.0, 22.0, 18.0), exponents=(0.9, 1.1)).mesh(32)
    for scale in (1e-3, 1.0, 1e3):
        moved = Mesh(scale * (shape.vertices + rng.uniform(-1000, 1000, 3)), shape.faces)
        solid = Solid.of_mesh(moved)
        assert solid.overlap(moved, None).dice > 0.999
        volume = solid.filled.sum() * np.linalg.det(solid.world_from_voxel[:3, :3])
        assert_allclose(volume, moved.volume(), rtol=5e-3)
        again = Mesh(7 * moved.vertices, moved.faces)
        assert solid.scaled(7).overlap(again, None).dice > 0.999
        for affine in (solid.world_from_voxel, solid.scaled(7).world_from_voxel):
            assert affine[3].tolist() == [0, 0, 0, 1]


def test_open_and_flat_meshes_have_no_inside():
    shape = made(semi_axes=(3.0, 2.0, 1.0), exponents=(1, 1)).mesh(8)
    assert Solid.of_mesh(Mesh(shape.vertices, shape.faces[1:])) is None
    assert Solid.of_mesh(Mesh(shape.vertices * [1, 1, 0], shape.faces)) is None
    assert Solid.of_mesh(Mesh(shape.vertices, shape.faces[:0])) is None


def test_of_many_voxels_some_are_counted():
    fine = Solid(np.repeat(np.repeat(filled_ball(12.0).filled, 5, axis=0), 5, axis=1), np.diag([0.2, 0.16, 1.5, 1.0]))
    assert fine.overlap(ball(12.0, (0.4, 0.32, 0)), None).dice == pytest.approx(1, abs=0.03)
