"""A cohort with a prior of shape: distances in the table and on the page, and priors that are not of the subjects."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from cohort_made import needs
from priors_made import meshes

import quadriform as qf
from quadriform.cohort import executors
from quadriform.cohort.layout import Layout, read_layout
from quadriform.cohort.run import Choices, run
from quadriform.cohort.stores import models
from quadriform.errors import InputError

pytestmark = [needs("zarr", "pyarrow", "sklearn"), pytest.mark.usefixtures("blank_figures", "remembered_fits")]
ONE_THREAD = partial(executors.from_executor, ThreadPoolExecutor(1), 1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two members of a population, their list, and priors of it: one, another one, and one in another unit."""
    folder = tmp_path_factory.mktemp("members")
    prior = qf.learn_prior(meshes())
    for name, scores in (("mean", (0.0,)), ("far", (2.0, 0.0, 0.0))):
        qf.save(prior.model(scores).mesh(resolution=8), folder / f"{name}.ply")
    qf.save(prior, folder / "one.prior.npz")
    qf.save(replace(prior, n_models=9), folder / "other.prior.npz")
    qf.save(replace(prior, unit="m"), folder / "metres.prior.npz")
    surfaces = {"endo": prior.surfaces["surface"]}
    qf.save(replace(prior, surfaces=surfaces), folder / "endo.prior.npz")
    (folder / "list.csv").write_text("id,input\nmean,mean.ply\nfar,far.ply\n", encoding="utf-8")
    (folder / "boxes.csv").write_text('id,input,box\na,far.ply,"3,3,3"\n', encoding="utf-8")
    (folder / "moving.csv").write_text("id,input\na,far.ply;mean.ply\n", encoding="utf-8")
    (folder / "previous.csv").write_text("id,input,strategy\na,far.ply;mean.ply,previous\n", encoding="utf-8")
    return folder


def fitted(folder, results, prior="one.prior.npz", subjects="list.csv", **choices):
    given = None if prior is None else folder / prior
    return run(folder / subjects, results, ONE_THREAD, Choices(prior=given, **choices))


@pytest.fixture(scope="module")
def results(folder, tmp_path_factory):
    path = tmp_path_factory.mktemp("cohort") / "out"
    fitted(folder, path)
    return path


def test_each_subject_is_a_member(folder, results):
    prior = qf.load(folder / "one.prior.npz")
    for name, model in models(results, read_layout(results), range(2)):
        points = qf.load(folder / f"{name}.ply").vertices
        assert np.sqrt((model.distance(points) ** 2).mean()) < 0.1
        assert model.box.control_points.shape == prior.box.control_points.shape


def test_distances_and_the_name_of_the_prior_are_stored(results):
    found = {}
    for name in ("mean", "far"):
        record = json.loads((results / "subjects" / name / "record.json").read_text(encoding="utf-8"))
        assert record["prior"]["name"] == "one.prior.npz" and len(record["prior"]["sha256"]) == 64
        found[name] = next(value for quantity, _, value, *_ in record["measures"] if quantity == "prior distance")
    assert found["mean"] < 0.2 and found["far"] == pytest.approx(2, abs=0.2)
    assert "prior distance" in (results / "cohort.html").read_text(encoding="utf-8")


def test_results_with_one_prior_are_kept_and_not_continued_with_another(folder, results):
    assert fitted(folder, results, resume=True).counts == {"kept": 2}
    for prior in ("other.prior.npz", None):
        for choices in ({"resume": True}, {"force": True}):
            with pytest.raises(InputError, match="of another prior"):
                fitted(folder, results, prior, **choices)


def test_a_subject_of_several_frames_is_a_member_in_each(folder, tmp_path):
    fitted(folder, tmp_path, subjects="moving.csv")
    record = json.loads((tmp_path / "subjects" / "a" / "record.json").read_text(encoding="utf-8"))
    found = next(value for quantity, _, value, *_ in record["measures"] if quantity == "prior distance")
    assert found == pytest.approx(2.0, abs=0.2)  # that of the frame farthest from the mean
    assert isinstance(qf.load(tmp_path / "subjects" / "a" / "model.json"), qf.MovingModel)


@pytest.mark.parametrize(
    ("prior", "subjects", "named"),
    (
        ("endo.prior.npz", "list.csv", "surfaces endo"),
        ("one.prior.npz", "previous.csv", "line 2: strategy"),
        ("one.prior.npz", "boxes.csv", "line 2: box"),
        ("far.ply", "list.csv", "npz"),
        ("none.npz", "list.csv", "none.npz"),
    ),
)
def test_a_prior_that_is_none_of_the_subjects_is_refused_before_any_fit(folder, tmp_path, prior, subjects, named):
    with pytest.raises(qf.errors.QuadriformError, match=named):
        fitted(folder, tmp_path / "out", prior, subjects)
    assert not list(tmp_path.rglob("*.json"))  # another prior can be used in the same folder


def test_a_prior_in_another_unit_is_refused(folder, tmp_path):
    (tmp_path / "list.csv").write_text("id,input\na,a.txt\n", encoding="utf-8")
    (tmp_path / "a.txt").write_text("x mm,y mm,z mm\n1,2,3\n", encoding="utf-8")
    with pytest.raises(InputError, match="in the unit m; the subjects are in mm"):
        run(tmp_path / "list.csv", tmp_path / "out", ONE_THREAD, Choices(prior=folder / "metres.prior.npz"))


def test_a_prior_that_changes_during_the_run_is_a_failure_of_the_subject(folder, tmp_path):
    from quadriform.cohort.prior_file import PriorFile

    path = tmp_path / "lv.npz"
    path.write_bytes((folder / "one.prior.npz").read_bytes())
    file = PriorFile.of(path)
    path.write_bytes((folder / "other.prior.npz").read_bytes())
    with pytest.raises(InputError, match="has changed"):
        file.read()


def test_layouts_of_the_version_before_have_no_prior(results, tmp_path):
    document = json.loads((results / "cohort.json").read_text(encoding="utf-8"))
    del document["prior"]
    (tmp_path / "cohort.json").write_text(json.dumps(document | {"version": 1}), encoding="utf-8")
    found = read_layout(tmp_path)
    assert isinstance(found, Layout) and found.prior == ""
