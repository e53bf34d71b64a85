"""The labels of public data sets, checked against how their surfaces enclose each other."""

import numpy as np
import pytest

from quadriform.errors import InputError, MaskError, OptionError
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.labels import PRESETS, STRUCTURES, parse_surface, read_structures, surface_labels
from quadriform.imaging.reading import read_volume
from quadriform.imaging.segmentation import Labels, segment
from quadriform.imaging.volume import Volume


def heart(cavity, myocardium, rv):
    """A cavity of 4 voxels a side in a wall of one, and a right ventricle beside it."""
    values = np.zeros((16, 10, 10), np.uint8)
    values[2:8, 2:8, 2:8] = myocardium
    values[3:7, 3:7, 3:7] = cavity
    values[9:13, 3:7, 3:7] = rv
    return Volume(values, np.eye(4))


class TestPresets:
    @pytest.mark.parametrize(
        "preset, labels",
        [("acdc", (3, 2, 1)), ("ukbb", (1, 2, 3)), ("mnms", (1, 2, 3)), ("totalsegmentator", (1, 2, 3))],
    )
    def test_the_epicardium_encloses_the_cavity_and_no_right_ventricle(self, preset, labels):
        volume = heart(*labels)
        sizes = {name: int(segment(volume, select=of).mask.sum()) for name, of in PRESETS[preset].items()}
        assert sizes == {"endo": 4**3, "epi": 6**3, "rv": 4**3}

    def test_a_label_that_is_not_there_is_named_with_those_that_are(self):
        with pytest.raises(MaskError, match=r"no voxel has the label 3; .*0: .*1: 64, 2: 152"):
            segment(heart(1, 2, 0), select=PRESETS["ukbb"]["rv"])

    def test_an_empty_image_too(self):
        with pytest.raises(MaskError, match="no voxel has the label 1, 2; values and voxels: 0: 1600"):
            points_from_image(heart(0, 0, 0), select=PRESETS["ukbb"]["epi"])


class TestOwnLabels:
    def test_the_epicardium_has_both(self):
        found = surface_labels(cavity=[7], myocardium=(8, 9))
        assert found == {"endo": Labels((7,)), "epi": Labels((7, 8, 9))}

    @pytest.mark.parametrize("labels", [((1,), (1,)), ((), (1,)), ((1,), ()), ((1,), (2,), (2,)), ((1, 1), (2,))])
    def test_a_label_for_two_parts_or_for_none_is_refused(self, labels):
        with pytest.raises(OptionError, match="each label once"):
            surface_labels(*labels)


class TestParsing:
    @pytest.mark.parametrize(
        "text, name, labels",
        [
            ("endo=label:1", "endo", (1,)),
            ("epi=label:1+2", "epi", (1, 2)),
            ("wall=label: 10 + 20", "wall", (10, 20)),
            ("endo=preset:acdc", "endo", (3,)),
            ("epi=preset:mnms", "epi", (1, 2)),
        ],
    )
    def test_what_the_terminal_says(self, text, name, labels):
        assert parse_surface(text) == (name, Labels(labels))

    @pytest.mark.parametrize(
        "text", ["endo", "endo=1", "endo=label:", "endo=label:1,2", "endo=label:-1", "=label:1", "endo=file:a.nii", ""]
    )
    def test_another_form_is_refused_with_the_right_one(self, text):
        with pytest.raises(OptionError, match=r"name=label:1\+2"):
            parse_surface(text)

    @pytest.mark.parametrize("text, said", [("endo=preset:none", "'acdc'"), ("left=preset:acdc", "'endo'")])
    def test_an_unknown_preset_or_surface_is_refused_with_those_known(self, text, said):
        with pytest.raises(OptionError, match=said):
            parse_surface(text)


class TestStructures:
    @pytest.fixture
    def folder(self, save_nifti, tmp_path):
        volume = heart(1, 2, 3)
        for name, label in STRUCTURES.items():
            save_nifti((volume.values == label).astype(np.uint8), name=f"{name}.nii.gz")
        return tmp_path

    def test_masks_become_one_label_image(self, folder):
        volume = read_structures(folder)
        np.testing.assert_array_equal(volume.values, heart(1, 2, 3).values)
        assert (volume.space, volume.unit) == ("LPS", "mm")

    def test_the_right_ventricle_may_be_missing(self, folder):
        (folder / "heart_ventricle_right.nii.gz").unlink()
        np.testing.assert_array_equal(read_structures(folder).values, heart(1, 2, 0).values)

    def test_the_wall_may_not(self, folder):
        (folder / "heart_myocardium.nii.gz").unlink()
        with pytest.raises(InputError, match=r"missing: .*heart_myocardium"):
            read_structures(folder)

    @pytest.mark.parametrize(
        "values, shift, said",
        [
            (np.ones((16, 10, 9)), 0, "voxels; expected"),
            (np.ones((16, 10, 10)), 1, "off the left ventricle's grid"),
            (np.zeros((16, 10, 10)), 0, "empty"),
            (np.ones((16, 10, 10)), 0, "64 voxels are of another structure"),
        ],
    )
    def test_masks_that_do_not_fit_are_refused_by_name(self, folder, save_nifti, values, shift, said):
        affine = np.eye(4)
        affine[0, 3] = shift
        save_nifti(values.astype(np.uint8), affine, name="heart_myocardium.nii.gz")
        with pytest.raises(MaskError, match=f"heart_myocardium.*{said}"):
            read_structures(folder)


def test_a_real_wall_lies_around_its_cavity(shared):
    volume = read_volume(shared / "data" / "pig_cine_mri" / "sax_lv_labels_crop_4d.nii.gz", frame=0)
    endo = segment(volume, select=PRESETS["ukbb"]["endo"], component="all")
    epi = segment(volume, select=PRESETS["ukbb"]["epi"], component="all")
    assert (epi.mask & endo.mask).sum() == endo.mask.sum() < epi.mask.sum()
