import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from quadriform.errors import MaskError, OptionError
from quadriform.imaging.image_points import outer_side, points_from_image
from quadriform.imaging.reading import example_volume, read_volume
from quadriform.imaging.segmentation import Labels, Percentile
from quadriform.imaging.volume import Volume

SPECT_REGION = ((17, 53), (12, 52), (10, 34))


@pytest.fixture
def blob(rng, oblique):
    """A bumpy object without any symmetry, grey, and a smaller one beside it."""
    at = np.moveaxis(np.indices((26, 24, 22)), 0, -1) - [11.3, 12.1, 9.8]
    bumps = sum(np.cos(at @ wave) for wave in rng.normal(0, 0.5, (4, 3)))
    values = 8 - np.linalg.norm(at / [1, 1, 0.8], axis=-1) + bumps
    values[22:25, 1:5, 17:21] = 6
    return Volume(values, oblique)


def moved(volume, how):
    """The same image on another grid: the array and its affine changed together."""
    values, affine = volume.values, volume.world_from_voxel.copy()
    if how == "shift":
        values = np.pad(values, ((3, 0), (1, 2), (5, 1)), constant_values=values.min())
        affine[:3, 3] -= affine[:3, :3] @ [3, 1, 5]
    elif how == "flip":
        values = values[::-1, :, ::-1]
        affine[:3, 3] += affine[:3, :3] @ [values.shape[0] - 1, 0, values.shape[2] - 1]
        affine[:3, [0, 2]] *= -1
    elif how == "mirror":
        values = values[:, ::-1]
        affine[:3, 3] += affine[:3, 1] * (values.shape[1] - 1)
        affine[:3, 1] *= -1
    else:
        values = values.transpose(2, 0, 1)
        affine = affine[:, [2, 0, 1, 3]]
    return Volume(values, affine)


def apart(a, b):
    """Largest distance of a point of one set to the other set."""
    return max(cKDTree(a).query(b)[0].max(), cKDTree(b).query(a)[0].max())


@pytest.mark.parametrize("how", ["shift", "flip", "mirror", "transpose"])
@pytest.mark.parametrize("surface", ["mask", "grey"])
def test_the_grid_does_not_matter_only_the_world_does(blob, how, surface):
    options = {"select": 2.0, "closing": 1, "surface": surface}
    here, there = points_from_image(blob, **options), points_from_image(moved(blob, how), **options)
    assert len(here.points) == len(there.points) > 500
    assert apart(here.points, there.points) < 1e-9
    assert here.mesh.volume() == pytest.approx(there.mesh.volume(), rel=2e-3)  # diagonals of squares may differ
    assert here.mesh.volume() > 0


def test_long_voxels_give_the_same_ball_in_the_world(ball):
    """0.5 x 0.5 x 5 mm (row 47)."""
    height, centre = ball(20.0, np.diag([0.5, 0.5, 5.0, 1.0]), (90, 90, 12))
    found = points_from_image(height, select=0.0)
    assert np.abs(np.linalg.norm(found.points - centre, axis=1) - 20.0).max() <= 2.5
    assert "ANISOTROPIC" in found.warnings


def test_the_grey_surface_is_that_of_the_object_only(blob):
    grey = points_from_image(blob, select=2.0, surface="grey")
    mask = points_from_image(blob, select=2.0)
    assert mask.record["components_found"] == 2
    assert apart(grey.points, mask.points) <= blob.spacing.max() / 2 + 1e-6
    assert grey.record["isolevel"] == 2.0
    # halfway between voxels the error is that of an edge; between grey values it is not known
    assert grey.noise is None and mask.noise.shape == (len(mask.points), 3, 3)


def test_the_grey_surface_is_closer_than_the_mask(ball):
    height, centre = ball(14.0)
    rms = {
        surface: np.sqrt(np.mean((np.linalg.norm(found.points - centre, axis=1) - 14.0) ** 2))
        for surface in ("mask", "grey")
        for found in [points_from_image(height, select=0.0, surface=surface)]
    }
    assert rms["grey"] < 0.1 * rms["mask"]


def test_points_are_the_vertices_and_the_record_is_plain(blob):
    found = points_from_image(
        blob, select=Percentile(0.5, 99), region=((1, 25), (0, 24), (0, 14)), component=(11, 12, 9), border="close"
    )
    assert_array_equal(found.points, found.mesh.vertices)
    assert found.on_border.any() and not found.on_border.all()
    record = json.loads(json.dumps(found.record))
    assert record == found.record
    assert record["select"] == {"percentile": 99, "fraction": 0.5}
    assert record["region"] == [[1, 25], [0, 24], [0, 14]]
    assert record["component"] == [11, 12, 9]
    assert record["threshold"] == found.segmentation.threshold
    assert record["voxels"] == found.segmentation.mask.sum()


def test_the_same_image_gives_the_same_bytes(blob):
    once, twice = points_from_image(blob, closing=1), points_from_image(blob, closing=1)
    assert once.points.tobytes() == twice.points.tobytes()


def test_labels_have_no_grey_surface(blob):
    with pytest.raises(OptionError, match="surface='grey'"):
        points_from_image(blob, select=Labels((1,)), surface="grey")


@pytest.mark.parametrize("option", [{"surface": "skin"}, {"border": "shut"}])
def test_unknown_options_are_refused(blob, option):
    with pytest.raises(OptionError, match=next(iter(option))):
        points_from_image(blob, **option)


def test_warnings_of_the_reader_are_carried(blob):
    volume = Volume(blob.values, blob.world_from_voxel, warnings={"AFFINE_REPAIRED": "two forms"})
    assert points_from_image(volume).warnings["AFFINE_REPAIRED"] == "two forms"


class TestExample:
    """The brain of the demo; the slab cuts it above and below."""

    def test_about_17_700_points(self):
        found = points_from_image(example_volume(), closing=2, border="close")
        assert len(found.points) == pytest.approx(17_700, rel=0.03)
        assert "first k" in found.warnings["BORDER_CUT"] and "last k" in found.warnings["BORDER_CUT"]
        assert 0.3 < found.on_border.mean() < 0.5

    def test_by_sides_alone_it_is_what_the_design_saw(self):
        found = points_from_image(example_volume(), closing=2, border="close", connectivity=6)
        assert len(found.points) == 17_690

    def test_a_head_of_credible_size(self):
        found = points_from_image(example_volume(), closing=2, border="close")
        voxel = np.prod(example_volume().spacing)
        assert found.mesh.volume() == pytest.approx(found.segmentation.mask.sum() * voxel, rel=0.01)
        assert 0.5e6 < found.mesh.volume() < 1.5e6  # mm^3


class TestRealImages:
    @pytest.mark.parametrize("n", [1, 2, 3])
    def test_spect(self, shared, n):
        volume = read_volume(shared / "data" / "spect_mpi" / "nifti" / f"mpi_rest_{n}.nii.gz")
        found = points_from_image(volume, select=Percentile(0.5, 99.9), region=SPECT_REGION, border="close")
        millilitres = found.segmentation.mask.sum() * 4.0**3 / 1000
        assert 167 < millilitres < 228  # the README of the data
        assert found.mesh.volume() / 1000 == pytest.approx(millilitres, rel=0.02)
        assert 1_500 < len(found.points) < 3_000

    @pytest.mark.parametrize("frame, millilitres", [(11, 56), (19, 78)])
    def test_pig_cavity(self, shared, frame, millilitres):
        path = shared / "data" / "pig_cine_mri" / "sax_lv_labels_crop_4d.nii.gz"
        volume = read_volume(path, frame=frame)
        region = ((0, 154), (0, 149), (1, 14))  # slices 1-13 are ventricle
        found = points_from_image(volume, select=Labels((1,)), region=region, border="close", component="all")
        voxel = abs(np.linalg.det(volume.world_from_voxel))
        assert found.segmentation.mask.sum() * voxel / 1000 == pytest.approx(millilitres, abs=0.5)
        assert found.mesh.volume() / 1000 == pytest.approx(millilitres, rel=0.03)

    def test_the_wall_of_the_pig_encloses_its_cavity(self, shared):
        volume = read_volume(shared / "data" / "pig_cine_mri" / "sax_lv_labels_crop_4d.nii.gz", frame=0)
        cavity, both = (points_from_image(volume, select=Labels(labels)).segmentation for labels in ((1,), (1, 2)))
        assert both.mask.sum() > cavity.mask.sum()
        assert both.mask[cavity.mask].all()

    def test_sunnybrook_ejection_fraction(self, shared):
        volumes = []
        for phase in ("ED", "ES"):
            volume = read_volume(shared / "data" / "sunnybrook" / f"SC-N-02_{phase}_endo.nii.gz")
            found = points_from_image(volume, select=Labels((1,)), border="close")
            assert {"ANISOTROPIC", "BORDER_CUT"} <= set(found.warnings)
            volumes.append(found.mesh.volume())
        assert 1 - volumes[1] / volumes[0] == pytest.approx(0.60, abs=0.01)

    def test_a_frame_must_be_named(self, shared):
        with pytest.raises(MaskError, match=r"\(154, 149, 20, 20\)"):
            read_volume(shared / "data" / "pig_cine_mri" / "sax_lv_labels_crop_4d.nii.gz")


def test_points_read_from_a_file_are_lps(save_nifti, ball):
    """The centre of the points is the centre of the object with x and y of NIfTI's RAS negated."""
    height, centre = ball(12.0)
    path = save_nifti((height.values > 0).astype(np.uint8), height.world_from_voxel)
    found = points_from_image(read_volume(path))
    assert_allclose(found.points.mean(axis=0), centre * [-1, -1, 1], atol=0.3)
    assert (found.record["space"], found.record["unit"]) == ("LPS", "mm")


def wall(thickness, cut=None):
    """A spherical wall of radius 14, or what is left of it below the slice `cut`."""
    at = np.stack(np.indices((36, 36, 36)), axis=-1) - 17.5
    radius = np.linalg.norm(at, axis=-1)
    mask = (radius < 14) & (radius >= 14 - thickness)
    if cut is not None:
        mask[:, :, cut:] = False
    return Volume(mask.astype(np.uint8), np.diag([1.0, 1.5, 2.0, 1.0]))


@pytest.mark.parametrize("thickness", [2, 4, 7])
def test_a_wall_around_a_hollow_is_refused(thickness):
    """Its surface is two; between them lies what a fit would find."""
    with pytest.raises(MaskError, match=r"wall around \d+ voxels.*--fill-holes"):
        points_from_image(wall(thickness))
    whole, solid = points_from_image(wall(thickness), fill_holes=True), points_from_image(wall(14))
    assert np.array_equal(whole.points, solid.points) and "HOLLOW" not in whole.warnings


@pytest.mark.parametrize("thickness", [2, 4, 7])
def test_a_cup_is_named(thickness):
    assert "faces the middle" in points_from_image(wall(thickness, cut=24)).warnings["HOLLOW"]
    assert "HOLLOW" not in points_from_image(wall(14, cut=24)).warnings


@pytest.mark.parametrize("thickness", [2, 4, 7])
@pytest.mark.parametrize("size", [36, 24])
def test_of_a_cup_the_outer_side_is_taken(thickness, size):
    """Old fault: one surface between both sides, or folded along them. The opening may lie at the end of the image."""
    region = ((0, 36), (0, 36), (0, size))
    cup, whole = (points_from_image(wall(each, cut=24), region=region) for each in (thickness, 14))
    found = outer_side(cup)
    shared = found.segmentation.mask & whole.segmentation.mask
    assert 2 * shared.sum() > 0.98 * (found.segmentation.mask.sum() + whole.segmentation.mask.sum())
    assert "its outer side was taken" in found.warnings["HOLLOW"]
    assert len(found.noise) == len(found.points) and found.record["voxels"] == found.segmentation.mask.sum()


def test_a_ring_has_no_outer_side():
    """Open at both ends: a toroid is the surface of it."""
    ring = wall(4, cut=24).values.copy()
    ring[:, :, :12] = 0
    found = points_from_image(Volume(ring, np.eye(4)))
    assert "HOLLOW" in found.warnings and outer_side(found) is found


def test_the_outer_side_of_a_bright_cup_is_where_the_image_crosses_the_threshold():
    at = np.stack(np.indices((40, 40, 40)), axis=-1) - 19.5
    radius = np.linalg.norm(at, axis=-1)
    grey = 100 * np.exp(-(((radius - 12) / 3) ** 2)) * (at[..., 2] < 6)
    found = outer_side(points_from_image(Volume(grey, np.eye(4)), select=50.0))
    below = found.points[found.points[:, 2] < 19.5]
    assert_allclose(np.linalg.norm(below - 19.5, axis=1), 12 + 3 * np.sqrt(np.log(2)), atol=0.1)


def test_a_small_hole_is_no_hollow_object():
    values = wall(14).values.copy()
    values[15:18, 15:18, 15:18] = 0
    assert points_from_image(Volume(values, np.eye(4))).warnings == {}


@pytest.mark.parametrize("name", ["shell", "cup"])
def test_the_hollow_bodies_of_the_cases(shared, name):
    file = shared / "cases" / "hollow" / f"{name}.nii.gz"
    if not file.is_file():
        pytest.skip("this file is not beside the repository")
    if name == "cup":
        assert "HOLLOW" in points_from_image(read_volume(file)).warnings
    else:
        with pytest.raises(MaskError, match="--fill-holes"):
            points_from_image(read_volume(file))


def test_labels_that_the_image_cuts_are_closed_there_and_grey_objects_are_not(blob):
    """Closed by default: the mesh holds the volume of the voxels. A threshold says nothing of what is beyond."""
    cut = blob.crop(((0, 12), (0, 24), (0, 22)))
    mask = Volume((cut.values > 2).astype(np.uint8), cut.world_from_voxel)
    counted = (points_from_image(mask, select=Labels((1,))).segmentation.mask).sum() * abs(
        np.linalg.det(mask.world_from_voxel[:3, :3])
    )
    for select in ("auto", Labels((1,))):
        found = points_from_image(mask, select=select)
        assert found.on_border.any() and found.record["border"] == "close"
        assert found.mesh.volume() == pytest.approx(counted, rel=0.03)  # corners are cut off
        assert not points_from_image(mask, select=select, border="open").on_border.any()
    assert not points_from_image(cut, select=2.0).on_border.any()
