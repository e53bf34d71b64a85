"""From an image to the points of a ventricle: made ones with known walls, and real ones."""

from dataclasses import replace

import nibabel
import numpy as np
import pytest
from scipy import ndimage

from quadriform.errors import MaskError, OptionError, WarningKind
from quadriform.imaging.file_points import ReadOptions
from quadriform.imaging.reading import read_volume
from quadriform.imaging.segmentation import Labels
from quadriform.imaging.segments import Segment
from quadriform.imaging.ventricle import ventricle_from_labels, ventricle_from_perfusion
from quadriform.imaging.ventricle_files import PerfusionHeart, labelled_heart, read_ventricle
from quadriform.imaging.volume import Volume
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.superquadric import Superquadric

BLOOD, MUSCLE = Labels((1,)), Labels((2,))
SPACING = np.array([1.5, 1.5, 2.0])


def grid(shape=(40, 40, 40), spacing=SPACING):
    affine = np.diag([*spacing, 1.0])
    affine[:3, 3] = -spacing * (np.array(shape) - 1) / 2
    at = np.moveaxis(np.indices(shape), 0, -1) * spacing + affine[:3, 3]
    return at, affine


def inside(at, semi_axes):
    return ((at / semi_axes) ** 2).sum(axis=-1) < 1


def labelled(open_at=np.inf, **how):
    """Cavity 1 with semi-axes 14, 13, 22 in a wall 2 of 8 mm."""
    at, affine = grid(**how)
    values = np.where(inside(at, (14.2, 13.1, 22.3)), 1, np.where(inside(at, (22.2, 21.1, 30.3)), 2, 0))
    return Volume(np.where(at[..., 2] < open_at, values, 0).astype(np.uint8), affine)


def from_labels(volume, **options):
    return ventricle_from_labels(volume, cavity=BLOOD, wall=MUSCLE, **options)


def implicit(points, semi_axes):
    return np.linalg.norm(points / semi_axes, axis=1) - 1


def in_order(points):
    return points[np.lexsort(np.round(points, 6).T)]


def test_labels_give_both_walls():
    found = from_labels(labelled())
    assert found.base is None and not found.warnings
    assert found.record["left_out_voxels"] == 0
    assert np.abs(implicit(found.unthinned["endo"], (14.2, 13.1, 22.3))).max() * 14 < 1.5
    assert np.abs(implicit(found.unthinned["epi"], (22.2, 21.1, 30.3))).max() * 22 < 1.5
    assert len(found.clouds["endo"]) < len(found.unthinned["endo"])


def test_a_rotated_and_flipped_grid_gives_the_same_points():
    volume = labelled()
    moved = volume.values.transpose(2, 0, 1)[::-1, :, ::-1]
    into = np.zeros((4, 4))
    into[2, 0], into[0, 1], into[1, 2], into[3, 3] = -1, 1, -1, 1
    into[2, 3], into[1, 3] = volume.values.shape[2] - 1, volume.values.shape[1] - 1
    turned = Volume(moved, volume.world_from_voxel @ into)
    one, two = (from_labels(v).clouds for v in (volume, turned))
    for name in one:
        assert np.allclose(in_order(one[name]), in_order(two[name]), atol=1e-6)


def test_a_base_at_the_first_slice_is_that_at_the_last_slice_of_the_flipped_image():
    whole = labelled()
    last = replace(whole, values=whole.values[:, :, :27])
    flip = np.diag([1.0, 1, -1, 1])
    flip[2, 3] = 26
    first = replace(last, values=last.values[:, :, ::-1], world_from_voxel=last.world_from_voxel @ flip)
    one, two = from_labels(first), from_labels(last)
    assert one.base[1] == pytest.approx([0, 0, 1]) and one.base[0][2] == pytest.approx(
        whole.points_world([[0, 0, 26.5]])[0, 2]
    )
    np.testing.assert_allclose(one.base, two.base, atol=1e-9)
    for name in one.clouds:
        assert np.allclose(in_order(one.clouds[name]), in_order(two.clouds[name]), atol=1e-6)


def test_another_spacing_gives_the_same_surface_to_half_a_voxel():
    fine = labelled(shape=(60, 60, 80), spacing=np.array([1.0, 1.0, 1.0]))
    coarse = labelled(shape=(60, 60, 20), spacing=np.array([1.0, 1.0, 4.0]))
    from scipy.spatial import cKDTree

    one, two = (from_labels(v).unthinned for v in (fine, coarse))
    for name in one:
        assert cKDTree(one[name]).query(two[name])[0].max() < 2.1


def test_what_the_region_cuts_is_open_and_is_the_base():
    volume = labelled()
    found = from_labels(volume, region=((0, 40), (0, 40), (0, 24)))
    point, direction = found.base
    assert np.allclose(direction, (0, 0, 1))
    assert point[2] == pytest.approx(volume.points_world([[0, 0, 23.5]])[0, 2])
    for points in found.unthinned.values():
        # the outermost slice reaches from its centre to the face
        heights = np.unique(np.round(points[:, 2] - point[2], 6))
        assert heights[-2:] == pytest.approx([-1.0, -0.02])
        at_face, outermost = (points[np.isclose(points[:, 2] - point[2], height)] for height in heights[:-3:-1])
        assert np.array_equal(at_face[:, :2], outermost[:, :2])
    # points just below the face stand on edges of their slice, not on the edge to a slice beyond it
    beside = found.clouds["endo"][:, 2] > point[2] - 0.1
    assert beside.any() and np.allclose(found.noise["endo"][beside][:, 2, 2], 0)
    assert "last k" in found.warnings[WarningKind.BORDER_CUT]


@pytest.mark.parametrize("spacing", [(0.7, 0.7, 3.3), (1.4, 1.4, 8.0)])
def test_the_points_at_the_base_do_not_depend_on_rounding(spacing, rng):
    """Old fault: of some affines the points a whole voxel below the face were repeated below it too, by rounding."""
    volume, region = labelled(open_at=12.0), ((0, 40), (0, 40), (0, 24))
    clouds = []
    for _ in range(8):
        affine = np.eye(4)
        affine[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag(spacing)
        affine[:3, 3] = rng.normal(0, 100, 3)
        moved = replace(volume, world_from_voxel=affine)
        clouds.append({name: moved.voxels(each) for name, each in from_labels(moved, region=region).unthinned.items()})
    for cloud in clouds[1:]:
        for name, points in clouds[0].items():
            assert len(cloud[name]) == len(points)
            assert np.allclose(in_order(cloud[name]), in_order(points), atol=1e-6)


def test_what_lies_beyond_a_given_plane_is_left_out():
    volume = labelled()
    found = from_labels(volume, base=(np.array([0, 0, 15.0]), np.array([0, 0, 3.0])))
    assert max(points[:, 2].max() for points in found.clouds.values()) <= 15
    assert found.record["beyond_base"]["endo"] > 0
    for height, message in ((-50.0, "try the reverse"), (2.0, "through the middle of the data")):
        with pytest.raises(OptionError, match=message):
            from_labels(volume, base=(np.array([0, 0, height]), np.array([0, 0, 3.0])))
    with pytest.raises(OptionError, match="not 0"):
        from_labels(volume, base=(np.zeros(3), np.zeros(3)))


def test_a_cavity_without_wall_is_named_and_has_no_epicardium():
    """The wall is missing on an oblique side, which is no end of a stack of slices."""
    volume = labelled()
    at, _ = grid()
    removed = (volume.values == 2) & (at @ [0.6, 0, 0.8] > 12)
    found = from_labels(replace(volume, values=np.where(removed, 0, volume.values)))
    assert WarningKind.OPEN_WALL in found.warnings and found.base is None
    lid = found.unthinned["epi"]
    assert not (lid @ [0.6, 0, 0.8] > 14).any()


@pytest.mark.parametrize("wall", [None, MUSCLE])
@pytest.mark.parametrize("flip", [1, -1])
def test_a_stack_that_ends_inside_the_image_is_one_that_the_image_cuts(wall, flip):
    """Empty slices beyond the base say nothing: points and base are those without them."""
    thick = {"shape": (40, 40, 16), "spacing": np.array([1.5, 1.5, 5.0])}
    volume = labelled(open_at=12.0, **thick)
    if flip < 0:  # the base is at the first slice then
        turned = volume.world_from_voxel.copy()
        turned[:, 3] += 15 * turned[:, 2]
        turned[:, 2] *= -1
        volume = replace(volume, values=volume.values[:, :, ::-1], world_from_voxel=turned)
    used = np.flatnonzero((volume.values == 1).any(axis=(0, 1)))
    side = (0, int(used[-1]) + 1) if flip > 0 else (int(used[0]), 16)
    cut = volume.crop(((0, 40), (0, 40), side))
    one, other = (ventricle_from_labels(each, cavity=BLOOD, wall=wall) for each in (volume, cut))
    np.testing.assert_allclose(one.base, other.base, atol=1e-9)
    assert one.base[1][2] == pytest.approx(1) and one.base_from == other.base_from != ""
    for name, points in other.clouds.items():
        np.testing.assert_allclose(one.clouds[name], points, atol=1e-9)
    assert WarningKind.BORDER_CUT in other.warnings and WarningKind.BORDER_CUT not in one.warnings


def test_a_rounded_end_is_no_base(rng):
    """However many slices an ellipsoid has, and wherever they lie; and a wall over the end closes it."""
    for slices in range(9, 40, 3):
        at, affine = grid((40, 40, slices + 4), np.array([1.5, 1.5, 48 / slices]))
        shifted = at + np.array([0, 0, rng.uniform(-0.5, 0.5) * 48 / slices])
        values = inside(shifted, (14.2, 13.1, 24.0)).astype(np.uint8)
        assert ventricle_from_labels(Volume(values, affine), cavity=BLOOD).base is None
    volume = labelled(open_at=12.0, shape=(40, 40, 16), spacing=np.array([1.5, 1.5, 5.0]))
    last = int(np.flatnonzero((volume.values == 1).any(axis=(0, 1)))[-1])
    values = volume.values.copy()
    values[:, :, last + 1] = np.where(values[:, :, last] > 0, 2, 0)
    assert from_labels(replace(volume, values=values)).base is None


def test_other_cuts_than_the_base_are_closed_at_the_face_of_the_image():
    """As where the labels end inside the image: a layer of empty voxels there changes nothing."""
    volume = labelled(open_at=8.0, shape=(40, 40, 16), spacing=np.array([1.5, 1.5, 5.0]))
    apex, base = 5, int(np.flatnonzero((volume.values == 1).any(axis=(0, 1)))[-1]) + 1
    values = volume.values.copy()
    values[:, :, :apex] = 0
    empty = replace(volume, values=values)
    for given in (None, (np.array([0, 0, 7.0]), np.array([0, 0, 1.0]))):
        cut = from_labels(volume.crop(((0, 40), (0, 40), (apex, base))), base=given)
        beside = from_labels(empty, base=given)
        face = volume.points_world([[0, 0, apex - 0.5]])[0, 2]
        for name, points in beside.clouds.items():
            np.testing.assert_allclose(cut.clouds[name], points, atol=1e-9)
            assert (np.isclose(points[:, 2], face)).any() and points[:, 2].min() > face - 1e-9
        assert "closed elsewhere" in cut.warnings[WarningKind.BORDER_CUT]


def test_of_two_flat_ends_the_wider_one_is_the_base():
    volume = labelled(open_at=8.0, shape=(40, 40, 16), spacing=np.array([1.5, 1.5, 5.0]))
    at, _ = grid((40, 40, 16), np.array([1.5, 1.5, 5.0]))
    both = replace(volume, values=np.where(at[..., 2] > -15, volume.values, 0).astype(np.uint8))
    assert from_labels(both).base[1][2] == pytest.approx(1)


def test_a_heart_by_a_preset_or_by_segments_is_that_of_its_labels():
    volume = replace(labelled(), segments=(Segment("LV", 1, (1,)), Segment("LV wall", 2, (2,))))
    expected = from_labels(volume).clouds
    for texts in (
        ("endo=preset:ukbb", "epi=preset:ukbb"),
        ("endo=label:1", "epi=label:1+2"),
        ("endo=label:LV", "epi=label:LV wall"),
    ):
        found = labelled_heart(texts).points(volume, ReadOptions(), None).clouds
        assert found.keys() == expected.keys()
        assert all(np.array_equal(found[name], expected[name]) for name in expected)


def test_points_of_a_label_file_have_the_noise_of_their_voxels_and_those_of_a_grey_one_none(tmp_path):
    for volume, heart in ((labelled(), labelled_heart(["endo=label:1"])), (horseshoe(), PerfusionHeart())):
        file = tmp_path / "image.nii"
        nibabel.save(nibabel.Nifti1Image(volume.values, volume.world_from_voxel), file)
        found = heart.points(read_volume(file), ReadOptions(), None)
        sources = read_ventricle(file, heart, ReadOptions(), None).surfaces
        for name, points in found.clouds.items():
            assert np.array_equal(sources[name].cloud.points, points)
            noise = sources[name].cloud.noise
            assert noise is None if found.noise is None else np.array_equal(noise, found.noise[name])
        assert (found.noise is None) == isinstance(heart, PerfusionHeart)


def test_the_cavity_of_a_label_file_goes_with_its_points(tmp_path):
    """In its own place: its surface has its volume below the base, and one moved by 6 mm overlaps less."""
    image = labelled(open_at=10.0)
    nibabel.save(nibabel.Nifti1Image(image.values, image.world_from_voxel), tmp_path / "heart.nii.gz")
    heart = labelled_heart(["endo=label:1", "epi=label:1+2"])
    found = read_ventricle(tmp_path / "heart.nii.gz", heart, ReadOptions(), None)
    solid, base = found.surfaces["endo"].cloud.solid, found.landmarks.base
    assert found.surfaces["epi"].cloud.solid is None
    shape = Superquadric("ellipsoid", (14.2, 13.1, 22.3), (1, 1)).mesh(48)
    beside = Mesh(shape.vertices + np.array([6.0, 0, 0]), shape.faces)
    own, moved = solid.overlap(shape, base), solid.overlap(beside, base)
    assert own.dice > 0.97 and abs(own.larger) < 0.03 and moved.dice < 0.85
    assert solid.overlap(shape, None).larger > 0.15  # beyond the base there are no labels


def test_voxels_apart_from_the_cavity_are_counted():
    volume = labelled()
    values = volume.values.copy()
    values[1:3, 1:4, 1] = 1
    assert from_labels(replace(volume, values=values)).record["left_out_voxels"] == 6


def test_swapped_shared_and_missing_labels_are_refused():
    volume = labelled()
    with pytest.raises(MaskError, match="swapped"):
        ventricle_from_labels(volume, cavity=MUSCLE, wall=BLOOD)
    with pytest.raises(OptionError, match="share"):
        ventricle_from_labels(volume, cavity=BLOOD, wall=Labels((1, 2)))
    with pytest.raises(MaskError, match="no voxel has the label 7"):
        ventricle_from_labels(volume, cavity=Labels((7,)), wall=MUSCLE)


def horseshoe():
    at, affine = grid(spacing=np.array([2.0, 2.0, 2.0]))
    wall = inside(at, (22.2, 21.1, 34.3)) & ~inside(at, (14.2, 13.1, 26.3)) & (at[..., 2] < 8)
    return Volume(100.0 * wall, affine)


def test_a_horseshoe_gives_two_surfaces_and_its_base():
    found = ventricle_from_perfusion(horseshoe())
    assert WarningKind.OPEN_BASE in found.warnings
    assert found.base[1] @ [0, 0, 1] > 0.999
    assert -3 < found.base[0][2] < 8  # below the mouth by half a wall of 8 to 11
    assert np.abs(implicit(found.unthinned["endo"], (14.2, 13.1, 26.3))).max() * 14 < 1.8
    assert np.abs(implicit(found.unthinned["epi"], (22.2, 21.1, 34.3))).max() * 22 < 1.8


def test_a_solid_body_has_no_cavity():
    at, affine = grid()
    with pytest.raises(MaskError, match="cavity"):
        ventricle_from_perfusion(Volume(1.0 * inside(at, (14, 13, 22)), affine))


def test_walls_that_enclose_nothing_or_everything_are_refused():
    at, affine = grid()
    with pytest.raises(MaskError, match="is convex: it has no cavity"):
        ventricle_from_perfusion(Volume(1.0 * (np.abs(at) < 12).all(axis=-1), affine))
    shell = inside(at, (22, 21, 30)) & ~inside(at, (14, 13, 22))
    with pytest.raises(MaskError, match="closed all around"):
        ventricle_from_perfusion(Volume(1.0 * shell, affine))


def test_a_hole_within_the_wall_is_wall():
    volume = horseshoe()
    values = volume.values.copy()
    depth = ndimage.distance_transform_edt(values)
    values[np.unravel_index(depth.argmax(), depth.shape)] = 0
    pricked = ventricle_from_perfusion(Volume(values, volume.world_from_voxel))
    plain = ventricle_from_perfusion(volume)
    for name in plain.clouds:
        assert np.array_equal(in_order(plain.clouds[name]), in_order(pricked.clouds[name]))


def test_real_perfusion_images_give_both_walls(shared):
    for path in sorted((shared / "data" / "spect_mpi" / "nifti").glob("*.nii.gz")):
        found = ventricle_from_perfusion(read_volume(path), region=((17, 53), (12, 52), (10, 34)))
        assert all(len(points) > 200 for points in found.unthinned.values())
        assert 0.15 < found.record["cavity_voxels"] / found.record["wall_voxels"] < 0.6


def test_a_small_cavity_in_thick_slices_keeps_twice_as_many_points_as_a_box_has_unknowns():
    volume = labelled(shape=(60, 60, 10), spacing=np.array([1.0, 1.0, 8.0]))
    found = ventricle_from_labels(volume, cavity=BLOOD)
    by_voxel = ventricle_from_labels(volume, cavity=BLOOD, spacing=8.0)
    assert len(by_voxel.clouds["endo"]) < 750 <= len(found.clouds["endo"])
    twice = ventricle_from_labels(volume, cavity=BLOOD, spacing=2 * found.record["spacing"])
    assert len(twice.clouds["endo"]) < 750 and found.record["spacing"] in (1.0, 2.0, 4.0)
    with pytest.warns(DeprecationWarning, match="apart is named spacing"):
        old = ventricle_from_labels(volume, cavity=BLOOD, apart=8.0)
    assert np.array_equal(old.clouds["endo"], by_voxel.clouds["endo"])
