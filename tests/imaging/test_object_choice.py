"""What an image's object is where nobody says: label maps of all kinds, and grey images in whole numbers."""

from dataclasses import replace

import nibabel
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from quadriform.errors import MaskError
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.object_choice import choose_object
from quadriform.imaging.reading import example_volume, read_volume
from quadriform.imaging.segmentation import Labels, segment
from quadriform.imaging.segments import Segment
from quadriform.imaging.volume import Volume

SHAPE = (40, 36, 30)


def image(values, **options):
    return Volume(np.asarray(values), np.diag([1.5, 1.5, 2.0, 1.0]), **options)


@pytest.fixture
def ball():
    at = np.stack(np.indices(SHAPE), axis=-1) - (np.array(SHAPE) - 1) / 2
    return np.linalg.norm(at, axis=-1) < 13


def parcels(ball, n, rng, numbers=None):
    """A ball of n regions, each the points nearest to one of n centres."""
    centres = rng.uniform(4, 32, (n, 3))
    at = np.stack(np.indices(SHAPE), axis=-1)
    nearest = cKDTree(centres).query(at)[1]
    numbers = np.arange(1, n + 1) if numbers is None else np.asarray(numbers)
    return np.where(ball, numbers[nearest], 0)


@pytest.mark.parametrize("dtype, n", [(np.uint16, 150), (np.int32, 70), (np.float32, 70), (np.float64, 70)])
def test_a_choice_is_requested_of_many_labels(ball, rng, dtype, n):
    numbers = np.sort(rng.choice(np.arange(1, 2036), n, replace=False))  # as FreeSurfer's
    values = parcels(ball, n, rng, numbers).astype(dtype)
    with pytest.raises(MaskError, match=r"choose with --label.*--threshold.*Labels and voxels: \d+: \d+"):
        choose_object(image(values))
    label, counts = np.unique(values[values > 0], return_counts=True)
    with pytest.raises(MaskError, match=f"voxels: {label[counts.argmax()]:g}: {counts.max()}"):
        choose_object(image(values))


def test_a_choice_is_requested_of_many_tiny_labels_beside_a_large_one(ball):
    values = ball.astype(np.uint8)
    for n in range(2, 36):
        values[0, n, :2] = n
    with pytest.raises(MaskError, match=r"35 values in connected regions.*1: "):
        choose_object(image(values))


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
@pytest.mark.parametrize("n", [2, 3, 7, 20])
def test_few_labels_are_taken_together(ball, rng, dtype, n):
    values = parcels(ball, n, rng)
    select, notes = choose_object(image(values.astype(dtype)))
    assert select == Labels(tuple(np.unique(values[values > 0]).tolist())) and "together" in notes[0]


def test_labels_around_each_other_are_labels(ball):
    inner = ndimage.binary_erosion(ball, iterations=4)
    assert choose_object(image(ball.astype(np.int16) + inner))[0] == Labels((1, 2))


@pytest.mark.parametrize("value", [1, 2, 255, 2035])
def test_a_mask_is_a_mask_whatever_its_value(ball, value):
    assert choose_object(image(ball * value))[0] == Labels((value,))


def test_a_mask_of_single_voxels_is_a_mask(rng):
    assert choose_object(image(rng.random(SHAPE) < 0.2))[0] == Labels((1,))


GREY = {
    "CT": lambda ball, rng: np.rint(np.where(ball, 40, -1000) + rng.normal(0, 15, SHAPE)).astype(np.int16),
    "CT with padding": lambda ball, rng: np.where(ball, np.rint(60 + rng.normal(0, 20, SHAPE)), -2000).astype(np.int16),
    "CT stored from 0": lambda ball, rng: np.rint(np.where(ball, 1064, 90) + rng.normal(0, 9, SHAPE)).astype(np.uint16),
    "CT with little noise": lambda ball, rng: np.rint(np.where(ball, 1040, 24) + rng.normal(0, 1, SHAPE)).astype(
        np.uint16
    ),
    "8-bit MR": lambda ball, rng: np.clip(np.where(ball, 120, 12) + rng.normal(0, 8, SHAPE), 0, 255).astype(np.uint8),
    "SPECT counts": lambda ball, rng: rng.poisson(np.where(ball, 60, 4)).astype(np.uint16),
    "low SPECT counts": lambda ball, rng: rng.poisson(np.where(ball, 12, 1)).astype(np.uint8),
    "smoothed 8-bit MR": lambda ball, rng: ndimage.gaussian_filter(
        np.where(ball, 150.0, 20.0) + rng.normal(0, 30, SHAPE), 1
    ).astype(np.uint8),
    "windowed CT": lambda ball, rng: np.clip(np.where(ball, 230, 0) + rng.normal(0, 25, SHAPE), 0, 255).astype(
        np.uint8
    ),
    "CT in steps of 25 HU": lambda ball, rng: np.clip(
        np.rint((np.where(ball, 1040, 0) + rng.normal(0, 15, SHAPE)) / 25) * 25, 0, None
    ).astype(np.uint16),
    "CT in few grey values": lambda ball, rng: (ball * np.rint(8 + rng.normal(0, 0.4, SHAPE))).astype(np.uint8),
    "probabilities": lambda ball, rng: ndimage.gaussian_filter(ball.astype(np.float32), 1.5),
    "float MR": lambda ball, rng: (np.where(ball, 1.0, 0.1) + rng.normal(0, 0.05, SHAPE)).astype(np.float32),
    "two values": lambda ball, rng: np.where(ball, 0.999, 0.0).astype(np.float32),
}


@pytest.mark.parametrize("name", GREY)
def test_grey_images_are_thresholded(ball, rng, name):
    volume = image(GREY[name](ball, rng))
    select, notes = choose_object(volume)
    assert select == "otsu" and "grey image" in notes[0]
    assert abs(int(segment(volume).mask.sum()) / ball.sum() - 1) < 0.1


@pytest.mark.parametrize("n", [5, 60])
def test_small_labels_in_coarse_voxels_are_labels(ball, rng, n):
    """Hardly a voxel of them is alone among others, as noise is."""
    coarse = parcels(ball, n, rng)[::2, ::2, ::2]
    if n > 32:
        with pytest.raises(MaskError, match="values in connected regions"):
            choose_object(image(coarse))
    else:
        assert isinstance(choose_object(image(coarse))[0], Labels)


@pytest.mark.parametrize(
    ("name", "make", "said"),
    [
        ("the background is -1", lambda ball, labels: labels - 1, "whole numbers from -1"),
        ("a mask stored in a signed byte", lambda ball, labels: -ball.astype(np.int8), "whole numbers from -1"),
        ("no voxel is 0", lambda ball, labels: 20 + 100 * ball, "without a voxel of 0.*20: "),
    ],
)
def test_a_choice_is_requested_of_labels_without_a_known_background(ball, rng, name, make, said):
    with pytest.raises(MaskError, match=said):
        choose_object(image(make(ball, parcels(ball, 5, rng))))


def test_python_and_terminal_have_one_rule(ball, rng):
    """What decides for the terminal is the default of `segment` and `points_from_image`."""
    many, few = image(parcels(ball, 70, rng)), image(parcels(ball, 3, rng))
    for take in (segment, points_from_image):
        with pytest.raises(MaskError, match="--label"):
            take(many)
    assert segment(few).mask.sum() == ball.sum() and "together" in segment(few).notes[0]
    assert points_from_image(few).record["select"] == {"labels": [1, 2, 3]}
    assert "together" in points_from_image(few).record["notes"][0]


def test_a_choice_is_requested_of_a_steady_ramp(ball):
    """Neither noise nor anything else tells it from labels."""
    ramp = np.broadcast_to(np.repeat(np.arange(1, 41), 1)[:, None, None], SHAPE).astype(np.uint8)
    with pytest.raises(MaskError, match="--threshold"):
        choose_object(image(ramp))


def test_a_choice_is_requested_of_an_interpolated_label_image(ball, rng):
    fine = ndimage.zoom(parcels(ball, 6, rng).astype(np.float32), 1.5, order=1)
    with pytest.raises(MaskError, match=f"^{(fine % 1 != 0).sum()} voxels lie between.*interpolated.*--threshold"):
        choose_object(image(fine))


def test_labels_that_are_not_whole_are_not_what_the_file_says(ball):
    with pytest.raises(MaskError, match=r"says that its values are labels.*--threshold"):
        choose_object(image(ball * 1.5 + ball[::-1], is_label_map=True))


def test_a_header_that_states_labels_decides(rng):
    """Scattered labels, which look like noise."""
    values = rng.integers(0, 20, SHAPE)
    assert choose_object(image(values))[0] == "otsu"
    assert isinstance(choose_object(image(values, is_label_map=True))[0], Labels)


def test_a_header_that_states_labels_decides_before_values_below_minus_one_do(ball, rng):
    labels = parcels(ball, 3, rng)
    values = np.where(labels == 2, -5, labels)
    assert choose_object(image(values))[0] == "otsu"
    with pytest.raises(MaskError, match=r"whole numbers from -5.*--label"):
        choose_object(image(values, is_label_map=True))


def test_the_intent_code_of_nifti_is_such_a_header(tmp_path, rng):
    stored = nibabel.Nifti1Image(rng.integers(0, 50, SHAPE).astype(np.int16), np.eye(4))
    stored.header.set_intent("label")
    nibabel.save(stored, tmp_path / "a.nii")
    with pytest.raises(MaskError, match="49 values"):
        choose_object(read_volume(tmp_path / "a.nii"))


def test_segments_are_never_merged(ball):
    values = ball.astype(np.uint8)
    one = image(values, segments=(Segment("liver", 1, (1,)), Segment("empty", 2, (2,))))
    assert choose_object(one)[0] == Labels((1,))
    values = values + ndimage.binary_erosion(ball, iterations=3)
    two = replace(one, values=values, segments=(Segment("liver", 1, (1,)), Segment("tumor", 2, (2,))))
    with pytest.raises(MaskError, match=r"2 segments.*--label.*'tumor' \(2\): \d+, 'liver' \(1\): \d+"):
        choose_object(two)
    unnamed = replace(two, segments=(Segment("liver", 1, (1,)),))  # and a value without a name
    with pytest.raises(MaskError, match="'liver'"):
        choose_object(unnamed)


def test_a_real_grey_image_stays_one():
    volume = example_volume()
    assert volume.values.dtype.kind in "iu"
    assert choose_object(volume)[0] == "otsu"


def test_the_label_map_of_the_cases(shared):
    file = shared / "cases" / "nifti" / "many_labels.nii"
    if not file.is_file():
        pytest.skip("this file is not beside the repository")
    with pytest.raises(MaskError, match="1: 6709"):
        choose_object(read_volume(file))
