import numpy as np
import pytest
from numpy.testing import assert_array_equal

from quadriform.errors import DegenerateError, MaskError, OptionError
from quadriform.imaging.segmentation import Labels, Percentile, _describe, _threshold, segment
from quadriform.imaging.volume import Volume


def image(values, affine=None):
    return Volume(np.asarray(values), np.eye(4) if affine is None else affine)


@pytest.fixture
def box():
    """A solid 6 x 5 x 4 box of 1 in an image of 0."""
    values = np.zeros((12, 12, 12), np.uint8)
    values[3:9, 3:8, 4:8] = 1
    return values


class TestThreshold:
    def test_objects_are_strictly_above_a_value(self, rng):
        values = rng.integers(0, 9, (8, 8, 8))
        found = segment(image(values), select=4, component="all")
        assert_array_equal(found.mask, values > 4)
        assert found.threshold == 4

    def test_a_percentile_looks_at_the_region_only(self, rng):
        values = rng.random((10, 10, 10))
        values[0, 0, 0] = 1000.0  # a hot voxel outside the region
        region = ((2, 9), (1, 8), (3, 10))
        found = segment(image(values), select=Percentile(0.5, 90), region=region, component="all")
        inner = values[2:9, 1:8, 3:10]
        assert found.threshold == 0.5 * np.percentile(inner, 90)
        expected = np.zeros_like(found.mask)
        expected[2:9, 1:8, 3:10] = inner > found.threshold
        assert_array_equal(found.mask, expected)
        assert found.region == region

    @pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32, np.int64])
    def test_otsu_parts_two_populations(self, box, rng, dtype):
        values = (box * 90 + rng.integers(0, 20, box.shape)).astype(dtype)
        assert_array_equal(segment(image(values), select="otsu").mask, box == 1)

    def test_otsu_of_huge_whole_numbers_needs_no_huge_memory(self, box):
        assert_array_equal(segment(image(box.astype(np.int64) * 2**40)).mask, box == 1)

    @pytest.mark.parametrize("dtype", [bool, np.uint8, float])
    def test_otsu_of_a_mask_is_the_mask(self, box, dtype):
        assert_array_equal(segment(image(box.astype(dtype))).mask, box == 1)

    @pytest.mark.parametrize("select", ["half", np.nan, True, Percentile(-1, 50), Percentile(0.5, 101)])
    def test_an_unknown_threshold_is_refused(self, box, select):
        with pytest.raises(OptionError, match="option"):
            segment(image(box), select=select)


class TestLabels:
    def test_a_label_and_a_union(self, rng):
        values = rng.integers(-1, 4, (8, 8, 8)) * 300  # negative and above 255
        one = segment(image(values), select=Labels((300,)), component="all")
        assert_array_equal(one.mask, values == 300)
        union = segment(image(values.astype(float)), select=Labels((-300, 900)), component="all")
        assert_array_equal(union.mask, (values == -300) | (values == 900))
        assert union.threshold is None

    def test_a_missing_label_lists_those_present(self, box):
        with pytest.raises(MaskError, match=r"label 2; .*0: 1608, 1: 120"):
            segment(image(box), select=Labels((1, 2)))

    def test_labels_are_whole(self, box):
        with pytest.raises(MaskError, match="120 values are not whole"):
            segment(image(box * 0.999), select=Labels((1,)))
        for labels in ((), (1.0,), (True,)):
            with pytest.raises(OptionError, match="Labels"):
                segment(image(box), select=Labels(labels))


class TestComponents:
    @pytest.fixture
    def two(self):
        values = np.zeros((12, 12, 12), np.uint8)
        values[1:4, 1:4, 1:4] = 1
        values[6:11, 6:11, 6:11] = 1
        return values

    def test_the_largest_is_kept_and_all_are_listed(self, two):
        found = segment(image(two))
        assert found.mask.sum() == 125 and found.mask[8, 8, 8]
        assert found.component_voxels == (125, 27)
        assert found.components_kept == 1

    def test_all_are_kept_on_request(self, two):
        found = segment(image(two), component="all")
        assert_array_equal(found.mask, two == 1)
        assert found.components_kept == 2

    def test_a_seed_is_a_voxel_of_the_whole_image(self, two):
        found = segment(image(two), component=(3, 2, 2), region=((1, 12), (1, 12), (1, 12)))
        assert found.mask.sum() == 27 and found.mask[1, 1, 1]

    def test_a_common_corner_connects_by_default(self, box):
        box[9:11, 8:10, 8:10] = 1  # shares one corner with the box
        assert segment(image(box)).component_voxels == (128,)
        assert segment(image(box), connectivity=6).component_voxels == (120, 8)

    def test_a_seed_in_the_background_or_outside(self, two):
        with pytest.raises(MaskError, match=r"\(5, 5, 5\) is background"):
            segment(image(two), component=(5, 5, 5))
        with pytest.raises(OptionError, match="outside the region"):
            segment(image(two), component=(8, 8, 8), region=((0, 6), (0, 6), (0, 6)))

    @pytest.mark.parametrize("component", ["biggest", (1, 2), (1.0, 2.0, 3.0)])
    def test_an_unknown_component_is_refused(self, two, component):
        with pytest.raises(OptionError, match="component"):
            segment(image(two), component=component)

    def test_an_unknown_connectivity_is_refused(self, two):
        with pytest.raises(OptionError, match="connectivity"):
            segment(image(two), connectivity=18)


class TestClosing:
    @pytest.mark.parametrize("steps", [0, 1, 2, 5])
    def test_a_solid_box_stays(self, box, steps):
        assert_array_equal(segment(image(box), closing=steps).mask, box == 1)

    @pytest.mark.parametrize("steps", [1, 2, 5])
    @pytest.mark.parametrize("axis", [0, 1, 2])
    @pytest.mark.parametrize("end", [slice(None, 4), slice(-4, None)])
    def test_the_border_eats_nothing(self, steps, axis, end):
        values = np.zeros((9, 9, 9), np.uint8)
        part = [slice(2, 7)] * 3
        part[axis] = end
        values[tuple(part)] = 1
        assert_array_equal(segment(image(values), closing=steps).mask, values == 1)

    def test_a_gap_is_bridged_when_no_cross_of_that_many_steps_fits_in(self):
        values = np.zeros((16, 16, 16), np.uint8)
        values[3:13, 3:13, 3:13] = 1
        gap = values.copy()
        gap[6:9, 6:9, 6:9] = 0  # a cross of one step fits in, with its 7 voxels; one of two steps does not
        sizes = [segment(image(gap), closing=steps).mask.sum() for steps in (0, 1, 2)]
        assert sizes == [1000 - 27, 1000 - 7, 1000]
        assert_array_equal(segment(image(gap), closing=2).mask, values == 1)

    def test_a_crack_through_the_object_is_bridged(self):
        values = np.zeros((16, 16, 16), np.uint8)
        values[3:13, 3:13, 3:13] = 1
        values[8] = 0
        found = segment(image(values), component="all", closing=1)
        assert found.mask[8, 4:12, 4:12].all()

    def test_equal_steps_never_remove(self, rng):
        values = rng.random((14, 14, 14)) > 0.6
        before = segment(image(values)).mask
        after = segment(image(values), closing=2).mask
        assert (after >= before).all()

    @pytest.mark.parametrize("steps", [-1, 1.5, True])
    def test_steps_are_whole_and_not_negative(self, box, steps):
        with pytest.raises(OptionError, match="closing"):
            segment(image(box), closing=steps)


class TestHoles:
    def test_a_hole_is_counted_and_filled_on_request(self, box):
        hollow = box.copy()
        hollow[5:7, 5, 5:7] = 0
        kept, filled = (segment(image(hollow), fill_holes=fill) for fill in (False, True))
        assert kept.hole_voxels == filled.hole_voxels == 4
        assert_array_equal(kept.mask, hollow == 1)
        assert_array_equal(filled.mask, box == 1)

    def test_background_at_the_border_is_no_hole(self):
        cup = np.zeros((8, 8, 8), np.uint8)
        cup[1:7, 1:7, 0:5] = 1
        cup[3:5, 3:5, 0:3] = 0
        assert segment(image(cup), fill_holes=True).hole_voxels == 0

    def test_an_edge_does_not_open_a_hole(self, box):
        box[4, 4, 5] = 0  # inside
        box[3, 3, 5] = 0  # a notch in the box's edge; the two share an edge, no side
        assert segment(image(box)).hole_voxels == 1


class TestNoObject:
    @pytest.mark.parametrize("value, said", [(0, "empty"), (1, "full")])
    def test_empty_and_full_list_the_values(self, value, said):
        with pytest.raises(MaskError, match=rf"{said}.*{value}: 64"):
            segment(image(np.full((4, 4, 4), value)), select=0.5)

    def test_a_range_is_shown_for_many_values(self, rng):
        with pytest.raises(MaskError, match=r"empty.*run from \d"):
            segment(image(rng.random((4, 4, 4))), select=2)

    def test_a_constant_image_has_no_otsu(self):
        with pytest.raises(MaskError, match="all voxels are 7"):
            segment(image(np.full((4, 4, 4), 7)), select="otsu")

    def test_a_mask_that_filling_makes_full(self):
        values = np.ones((4, 4, 4))
        values[1, 1, 1] = 0
        with pytest.raises(MaskError, match="full"):
            segment(image(values), fill_holes=True)

    def test_one_voxel(self):
        values = np.zeros((4, 4, 4))
        values[1, 2, 1] = 1
        with pytest.raises(DegenerateError, match="one voxel"):
            segment(image(values), closing=2)

    @pytest.mark.parametrize("axis", [0, 1, 2])
    def test_one_slice(self, axis):
        values = np.zeros((6, 6, 6))
        part = [slice(1, 5)] * 3
        part[axis] = slice(2, 3)
        values[tuple(part)] = 1
        with pytest.raises(DegenerateError, match=r"one slice.*4"):
            segment(image(values))


class TestWarnings:
    def test_none_for_a_box_in_the_middle(self, box):
        assert segment(image(box)).warnings == {}

    def test_a_cut_names_its_faces_and_the_fraction_of_the_surface(self):
        values = np.zeros((4, 6, 5))
        values[0:2, 1:4, 3:5] = 1  # 2 x 3 x 2 voxels at the first i and the last k
        sides = np.diag([1.0, 2.0, 3.0, 1.0])  # sides of 6, 3 and 2
        cut = segment(image(values, sides)).warnings["BORDER_CUT"]
        assert "first i (6 voxels), last k (6 voxels)" in cut
        total = 2 * (6 * 6 + 4 * 3 + 6 * 2)
        assert f"{(6 * 6 + 6 * 2) / total:.1%}" in cut

    def test_the_edge_of_a_region_cuts_too(self, box):
        found = segment(image(box), region=((0, 12), (0, 12), (0, 6)))
        assert "last k (30 voxels)" in found.warnings["BORDER_CUT"]
        assert "first" not in found.warnings["BORDER_CUT"]

    @pytest.mark.parametrize("ratio, named", [(3.9, False), (4.1, True)])
    def test_long_voxels_are_named(self, box, ratio, named):
        warnings = segment(image(box, np.diag([1, 1, ratio, 1]))).warnings
        assert ("ANISOTROPIC" in warnings) is named


def test_the_input_is_not_changed(box):
    volume = image(box)
    before = box.copy()
    segment(volume, closing=1, fill_holes=True, component="all")
    assert_array_equal(volume.values, before)


def test_the_object_stays_in_its_place(box, oblique):
    region = ((2, 10), (2, 11), (3, 9))
    found = segment(image(box, oblique), region=region)
    shown = found.object_volume()
    assert_array_equal(shown.values, box[2:10, 2:11, 3:9])
    assert_array_equal(shown.points_world([[0, 0, 0]]), image(box, oblique).points_world([[2, 2, 3]]))


def test_up_to_twenty_values_are_counted_and_more_are_a_range():
    assert _describe(np.repeat(np.arange(20), 2)).startswith("values and voxels: 0: 2, 1: 2, ")
    assert _describe(np.arange(21)) == "the values run from 0 to 20"


@pytest.mark.parametrize(("of", "value"), [(0, -4.0), (0.5, -3.9), (50, 6.0), (100, 16.0)])
def test_a_percentile_is_taken_of_all_values_from_the_least_to_the_largest(of, value):
    values = np.arange(-4.0, 17).reshape(3, 7)
    assert _threshold(values, Percentile(0.3, of)) == pytest.approx(0.3 * value)
    assert _threshold(values, Percentile(0, of)) == 0
    assert _threshold(values, 2.5) == 2.5
