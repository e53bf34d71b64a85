"""The counts by which an image is taken for labels, against loops over voxels and pairs of them."""

from itertools import product

import numpy as np
import pytest

from quadriform.errors import MaskError
from quadriform.imaging import object_choice
from quadriform.imaging.object_choice import Labels, choose_object, counted
from quadriform.imaging.segments import Segment
from quadriform.imaging.volume import Volume


def pairs(values, background):
    equal = total = 0
    for at in product(*map(range, values.shape)):
        for axis in range(3):
            after = tuple(np.array(at) + np.eye(3, dtype=int)[axis])
            if after[axis] == values.shape[axis] or values[at] in background or values[after] in background:
                continue
            total, equal = total + 1, equal + (values[at] == values[after])
    return equal / total if total else 1.0


def alone(values):
    found = total = 0
    for at in product(*(range(1, size - 1) for size in values.shape)):
        beside = [values[tuple(np.array(at) + s * np.eye(3, dtype=int)[axis])] for axis in range(3) for s in (-1, 1)]
        if values[at] == 0 or 0 in beside:
            continue
        total, found = total + 1, found + (values[at] not in beside)
    return found / max(total, 1)


@pytest.mark.parametrize("seed", range(3))
def test_equal_pairs_and_isolated_voxels_are_counted_over_faces(seed):
    values = np.random.default_rng(seed).integers(0, 4, (5, 6, 4))
    values[1:4, 1:4, 1:3] = np.random.default_rng(seed).integers(1, 4, (3, 3, 2))
    for background in ((0,), (0, 2), (0, 1, 2, 3)):
        assert object_choice._equal_pairs(values, background) == pytest.approx(pairs(values, background))
    assert object_choice._isolated(values) == pytest.approx(alone(values))
    assert object_choice._isolated(np.zeros((3, 3, 3))) == 0
    single = np.ones((3, 3, 3))
    single[1, 1, 1] = 2
    assert object_choice._isolated(single) == 1


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.int64, np.float64, np.uint64])
def test_values_are_counted_in_their_order(dtype, rng):
    for low, high in ((0, 5), (-3, 4), (0, 10**9)):
        if (low < 0 and np.dtype(dtype).kind == "u") or (high > 255 and dtype in (np.uint8, np.int16)):
            continue
        values = rng.integers(low, high, (4, 4, 4)).astype(dtype)
        present, counts = counted(values)
        expected = sorted(set(values.ravel().tolist()))
        assert present.tolist() == expected
        assert counts.tolist() == [int((values == each).sum()) for each in expected]


def blocks(labels, size=6):
    """Regions of a label each, side by side, on a background."""
    values = np.zeros((size * len(labels) + 2, size + 2, size + 2))
    for k, label in enumerate(labels):
        values[1 + size * k : 1 + size * (k + 1), 1:-1, 1:-1] = label
    return values


def test_labels_from_minus_one_on_are_asked_for_and_lower_values_are_grey():
    assert choose_object(Volume(blocks([1, 2]), np.eye(4)))[0] == Labels((1, 2))
    with pytest.raises(MaskError, match="whole numbers from -1 in connected regions"):
        choose_object(Volume(blocks([-1, 2, 3]), np.eye(4)))
    assert choose_object(Volume(blocks([-2, 2, 3]), np.eye(4)))[0] == "otsu"
    with pytest.raises(MaskError, match="without a voxel of 0"):
        choose_object(Volume(blocks([1, 2])[1:-1, 1:-1, 1:-1], np.eye(4)))
    assert choose_object(Volume(np.full((4, 4, 4), 3), np.eye(4)))[0] == Labels((3,))
    note = choose_object(Volume(blocks([5]), np.eye(4)))[1][0]
    assert note == "taken as a label image, the object is label 5"
    assert choose_object(Volume(np.zeros((4, 4, 4)), np.eye(4))) == (0.5, ())


@pytest.mark.parametrize(("count", "asked"), [(object_choice.MAX_LABELS, False), (object_choice.MAX_LABELS + 1, True)])
def test_of_more_labels_than_can_be_listed_one_is_asked_for(count, asked):
    image = Volume(blocks(list(range(1, count + 1)), 4), np.eye(4))
    if asked:
        with pytest.raises(MaskError, match=f"{count} values in connected regions"):
            choose_object(image)
    else:
        assert choose_object(image)[0] == Labels(tuple(range(1, count + 1)))


def test_of_segments_with_voxels_one_alone_is_the_object():
    values = blocks([1, 2])
    one, two, none = Segment("a", 1, (1,)), Segment("b", 2, (2,)), Segment("c", 3, (9,))
    only = Volume(np.where(values == 1, 1, 0), np.eye(4), segments=(one, none))
    assert choose_object(only) == (Labels((1,)), ("the object is the segment 'a'",))
    with pytest.raises(MaskError, match=r"2 segments with voxels.*'a' \(1\): 216, 'b' \(2\): 216"):
        choose_object(Volume(values, np.eye(4), segments=(one, two, none)))
    with pytest.raises(MaskError, match="1 segments with voxels"):  # another value has no name
        choose_object(Volume(values, np.eye(4), segments=(one, none)))


@pytest.mark.parametrize("share", [0.02, 0.6])
def test_fractions_between_regions_are_those_of_an_interpolation(share):
    """Where most voxels are whole numbers in regions; elsewhere the image is grey."""
    rng = np.random.default_rng(1)
    values = blocks([1, 2])
    inside = np.argwhere(values > 0)
    some = inside[rng.permutation(len(inside))[: int(share * len(inside))]]
    values[tuple(some.T)] += 0.5
    image = Volume(values, np.eye(4))
    if share < 0.1:
        with pytest.raises(MaskError, match=f"{len(some)} voxels lie between whole numbers"):
            choose_object(image)
    else:
        assert choose_object(image)[0] == "otsu"


def test_candidates_are_listed_by_their_voxels():
    text = object_choice._candidates(np.array([0, 3, 4, 5]), np.array([99, 1, 7, 7]))
    assert text.endswith("Labels and voxels: 4: 7, 5: 7, 3: 1")
