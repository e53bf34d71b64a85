"""A moving model goes to a file and back with every number; what is wrong in a file is named."""

import base64
import json
from dataclasses import replace

import numpy as np
import pytest
from shapes_made import made

import quadriform as qf
from quadriform.errors import FileFormatError
from quadriform.files.models import read_moving_model
from quadriform.files.records import FIELDS
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.posterior import Posterior
from quadriform.shapes.splines import TimeBasis


@pytest.fixture(params=[4.0, None], ids=["periodic", "once"])
def moving(request, rng):
    surfaces = {"endo": made(), "epi": made(semi_axes=(40, 30, 20))}
    box = ControlBox.around(surfaces["epi"], (3, 4, 3))
    control = box.control_points + rng.normal(size=(3, *box.control_points.shape))
    return MovingModel(
        surfaces,
        box.origin,
        box.edges,
        TimeBasis(np.arange(3.0), request.param),
        control,
        "LPS",
        "mm",
        "a" * 64,
        np.linspace(0, 2, 7) ** 1.5 / 2**0.5,
        posterior=Posterior(rng.normal(size=(4, *control.shape)), "b" * 64),
    )


def test_there_and_back(moving, tmp_path):
    qf.save(moving, tmp_path / "model.json")
    back = qf.load(tmp_path / "model.json")
    assert isinstance(back, MovingModel)
    assert back.control_points.tobytes() == moving.control_points.tobytes()
    assert back.basis.period == moving.basis.period and (back.basis.knots == moving.basis.knots).all()
    assert (back.space, back.unit, back.input_sha256) == ("LPS", "mm", "a" * 64)
    assert list(back.surfaces) == ["endo", "epi"]
    assert back.frame_times.tobytes() == moving.frame_times.tobytes() and len(back.frame_times) == 7
    assert back.posterior.deviations.tobytes() == moving.posterior.deviations.tobytes()
    assert back.posterior.source == "b" * 64


def test_a_posterior_is_optional_since_version_5(moving, tmp_path):
    qf.save(replace(moving, posterior=None), tmp_path / "model.json")
    assert qf.load(tmp_path / "model.json").posterior is None
    document = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    del document["posterior"]
    for version in (4, 5):
        (tmp_path / "old.json").write_text(json.dumps(document | {"version": version}))
        assert qf.load(tmp_path / "old.json").posterior is None


def test_a_file_of_version_1_has_its_frames_at_the_knots(moving, tmp_path):
    qf.save(moving, tmp_path / "model.json")
    document = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    del document["time"]["frames"]
    document = {name: value for name, value in document.items() if name not in (*FIELDS, "landmarks", "posterior")} | {
        "version": 1
    }
    (tmp_path / "old.json").write_text(json.dumps(document))
    old = qf.load(tmp_path / "old.json")
    assert np.array_equal(old.frame_times, moving.basis.knots)
    assert old.control_points.tobytes() == moving.control_points.tobytes()


def test_a_model_that_does_not_move_is_still_one(tmp_path):
    still = qf.DeformableModel({"surface": made()}, ControlBox.around(made()))
    qf.save(still, tmp_path / "still.json")
    assert isinstance(qf.load(tmp_path / "still.json"), qf.DeformableModel)
    with pytest.raises(FileFormatError, match="quadriform-moving-model"):
        read_moving_model(tmp_path / "still.json")


BREAKS = {
    "knots that turn back": (lambda d: d["time"].update(knots=[0, 2, 1]), "increasing"),
    "a knot too few": (lambda d: d["time"].update(knots=[0, 1]), "one box a knot"),
    "a later version": (lambda d: d.update(version=6), "newer quadriform"),
    "version 1 with times of frames": (
        lambda d: [d.pop(name) for name in (*FIELDS, "landmarks", "posterior")] + [d.update(version=1)],
        "time.frames",
    ),
    "version 2 with a record": (lambda d: d.update(version=2), "field status: expected only"),
    "version 3 without": (lambda d: d["time"].pop("frames"), "time.frames"),
    "no frames": (lambda d: d["time"].update(frames=[]), "one or more times"),
    "frames out of order": (lambda d: d["time"].update(frames=[0, 2, 1]), "frame_times: expected increasing"),
    "an unknown field": (lambda d: d.update(patient="x"), "unknown"),
    "no period": (lambda d: d["time"].pop("period"), "time.period"),
    "version 4 with a posterior": (lambda d: d.update(version=4), "field posterior: expected only"),
    "a posterior without its source": (lambda d: d["posterior"].pop("source"), "posterior.source"),
    "more in a posterior": (lambda d: d["posterior"].update(more=1), "posterior.more"),
    "no samples": (lambda d: d["posterior"].update(samples=0), "posterior.samples: expected one sample or more"),
    "half a sample": (lambda d: d["posterior"].update(samples=1.5), "posterior.samples: expected a whole"),
    "a sample too many": (lambda d: d["posterior"].update(samples=5), "posterior.float32: expected 1620 numbers"),
    "samples that are cut": (
        lambda d: d["posterior"].update(float32=d["posterior"]["float32"][:-8]),
        "posterior.float32: expected 1296 numbers of 4 bytes.*found 5178 bytes",
    ),
    "samples that are no base 64": (
        lambda d: d["posterior"].update(float32=d["posterior"]["float32"].replace("A", "*")),
        "posterior.float32: expected numbers in base 64",
    ),
    "samples that are no numbers": (
        lambda d: d["posterior"].update(float32=base64.b64encode(b"\xff" * 4 * 1296).decode()),
        "posterior.float32: deviations: expected finite",
    ),
    "a posterior that is a list": (lambda d: d.update(posterior=[1]), "posterior: expected an object"),
    "text for a time": (lambda d: d["time"].update(knots=["a"]), "finite number"),
}


@pytest.mark.parametrize("name", BREAKS)
def test_what_is_wrong_is_named(moving, tmp_path, name):
    change, message = BREAKS[name]
    qf.save(moving, tmp_path / "model.json")
    document = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    change(document)
    (tmp_path / "broken.json").write_text(json.dumps(document))
    with pytest.raises(FileFormatError, match=message):
        qf.load(tmp_path / "broken.json")
