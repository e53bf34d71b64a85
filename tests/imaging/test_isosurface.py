import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from quadriform.errors import MaskError, OptionError
from quadriform.imaging.isosurface import grey_of_object, isosurface
from quadriform.imaging.volume import Volume

MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


def watertight(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).is_watertight


def mask_of(volume):
    return Volume((volume.values > 0).astype(np.uint8), volume.world_from_voxel)


@pytest.mark.parametrize("mirror", [np.eye(4), MIRROR])
def test_a_ball_under_an_oblique_affine_is_found_in_the_world(ball, oblique, mirror):
    height, centre = ball(14.0, mirror @ oblique)
    surface = isosurface(mask_of(height))
    distance = np.linalg.norm(surface.mesh.vertices - centre, axis=1) - 14.0
    assert np.abs(distance).max() <= height.spacing.max() / 2
    assert abs(distance.mean()) < 0.05 * height.spacing.max()
    assert not surface.on_border.any()
    assert surface.warnings == {}
    assert watertight(surface.mesh)


@pytest.mark.parametrize("mirror", [np.eye(4), MIRROR])
def test_a_grey_ball_is_found_within_a_few_hundredths(ball, oblique, mirror):
    height, centre = ball(14.0, mirror @ oblique)
    mesh = isosurface(height, 0.0).mesh
    distance = np.linalg.norm(mesh.vertices - centre, axis=1) - 14.0
    assert np.abs(distance).max() < 0.03 * height.spacing.max()
    assert mesh.volume() == pytest.approx(4 / 3 * np.pi * 14.0**3, rel=0.01)


@pytest.mark.parametrize("mirror", [np.eye(4), MIRROR])
@pytest.mark.parametrize("border", ["open", "close"])
def test_triangles_face_outwards_whatever_the_sign_of_the_affine(ball, oblique, mirror, border):
    height, centre = ball(14.0, mirror @ oblique)
    mesh = isosurface(height, 0.0, border=border).mesh
    assert mesh.volume() > 0
    outward = mesh.vertices[mesh.faces].mean(axis=1) - centre
    assert (np.einsum("ij,ij->i", mesh.area_vectors(), outward) > 0).all()


def test_a_box_has_points_half_a_voxel_outside_its_voxel_centres():
    values = np.zeros((6, 6, 6))
    values[2:4, 2:4, 2:4] = 1
    mesh = isosurface(Volume(values, np.diag([2.0, 2.0, 2.0, 1.0]))).mesh
    expected = {
        tuple(2 * np.insert([b, c], axis, a))
        for axis in range(3)
        for a in (1.5, 3.5)
        for b in (2.0, 3.0)
        for c in (2.0, 3.0)
    }
    assert {tuple(vertex) for vertex in mesh.vertices} == expected


class TestBorder:
    @pytest.fixture
    def half(self, ball, oblique):
        """Half a ball: the last k is cut off."""
        height, centre = ball(14.0, oblique)
        return mask_of(height).crop(((0, 42), (0, 46), (0, 13))), centre

    def test_closed_on_purpose(self, half):
        volume, centre = half
        surface = isosurface(volume, border="close")
        assert watertight(surface.mesh)
        assert surface.on_border.sum() == volume.values[:, :, -1].sum()
        lid = surface.mesh.vertices[surface.on_border]
        k = (np.linalg.inv(volume.world_from_voxel) @ np.c_[lid, np.ones(len(lid))].T)[2]
        assert_allclose(k, 12.5, atol=1e-9)
        off = np.linalg.norm(surface.mesh.vertices[~surface.on_border] - centre, axis=1) - 14.0
        assert np.abs(off).max() <= volume.spacing.max() / 2
        assert f"closed there by {surface.on_border.sum()} vertices" in surface.warnings["BORDER_CUT"]
        voxel = abs(np.linalg.det(volume.world_from_voxel))
        assert surface.mesh.volume() == pytest.approx(volume.values.sum() * voxel, rel=0.02)

    def test_left_open(self, half):
        volume, _ = half
        opened, closed = (isosurface(volume, border=border) for border in ("open", "close"))
        assert not watertight(opened.mesh)
        assert not opened.on_border.any()
        assert "left open" in opened.warnings["BORDER_CUT"]
        kept = closed.mesh.vertices[~closed.on_border]
        assert {tuple(v) for v in np.round(opened.mesh.vertices, 9)} == {tuple(v) for v in np.round(kept, 9)}

    def test_a_grey_lid_is_half_a_voxel_out_as_well(self, ball):
        height, _ = ball(14.0, np.eye(4), (40, 40, 14))
        surface = isosurface(height, 0.0, border="close")
        assert_allclose(np.unique(surface.mesh.vertices[surface.on_border, 2]), [-0.5, 13.5], atol=1e-5)
        assert watertight(surface.mesh)


def test_whole_numbers_equal_to_the_level_leave_no_crack(rng):
    values = rng.integers(0, 5, (12, 12, 12))
    mesh = isosurface(Volume(values, np.eye(4)), 2, border="close").mesh
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all()
    assert (np.linalg.norm(mesh.area_vectors(), axis=1) > 0).all()


def test_a_grey_image_is_mirrored_at_the_level_where_the_mask_disagrees(ball, oblique):
    """A second ball is not part of the mask, and a slot in the first was bridged: the surface is the first ball."""
    height, _ = ball(10.0, oblique)
    mask = mask_of(height)
    other = np.roll(height.values, 15, axis=0)
    grey = Volume(np.maximum(height.values, other) + 100, oblique)
    shown = grey_of_object(mask, grey, 100.0)
    assert_array_equal(shown.values > 100, mask.values > 0)
    away = other < -4  # far from the other ball nothing changed
    assert_allclose(shown.values[away], grey.values[away], rtol=1e-13)


@pytest.mark.parametrize("level, said", [(2.0, "no voxel is"), (-1.0, "all voxels are")])
def test_no_surface(level, said):
    with pytest.raises(MaskError, match=rf"{said} above.*run from 0 to 1"):
        isosurface(Volume(np.eye(4)[None].repeat(4, 0), np.eye(4)), level)


def test_unknown_options_are_refused():
    volume = Volume(np.eye(4)[None].repeat(4, 0), np.eye(4))
    with pytest.raises(OptionError, match="border"):
        isosurface(volume, border="lid")
    with pytest.raises(OptionError, match="level"):
        isosurface(volume, np.nan)
