"""Grids of slices by the positions of their images: what differs by rounding is even, and what by more is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydicom.dataset import Dataset
from shapes_made import SKEW

from quadriform.errors import AffineError, InputError
from quadriform.files.slice_planes import RIGHT_ANGLE
from quadriform.imaging import dicom_spacing
from quadriform.imaging.dicom_spacing import ImagePlane, check_same_grid, segmentation_grid, slice_step

ROW, COLUMN, NORMAL = 1.5 * SKEW[:, 0], 2.0 * SKEW[:, 1], SKEW[:, 2]


def plane(height, aside=0.0, number=0, **more):
    origin = np.array([10.0, -20, 30]) + height * NORMAL + aside * SKEW[:, 0]
    made = {"along_row": ROW, "along_column": COLUMN, "size": (100, 50), "file": Path("a"), "index": number}
    return ImagePlane(origin, **(made | {"alone": False} | more))


def test_an_image_has_a_name_a_position_and_a_normal():
    of = plane(3.0, number=7)
    assert of.name == "image 7 of a" and replace(of, alone=True).name == "a"
    np.testing.assert_allclose(of.normal, NORMAL, atol=1e-12)
    assert of.position == f"({', '.join(f'{x:.2f}' for x in of.origin)})"
    affine = dicom_spacing.world_from_voxel(of, 4 * NORMAL, of.origin)
    np.testing.assert_allclose(affine @ [2, 3, 5, 1], [*(of.origin + 2 * ROW + 3 * COLUMN + 20 * NORMAL), 1])


def test_steps_may_differ_by_what_moves_the_far_corner_little():
    """A fraction of the shorter step over the longer side of the image."""
    allowed = dicom_spacing.SAME_ORIENTATION * 1.5 / 100
    for factor, refused in ((0.99, False), (1.01, True)):
        for name, value in (("along_row", ROW), ("along_column", COLUMN)):
            other = plane(4.0, **{name: value + factor * allowed * NORMAL})
            if refused:
                with pytest.raises(InputError, match=r"different orientations or pixel sizes.*1 of 2 differ"):
                    check_same_grid([plane(0.0), other])
            else:
                check_same_grid([plane(0.0), other])
    with pytest.raises(InputError, match=r"different sizes.*\(100, 50\).*\(50, 100\).*2 of 3 differ"):
        check_same_grid([plane(0.0), plane(4.0, size=(50, 100)), plane(8.0, size=(50, 100))])


@pytest.mark.parametrize(("off", "refused"), [(0.099, False), (0.101, True), (-0.099, False), (-0.101, True)])
def test_slices_are_even_to_a_hundredth_of_their_distance_and_rounding(off, refused):
    """Of eight millimetres: 0.08 and 0.02."""
    planes = [plane(height) for height in (0, 8, 16, 24 + off, 32 + off)]
    if refused:
        with pytest.raises(InputError, match=rf"8 mm apart, but {abs(8 + off):.4g} mm between image 0 of a at"):
            slice_step(planes)
    else:
        np.testing.assert_allclose(slice_step(planes), (32 + off) / 4 * NORMAL)


def test_the_sign_and_length_of_a_reconstruction_are_stated():
    header = Dataset()
    header.SpacingBetweenSlices = -4.0
    np.testing.assert_allclose(dicom_spacing.reconstructed_slice_step(header, ROW, COLUMN), -4 * NORMAL, atol=1e-12)


@pytest.mark.parametrize(("skew", "allowed"), [(0.9, True), (1.1, False)])
def test_rows_and_columns_are_at_right_angles(skew, allowed):
    measures, orientation = Dataset(), Dataset()
    measures.PixelSpacing = [2.0, 1.5]
    tilted = SKEW[:, 1] + skew * RIGHT_ANGLE * SKEW[:, 0]
    orientation.ImageOrientationPatient = [round(float(x), 12) for x in (*SKEW[:, 0], *tilted)]
    if allowed:
        row, column = dicom_spacing.pixel_steps(orientation, measures)
        np.testing.assert_allclose(row, ROW, atol=1e-9)
        np.testing.assert_allclose(column, 2 * tilted, atol=1e-9)
    else:
        with pytest.raises(AffineError, match="no right angle"):
            dicom_spacing.pixel_steps(orientation, measures)
    measures.PixelSpacing = [0.0, 1.5]
    with pytest.raises(AffineError):
        dicom_spacing.pixel_steps(orientation, measures)


@pytest.fixture
def unstated(monkeypatch):
    """The spacing that a header states, here none."""
    stated = {"value": 0.0}
    groups = {(0, "PixelMeasuresSequence"): "of the first frame"}
    monkeypatch.setattr(dicom_spacing, "functional_group", lambda header, frame, name: groups[frame, name])
    found = {("of the first frame", "SpacingBetweenSlices", 0.0): stated}
    monkeypatch.setattr(dicom_spacing, "number_or_default", lambda *of: found[of]["value"])
    return stated


@pytest.mark.parametrize("lean", [0.0, 0.3])
def test_frames_of_a_segmentation_lie_on_multiples_of_the_least_distance(unstated, lean):
    heights = np.array([24.0, 0.0, 8.0, 8.01, 40.0])
    planes = [plane(h, lean * h, k) for k, h in enumerate(heights)]
    slices, affine = segmentation_grid(None, planes)
    assert slices == [3, 0, 1, 1, 5]
    np.testing.assert_allclose(affine[:3, 3], planes[1].origin)
    np.testing.assert_allclose(affine[:3, 2], 8 * NORMAL + 8 * lean * SKEW[:, 0], atol=1e-9)
    unstated["value"] = -4.0
    slices, affine = segmentation_grid(None, planes)
    assert slices == [6, 0, 2, 2, 10]
    np.testing.assert_allclose(affine[:3, 2], 4 * NORMAL + 4 * lean * SKEW[:, 0], atol=1e-9)


@pytest.mark.parametrize(("off", "refused"), [(0.09, False), (0.11, True)])
def test_frames_beside_a_grid_are_refused(unstated, off, refused):
    planes = [plane(0.0), plane(8.0, off, 1), plane(16.0, number=2)]
    if refused:
        with pytest.raises(AffineError, match=rf"image 1 of a lies {off:.3g} mm off a grid of slices 8 mm apart"):
            segmentation_grid(None, planes)
    else:
        assert segmentation_grid(None, planes)[0] == [0, 1, 2]


def test_one_position_needs_a_stated_spacing(unstated):
    with pytest.raises(AffineError, match="one slice position"):
        segmentation_grid(None, [plane(0.0), plane(0.019)])
    unstated["value"] = 5.0
    slices, affine = segmentation_grid(None, [plane(0.0)])
    assert slices == [0]
    np.testing.assert_allclose(affine[:3, 2], 5 * NORMAL, atol=1e-12)
