"""Priors in files: exactly what was saved comes back, and whatever is not a prior is one typed error."""

import contextlib
import io
import json
from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest
from priors_made import bent, models, wall

import quadriform as qf
from quadriform.errors import FileFormatError, InputError, OptionError, OutputError, QuadriformError
from quadriform.files.packed import TEXT, VALUES
from quadriform.files.priors import read_prior
from quadriform.shapes.prior import ShapePrior


@cache
def prior():
    return qf.learn_prior([wall(mesh) for mesh in bent()], box=(3, 4, 2), space="RAS", unit="m")


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "lv.prior.npz"
    qf.save(prior(), path)
    return path


def test_exactly_what_was_saved_comes_back(saved):
    back = qf.load(saved)
    assert isinstance(back, ShapePrior) and list(back.surfaces) == ["endo", "epi"]
    for name in ("mean", "modes", "variances", "metric"):
        np.testing.assert_array_equal(getattr(back, name), getattr(prior(), name))
    np.testing.assert_array_equal(back.box.control_points, prior().box.control_points)
    for name in ("freedom", "n_models", "report", "space", "unit"):
        assert getattr(back, name) == getattr(prior(), name)
    np.testing.assert_array_equal(back.precision(), prior().precision())


def test_the_same_prior_has_the_same_bytes(saved, tmp_path):
    qf.save(qf.load(saved), tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == saved.read_bytes()


def test_it_is_read_without_pickle(saved):
    with np.load(saved, allow_pickle=False) as archive:
        assert {archive[name].dtype for name in archive.files} == {np.dtype(np.uint8), np.dtype(np.float64)}


def test_nothing_is_overwritten_unasked(saved):
    before = saved.read_bytes()
    with pytest.raises(OutputError, match="exists already"):
        qf.save(replace(prior(), unit="mm"), saved)
    assert saved.read_bytes() == before
    qf.save(replace(prior(), unit="mm"), saved, force=True)
    assert qf.load(saved).unit == "mm"


def test_what_no_file_can_hold_is_refused(tmp_path):
    with pytest.raises(FileFormatError, match=r"'\.json'"):
        qf.save(prior(), tmp_path / "lv.json")
    with pytest.raises(OptionError, match="unit='feet'"):
        qf.save(replace(prior(), unit="feet"), tmp_path / "lv.npz")
    assert not list(tmp_path.iterdir())


def test_every_cut_of_a_file_is_refused(saved):
    whole = saved.read_bytes()
    for end in np.linspace(1, len(whole) - 1, 40).astype(int):
        saved.write_bytes(whole[:end])
        with pytest.raises(FileFormatError):
            qf.load(saved)


def test_changed_bytes_are_refused_or_change_nothing(saved):
    whole = saved.read_bytes()
    for at in np.random.default_rng(0).integers(0, len(whole), 60):
        saved.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        with contextlib.suppress(QuadriformError):
            assert asdict(qf.load(saved).report) == asdict(prior().report)


def document_and_values(path):
    with np.load(path) as archive:
        return json.loads(archive[TEXT].tobytes()), archive[VALUES].copy()


def rewritten(path, document, values):
    stream = io.BytesIO()
    np.savez(stream, **{TEXT: np.frombuffer(json.dumps(document).encode(), np.uint8), VALUES: values})
    path.write_bytes(stream.getvalue())


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda d: d.update(format="quadriform-cohort"), "format"),
        (lambda d: d.update(version=2), "version"),
        (lambda d: d.update(unit="feet"), "unit"),
        (lambda d: d.update(space=1), "space"),
        (lambda d: d.update(n_models=2.5), "n_models"),
        (lambda d: d.update(n_models=2), "n_models=2"),
        (lambda d: d.update(freedom=-1.0), "freedom"),
        (lambda d: d.update(freedom="1"), "freedom"),
        (lambda d: d.update(more=1), "more"),
        (lambda d: d.pop("freedom"), "freedom"),
        (lambda d: d["report"].update(specificity=-1.0), "specificity"),
        (lambda d: d["report"].update(modes_90=1.5), r"report\.modes_90"),
        (lambda d: d["report"].update(more=1), r"report\.more"),
        (lambda d: d["report"].pop("residual"), r"report\.residual"),
        (lambda d: d["surfaces"].clear(), "values by the shapes"),
        (lambda d: d["surfaces"][1].update(name="endo"), r"surfaces\[1\]\.name"),
        (lambda d: d["mean"].update(shape=[12, 6]), "mean"),
        (lambda d: d["metric"].update(shape=[18, 32]), "metric"),
        (lambda d: d["modes"].update(shape=[1, 1, d["modes"]["shape"][0] * 72]), "modes"),
        (lambda d: d.update(mean=[]), "values by the shapes"),
    ],
)
def test_a_field_that_cannot_be_is_named(saved, change, field):
    document, values = document_and_values(saved)
    change(document)
    rewritten(saved, document, values)
    with pytest.raises(FileFormatError, match=field):
        read_prior(saved)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e40])
def test_numbers_that_are_not_finite_or_out_of_range_are_refused(saved, value):
    document, values = document_and_values(saved)
    for at in range(0, len(values), 97):
        changed = values.copy()
        changed[at] = value
        rewritten(saved, document, changed)
        with pytest.raises(FileFormatError):
            qf.load(saved)


def test_surfaces_far_from_the_box_are_refused(saved):
    surfaces = {name: each.transformed(1, np.full(3, 1e12)) for name, each in prior().surfaces.items()}
    qf.save(replace(prior(), surfaces=surfaces), saved, force=True)
    with pytest.raises(FileFormatError, match="near it, found surface 'endo'"):
        qf.load(saved)


def test_numbers_of_another_type_are_refused(saved):
    document, values = document_and_values(saved)
    rewritten(saved, document, values.astype(np.float32))
    with pytest.raises(FileFormatError, match="float64"):
        qf.load(saved)


def test_other_files_are_no_priors(saved, tmp_path):
    qf.save(models()[0], tmp_path / "model.npz")
    np.savez(tmp_path / "arrays.npz", points=np.zeros((4, 3)))
    with pytest.raises(FileFormatError, match="quadriform-prior"):
        read_prior(tmp_path / "model.npz")
    with pytest.raises(FileFormatError, match=r"expected a prior.*found points"):
        read_prior(tmp_path / "arrays.npz")
    with pytest.raises(InputError, match="no such file"):
        read_prior(tmp_path / "none.npz")
    with pytest.raises(QuadriformError, match="expected points"):
        qf.fit(saved)
