"""Lost digits are reported whatever type, container or text the coordinates come in, and only where they are lost."""

import numpy as np
import pytest
from shapes_made import lumpy

import quadriform as qf
from quadriform.errors import WarningKind
from quadriform.point_sets import precision_loss

CLOUD = lumpy(60)
HALF = np.linalg.norm(np.ptp(CLOUD, axis=0)) / 2


def reported(points, given=None):
    values = np.asarray(points, dtype=np.float64)
    return precision_loss(values if given is None else given, values).get(WarningKind.PRECISION_LOSS, "")


def texts(points, pattern):
    return [[float(pattern % value) for value in row] for row in np.asarray(points).tolist()]


SOURCES = {
    "a list": lambda points: points.tolist(),
    "double precision made of it": lambda points: points.astype(np.float64),
    "big-endian": lambda points: points.astype(">f4").astype(np.float64),
    "all digits as text": lambda points: texts(points, "%.17g"),
    "the fewest digits as text": lambda points: [[float(str(value)) for value in row] for row in points],
}


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("offset", [1e4, 1e5, 1e6, 5e6, 1e7, 1e8])
def test_single_precision_is_seen_in_the_values(source, offset):
    single = (CLOUD * 20 / HALF + offset).astype(np.float32)
    step = np.spacing(single.max())
    text = reported(SOURCES[source](single))
    assert f"neighbouring float32 values at {single.max():.3g} are {step:.1e} apart" in text


@pytest.mark.parametrize("offset", [0, 10, 100, 500])
def test_single_precision_near_the_origin_is_good_enough(offset):
    assert reported((CLOUD * 20 / HALF + offset).astype(np.float32)) == ""


@pytest.mark.parametrize("offset", [0, 1e4, 1e6, 1e8])
def test_double_precision_is_not_taken_for_single(offset):
    assert reported(CLOUD * 20 / HALF + offset) == ""
    assert reported(CLOUD[:11] + offset) == ""


@pytest.mark.parametrize(("pattern", "offset"), [("%.0f", 1e4), ("%.0f", 4.5e6), ("%g", 1e6), ("%.4e", 3e5)])
def test_a_text_of_few_digits_far_from_the_origin(pattern, offset):
    assert "neighbouring decimal values" in reported(texts(CLOUD * 20 / HALF + offset, pattern))


@pytest.mark.parametrize(
    ("pattern", "offset", "size"),
    [("%.1f", 0, 20), ("%.0f", 0, 20), ("%.0f", 100, 20), ("%.2f", 4512345, 20), ("%.0f", 4.5e6, 20_000)],
)
def test_a_resolution_that_suits_the_body_is_none_of_our_business(pattern, offset, size):
    """Voxel centres, hundredths at the coordinates of a map, whole millimetres of a building."""
    assert reported(texts(CLOUD * size / HALF + offset, pattern)) == ""


def test_a_type_that_is_known_counts():
    half = CLOUD.astype(np.float16)
    assert "float16" in reported(half, half) and "float16" in reported(half, np.dtype(np.float16))
    whole = np.round(CLOUD * 20 / HALF + 1e7).astype(np.int64)
    assert reported(whole, whole) == ""


@pytest.mark.parametrize("scale", [1e-320, 1e-300, 1e200, 1e300])
def test_sizes_beyond_reason_are_left_to_the_check_of_the_points(scale):
    assert reported(CLOUD / np.abs(CLOUD).max() * scale) == ""


def test_a_fit_reports_it_for_lists_and_readers(tmp_path):
    far = (CLOUD + 1e6).astype(np.float32)
    np.savetxt(tmp_path / "p.xyz", far)
    for points in (far, far.tolist(), qf.read_points(tmp_path / "p.xyz")):
        assert "float32" in qf.fit_superquadric(points).warnings["PRECISION_LOSS"]
