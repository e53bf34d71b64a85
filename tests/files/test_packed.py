"""Arrays of a document are taken out of its text, and come back in their places."""

import io
import json

import numpy as np
import pytest

from quadriform.errors import FileFormatError
from quadriform.files.packed import TEXT, VALUES, Unpacking, packed

DOCUMENT = {
    "numbers": {"one": [1.5], "row": [[1.0, 2.0, 3.0]], "column": [[4.0], [5.0]], "cube": [[[6, 7]], [[8, 9]]]},
    "none": [],
    "words": ["a", ["b"]],
    "items": [{"name": "first", "at": [10.0, 11.0]}, {"name": "second", "at": []}],
    "value": 12.5,
}


def unpacked(data):
    with np.load(io.BytesIO(data)) as archive:
        return json.loads(archive[TEXT].tobytes()), archive[VALUES]


def test_arrays_of_any_shape_come_back():
    text, values = unpacked(packed(DOCUMENT))
    shapes = {"one": [1], "row": [1, 3], "column": [2, 1], "cube": [2, 1, 2]}
    assert text["numbers"] == {name: {"shape": shape} for name, shape in shapes.items()}
    assert text["items"][0]["at"] == {"shape": [2]}
    assert all(text[name] == DOCUMENT[name] for name in ("none", "words", "value"))
    assert values.tolist() == [1.5, *range(1, 12)]
    assert Unpacking(values, "m").document(text) == DOCUMENT


@pytest.mark.parametrize("count", [11, 13])
def test_values_and_shapes_go_together(count):
    text, _ = unpacked(packed(DOCUMENT))
    with pytest.raises(FileFormatError, match=r"m: expected .* values.*, found"):
        Unpacking(np.zeros(count), "m").document(text)


@pytest.mark.parametrize("values", [np.zeros(12, dtype=np.float32), np.zeros((12, 1))])
def test_values_are_one_row_of_numbers(values):
    with pytest.raises(FileFormatError, match="one row of float64"):
        Unpacking(values, "m")
