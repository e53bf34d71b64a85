"""Values of headers: what stands there, what is missing, and what is none."""

from types import SimpleNamespace

import numpy as np
import pytest

from quadriform.errors import AffineError, FileFormatError
from quadriform.imaging import dicom_values as values


@pytest.mark.parametrize(
    ("time", "seconds"),
    [("000000", 0), ("101530.25", 36930.25), ("235959.5", 86399.5), ("010203", 3723), (None, None), ("noon", None)],
)
def test_times_of_a_day_are_hours_minutes_and_seconds(time, seconds):
    assert values.seconds_of_day(time) == seconds


def test_one_whole_number_is_read_for_each_image():
    header = {"SliceVector": [3, 1, 2], "Single": 7}
    assert values.vector_of(header, "SliceVector", 3) == values.vector_of(header, "SliceVector", 3, 9) == [3, 1, 2]
    assert values.vector_of(header, "Single", 1) == [7]
    assert values.vector_of(header, "Missing", 4, 0) == [0, 0, 0, 0]
    for keyword, count in (("SliceVector", 2), ("Missing", 1)):
        with pytest.raises(AffineError, match=rf"expected {count} numbers in {keyword}"):
            values.vector_of(header, keyword, count)


def test_numbers_are_finite_or_missing():
    item = {"a": "1.5", "b": [1, 2, 3], "none": None, "text": "x", "endless": np.inf}
    assert values.required_numbers(item, "a", 1).tolist() == [1.5]
    assert values.required_numbers(item, "b", 3).tolist() == [1, 2, 3]
    for keyword, count in (("a", 2), ("b", 2), ("none", 1), ("text", 1), ("endless", 1), ("missing", 1)):
        with pytest.raises(AffineError, match=rf"expected {keyword} with {count} finite numbers"):
            values.required_numbers(item, keyword, count)
    found = [values.optional_number(item, keyword) for keyword in ("a", "none", "text", "endless", "missing")]
    assert found == [1.5, None, None, None, None]
    found = [values.number_or_default(item, keyword, 4.0) for keyword in ("a", "none", "missing")]
    assert found == [1.5, 4.0, 4.0]
    for keyword in ("text", "endless"):
        with pytest.raises(FileFormatError, match=f"expected {keyword} to be a finite number"):
            values.number_or_default(item, keyword, 4.0)


def test_a_group_of_an_image_is_its_own_or_that_of_all():
    def header(shared):
        images = [{"own": ["first"], "both": ["one"]}, {"own": ["second"]}]
        return SimpleNamespace(
            PerFrameFunctionalGroupsSequence=images, get={"SharedFunctionalGroupsSequence": shared}.get
        )

    of = header([{"both": ["all"]}])
    assert [values.functional_group(of, image, "own") for image in (0, 1)] == ["first", "second"]
    assert [values.functional_group(of, image, "both") for image in (0, 1)] == ["one", "all"]
    assert values.functional_group(header(None), 1, "both") == {}


def test_a_file_has_one_image_unless_it_says_otherwise():
    assert [values.n_images(header) for header in ({}, {"NumberOfFrames": None}, {"NumberOfFrames": "12"})] == [
        1,
        1,
        12,
    ]
    assert values.is_segmentation({"SOPClassUID": values.SEGMENTATIONS[1]}) and not values.is_segmentation({})
