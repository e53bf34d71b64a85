"""The labels of public data sets, checked against how their surfaces enclose each other."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadriform.errors import MaskError, OptionError
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.labels import Preset, parse_surface, preset_labels
from quadriform.imaging.reading import read_volume
from quadriform.imaging.segmentation import Labels, segment
from quadriform.imaging.segments import Segment
from quadriform.imaging.volume import Volume


def heart(cavity, myocardium, rv):
    """A cavity of 4 voxels a side in a wall of one, and a right ventricle beside it."""
    values = np.zeros((16, 10, 10), np.uint8)
    values[2:8, 2:8, 2:8] = myocardium
    values[3:7, 3:7, 3:7] = cavity
    values[9:13, 3:7, 3:7] = rv
    return Volume(values, np.eye(4))


SCANNED = {
    "acdc": (3, 2, 1),
    "ukbb": (1, 2, 3),
    "mnms": (1, 2, 3),
    "totalsegmentator": (3, 1, 5),
    "totalsegmentator, version 1": (46, 44, 48),
}


def by_preset(volume, preset, surface):
    return int(segment(volume, select=preset_labels(volume, Preset(preset, surface))).mask.sum())


class TestPresets:
    @pytest.mark.parametrize("name", SCANNED)
    def test_the_epicardium_encloses_the_cavity_and_no_right_ventricle(self, name):
        volume = heart(*SCANNED[name])
        preset = name.partition(",")[0]
        assert {surface: by_preset(volume, preset, surface) for surface in ("endo", "epi", "rv")} == {
            "endo": 4**3,
            "epi": 6**3,
            "rv": 4**3,
        }

    @pytest.mark.parametrize("preset", ["acdc", "mnms", "ukbb", "totalsegmentator"])
    def test_the_page_has_the_labels_of_the_preset(self, preset):
        page = (Path(__file__).resolve().parents[2] / "docs" / "command_line.md").read_text(encoding="utf-8")
        row = re.search(rf"\| `{preset}` \| (\d+) \| (\d+) \| (\d+) \| `(.*?)`, `(.*?)` \|", page).groups()
        assert tuple(map(int, row[:3])) == SCANNED[preset]
        volume = heart(*SCANNED[preset])
        for name, rule in zip(("endo", "epi"), row[3:], strict=True):
            _, labels = parse_surface(f"{name}={rule}")
            assert segment(volume, select=labels).mask.sum() == by_preset(volume, preset, name)

    def test_other_chambers_do_not_matter_to_totalsegmentator(self):
        values = heart(3, 1, 5).values.copy()
        values[9:13, 3:7, 8] = 2
        values[0, 0, :4] = 6
        assert by_preset(Volume(values, np.eye(4)), "totalsegmentator", "endo") == 4**3

    @pytest.mark.parametrize(
        "preset, labels", [("acdc", (1, 2, 3)), ("ukbb", (3, 2, 1)), ("totalsegmentator", (1, 2, 3))]
    )
    @pytest.mark.parametrize("surface", ["endo", "epi", "rv"])
    def test_another_numbering_is_refused(self, preset, labels, surface):
        with pytest.raises(MaskError, match=f"does not follow the preset '{preset}'"):
            by_preset(heart(*labels), preset, surface)

    def test_labels_that_the_data_set_has_not_are_refused(self):
        values = heart(3, 2, 1).values.copy()
        values[0, 0, 0] = 7
        with pytest.raises(MaskError, match="other labels too: 7"):
            by_preset(Volume(values, np.eye(4)), "acdc", "endo")

    @pytest.mark.parametrize("gone", [2, 3])
    def test_a_part_without_voxels_is_refused(self, gone):
        values = np.where(heart(3, 2, 1).values == gone, 0, heart(3, 2, 1).values)
        with pytest.raises(MaskError, match="has no voxels"):
            by_preset(Volume(values, np.eye(4)), "acdc", "epi")

    def test_totals_of_whole_bodies_are_refused(self):
        """TotalSegmentator's second version: 1 is the spleen, 3 and 5 other organs, and the heart is one label, 51."""
        values = np.zeros((20, 20, 20), np.uint8)
        values[1:6, 1:6, 1:6], values[8:12, 1:6, 1:6], values[8:18, 8:18, 8:18] = 1, 3, 51
        with pytest.raises(MaskError, match="label:"):
            by_preset(Volume(values, np.eye(4)), "totalsegmentator", "endo")

    def test_names_in_the_header_come_first(self):
        """Whatever the numbers are."""
        names = {"heart_ventricle_left": 1, "heart_myocardium": 2, "heart_ventricle_right": 3}
        segments = tuple(Segment(name, number, (number,)) for name, number in names.items())
        named = replace(heart(1, 2, 3), segments=segments)
        assert by_preset(named, "totalsegmentator", "endo") == 4**3
        other = replace(heart(3, 1, 5), segments=(Segment("liver", 3, (3,)), Segment("spleen", 1, (1,))))
        with pytest.raises(MaskError, match="no such segment"):
            by_preset(other, "totalsegmentator", "endo")

    def test_a_missing_label_is_named_with_the_existing_ones(self):
        with pytest.raises(MaskError, match=r"no voxel has the label 3; .*0: .*1: 64, 2: 152"):
            segment(heart(1, 2, 0), select=Labels((3,)))

    def test_an_empty_image_too(self):
        with pytest.raises(MaskError, match="no voxel has the label 1, 2; values and voxels: 0: 1600"):
            points_from_image(heart(0, 0, 0), select=Labels((1, 2)))


class TestParsing:
    @pytest.mark.parametrize(
        "text, name, labels",
        [
            ("endo=label:1", "endo", (1,)),
            ("epi=label:1+2", "epi", (1, 2)),
            ("wall=label: 10 + 20", "wall", (10, 20)),
            ("endo=label:heart_ventricle_left", "endo", ("heart_ventricle_left",)),
            ("epi=label:kidney, left+spleen", "epi", ("kidney, left+spleen",)),
        ],
    )
    def test_what_the_terminal_says(self, text, name, labels):
        assert parse_surface(text) == (name, Labels(labels))

    def test_a_preset_is_checked_later_against_the_image(self):
        assert parse_surface("endo=preset:acdc") == ("endo", Preset("acdc", "endo"))

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


def test_a_real_wall_lies_around_its_cavity(shared):
    volume = read_volume(shared / "data" / "pig_cine_mri" / "sax_lv_labels_crop_4d.nii.gz", frame=0)
    endo = segment(volume, select=preset_labels(volume, Preset("ukbb", "endo")), component="all")
    epi = segment(volume, select=Labels((1, 2)), component="all")
    assert (epi.mask & endo.mask).sum() == endo.mask.sum() < epi.mask.sum()
