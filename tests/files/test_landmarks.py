"""The base of a ventricle and the insertions of the right one go to a file and back; older files have none."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shapes_made import made

import quadriform as qf
from quadriform.errors import FileFormatError, OptionError
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.landmarks import BasePlane, Landmarks
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.splines import TimeBasis

OLD = Path(__file__).parent / "old"
PLANE = BasePlane(np.array([1.0, 2, 3]), np.array([0.6, 0, 0.8]))
BOTH = Landmarks(PLANE, "the plane of its mitral points", np.array([[4.0, 5, 6], [7, 8, 9]]))
KINDS = {"none": Landmarks(), "base": Landmarks(PLANE, "the given base"), "both": BOTH}
KINDS["insertions"] = Landmarks(rv_inserts=BOTH.rv_inserts)


def still(landmarks):
    return qf.DeformableModel({"endo": made()}, ControlBox.around(made()), "LPS", "mm", landmarks=landmarks)


def moving(landmarks):
    """Three frames, a period of 4; the base of frame k is at (k, 2, 3)."""
    box, every = ControlBox.around(made()), []
    for k in range(3):
        base = None if landmarks.base is None else replace(PLANE, point=np.array([float(k), 2, 3]))
        every.append(replace(landmarks, base=base))
    control = np.stack([box.control_points + k for k in range(3)])
    basis = TimeBasis(np.arange(3.0), 4.0)
    return MovingModel({"endo": made()}, box.origin, box.edges, basis, control, "LPS", "mm", landmarks=tuple(every))


def assert_same(one, other):
    assert one.base_from == other.base_from and (one.base is None) == (other.base is None)
    np.testing.assert_array_equal(one.rv_inserts, other.rv_inserts)
    if one.base is not None:
        np.testing.assert_array_equal(one.base.point, other.base.point)
        np.testing.assert_array_equal(one.base.direction, other.base.direction)


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(("make", "suffix"), [(still, ".json"), (still, ".npz"), (moving, ".json")])
def test_there_and_back(tmp_path, make, suffix, name):
    first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    model = make(KINDS[name])
    qf.save(model, first)
    back = qf.load(first)
    pairs = zip(back.landmarks, model.landmarks) if make is moving else [(back.landmarks, model.landmarks)]
    for one, other in pairs:
        assert_same(one, other)
    qf.save(back, second)
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("make", [still, moving])
def test_they_travel_with_the_model(make):
    """A point of the plane stays on it, and an insertion at its place of the model, in another frame and unit."""
    model = make(BOTH)
    state = model.at(0.0) if isinstance(model, MovingModel) else model
    heights = state.landmarks.base.heights(state.mesh().vertices)
    distances = np.linalg.norm(state.mesh().vertices - state.landmarks.rv_inserts[0], axis=1)
    for moved, scale in ((model.in_space("RAS"), 1.0), (model.transformed(2.0, np.array([1.0, 2, 3])), 2.0)):
        then = moved.at(0.0) if isinstance(moved, MovingModel) else moved
        np.testing.assert_allclose(then.landmarks.base.heights(then.mesh().vertices), scale * heights, atol=1e-12)
        apart = np.linalg.norm(then.mesh().vertices - then.landmarks.rv_inserts[0], axis=1)
        np.testing.assert_allclose(apart, scale * distances)


def test_a_state_has_those_of_the_nearest_frame_around_the_period():
    model = moving(BOTH)
    for time, frame in ((0.0, 0), (0.4, 0), (0.6, 1), (2.9, 2), (3.1, 0), (5.0, 1), (-0.1, 0)):
        assert model.at(time).landmarks.base.point[0] == frame
    assert replace(model, landmarks=()).at(1.0).landmarks.base is None
    with pytest.raises(OptionError, match="one entry for each of 3 frames"):
        replace(model, landmarks=model.landmarks[:2])


@pytest.mark.parametrize("name", ["model_v2.json", "model_v2.npz", "moving_v3.json"])
def test_files_of_the_version_before_have_none(name):
    """These files were written by the versions in their names."""
    old = qf.load(OLD / name)
    assert (old.status, old.record.title) == ("warned", "heart.nii")
    state = old.at(0.0) if isinstance(old, MovingModel) else old
    assert state.landmarks.base is None and not len(state.landmarks.rv_inserts)


BAD = [
    ({"base": None}, "field landmarks.rv_inserts: expected a value"),
    ({"base": None, "rv_inserts": [[1, 2]]}, r"field landmarks.rv_inserts\[0\]: expected 3"),
    ({"base": {"point": [1, 2, 3]}, "rv_inserts": []}, "field landmarks.base.direction: expected a value"),
    ({"base": None, "rv_inserts": [], "apex": 1}, "field landmarks.apex: expected only"),
    (7, "field landmarks: expected an object"),
]
BAD += [
    ({"base": {"point": [1, 2, 3], "direction": [0, 0, 1], "from": "x"} | change, "rv_inserts": []}, message)
    for change, message in (
        ({"direction": [0, 0, 2]}, "field landmarks.base.direction: expected a direction of length 1"),
        ({"point": [0, 0, None]}, "field landmarks.base.point.2.: expected a finite number"),
        ({"from": ""}, "field landmarks.base: base_from='': expected a text"),
        ({"normal": 1}, "field landmarks.base.normal: expected only"),
    )
]


@pytest.mark.parametrize(("value", "message"), BAD)
def test_what_is_wrong_is_refused_by_its_path(tmp_path, value, message):
    qf.save(still(BOTH), tmp_path / "m.json")
    found = json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))
    (tmp_path / "m.json").write_text(json.dumps(found | {"landmarks": value}))
    with pytest.raises(FileFormatError, match=message):
        qf.load(tmp_path / "m.json")


def test_a_version_that_had_none_is_refused_with_them(tmp_path):
    for model, version in ((still(BOTH), 2), (moving(BOTH), 3)):
        qf.save(model, tmp_path / "m.json", force=True)
        found = json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))
        (tmp_path / "m.json").write_text(json.dumps(found | {"version": version}))
        with pytest.raises(FileFormatError, match="field landmarks: expected only"):
            qf.load(tmp_path / "m.json")
