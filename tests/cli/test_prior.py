"""`quadriform prior`: what it writes is what Python gives, of a folder of models and of a cohort."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from html import unescape

import numpy as np
import pytest
from cohort_made import TINY, listed, needs
from priors_made import models

import quadriform as qf
from quadriform.errors import WarningKind
from quadriform.shapes.record import ModelRecord
from quadriform.shapes.splines import TimeBasis

UNRELIABLE = ModelRecord("unreliable", {WarningKind.FOLDING: "it folds"})


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "models").mkdir()
    for number, model in enumerate(models()):
        qf.save(model, tmp_path / "models" / f"{number}.json")
    return tmp_path / "models"


def same(one, other):
    assert one.report == other.report and one.n_models == other.n_models
    np.testing.assert_array_equal(one.modes, other.modes)


def test_a_folder_of_models_gives_the_prior_of_python(terminal, folder):
    result = terminal("prior", folder, "-o", "lv.prior.npz", "--json")
    assert result.code == 0 and result.err == ""
    expected = qf.learn_prior(models())
    same(qf.load("lv.prior.npz"), expected)
    found = json.loads(result.out)
    assert (found["models"], found["left_out"], found["status"], found["unit"]) == (8, 0, "unknown", "mm")
    assert found["leave_one_out"] == expected.report.leave_one_out
    assert found["standard_deviations"] == expected.deviations.tolist()


def test_the_table_has_the_report(terminal, folder):
    text = terminal("prior", folder, "-o", "lv.prior.npz").out
    report = qf.load("lv.prior.npz").report
    assert f"{report.leave_one_out:.3g} mm" in text and f"{report.specificity:.3g} mm" in text
    assert f"{report.modes_90}, {report.modes_95}, {report.modes_99}" in text and "lv.prior.npz" in text


def test_its_options_reach_the_prior(terminal, folder):
    terminal("prior", folder, "-o", "lv.prior.npz", "--box", "3,4,3", "--modes", "1", "--scale")
    same(qf.load("lv.prior.npz"), qf.learn_prior(models(), box=(3, 4, 3), modes=1, scale=True))


def test_models_of_several_inputs_of_fit_are_found(terminal, tmp_path):
    for number, model in enumerate(models()):
        (tmp_path / "out" / str(number)).mkdir(parents=True)
        qf.save(model, tmp_path / "out" / str(number) / "model.json")
    assert terminal("prior", "out", "-o", "lv.prior.npz").code == 0
    assert qf.load("lv.prior.npz").n_models == 8


def test_points_and_priors_beside_the_models_are_no_members(terminal, folder):
    np.savez(folder / "points.npz", points=np.zeros((4, 3)))
    assert terminal("prior", folder, "-o", folder / "lv.prior.npz").code == 0
    assert terminal("prior", folder, "-o", folder / "lv.prior.npz", "--force").code == 0
    assert qf.load(folder / "lv.prior.npz").n_models == 8


def test_unreliable_models_are_left_out_with_a_note(terminal, folder):
    qf.save(replace(models()[3], record=UNRELIABLE), folder / "3.json", force=True)
    refused = terminal("prior", folder, "-o", "lv.prior.npz", "--strict")
    assert refused.code == 3 and "it folds" in refused.err
    assert not (folder.parent / "lv.prior.npz").exists()
    result = terminal("prior", folder, "-o", "lv.prior.npz", "--json")
    assert "1 of 8 models are unreliable and were left out" in result.err
    found = json.loads(result.out)
    assert (found["models"], found["left_out"], found["status"]) == (7, 1, "unreliable")
    same(qf.load("lv.prior.npz"), qf.learn_prior([*models()[:3], *models()[4:]]))


def moving(one, other):
    """A model that is one shape at the first knot and another at the last."""
    control = np.array([one.box.control_points, other.box.control_points])
    basis = TimeBasis(np.array([0.0, 1.0]), None)
    return qf.MovingModel(
        one.surfaces, one.box.origin, one.box.edges, basis, control, "LPS", "mm", frame_times=basis.knots
    )


def test_a_frame_of_moving_models_is_taken(terminal, tmp_path):
    (tmp_path / "cycles").mkdir()
    every = models()
    for number, one in enumerate(every):
        qf.save(moving(one, one.transformed(1.1, np.zeros(3))), tmp_path / "cycles" / f"{number}.json")
    volumes = []
    for frame in (0, 1):
        terminal("prior", "cycles", "-o", f"{frame}.npz", "--frame", frame)
        volumes.append(qf.load(f"{frame}.npz").mean_model().volume())
    assert volumes[0] == pytest.approx(qf.learn_prior(every).mean_model().volume(), rel=1e-6)
    assert volumes[1] == pytest.approx(1.1**3 * volumes[0], rel=1e-6)
    result = terminal("prior", "cycles", "-o", "2.npz", "--frame", "2")
    assert result.code == 2 and "has 2 frames" in result.err


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (("nowhere", "-o", "a.npz"), 4, "expected a folder"),
        ((".", "-o", "a.npz"), 4, "found none"),
        (("models", "-o", "a.json"), 4, "suffix"),
        (("models", "-o", "no/a.npz"), 5, "does not exist"),
        (("models", "-o", "a.npz", "--box", "3,3"), 2, "--box"),
        (("models", "-o", "a.npz", "--modes", "9"), 2, "modes=9"),
    ],
)
def test_bad_requests_give_one_line_and_nothing_else(terminal, folder, tmp_path, words, code, text):
    result = terminal("prior", *words)
    assert result.code == code and text in result.err and len(result.err.splitlines()) == 1 and not result.out
    assert [path.name for path in tmp_path.iterdir()] == ["models"]


def test_an_output_that_exists_is_refused_before_models_are_read(terminal, folder):
    (folder / "0.json").write_text("no model")
    qf.save(qf.learn_prior(models()), folder / "lv.npz")
    assert terminal("prior", folder, "-o", folder / "lv.npz").code == 5
    assert terminal("prior", folder, "-o", folder / "lv.npz", "--force").code == 4


def test_too_few_models_are_refused_with_the_folder(terminal, folder):
    for number in range(2, 8):
        (folder / f"{number}.json").unlink()
    result = terminal("prior", folder, "-o", "a.npz")
    assert result.code == 4 and str(folder) in result.err and "found 2" in result.err


@needs("zarr", "pyarrow")
def test_a_cohort_gives_a_prior_of_its_reliable_models(terminal, tmp_path):
    from quadriform.cohort import executors
    from quadriform.cohort.layout import read_layout
    from quadriform.cohort.overview import overview
    from quadriform.cohort.run import Choices, run
    from quadriform.cohort.stores import models as stored

    manifest = listed(tmp_path, 6, frames=1, broken=(2,), points=300)
    results = tmp_path / "results"
    run(manifest, results, partial(executors.from_executor, ThreadPoolExecutor(1), 1), Choices(TINY))
    layout = read_layout(results)
    bad = {each.id for each in overview(results, 6).worst if each.status == "unreliable"}
    members = [model for name, model in stored(results, layout, range(6)) if name not in bad]
    result = terminal("prior", results, "-o", "lv.prior.npz", "--json")
    assert result.code == 0, result.err
    found = json.loads(result.out)
    assert found["models"] == len(members) and found["left_out"] == len(bad) and len(members) + len(bad) == 5
    same(qf.load("lv.prior.npz"), qf.learn_prior(members, box=layout.box))


def test_fit_takes_a_prior(terminal, folder):
    terminal("prior", folder, "-o", "lv.prior.npz")
    qf.save(models()[3].mesh(resolution=8), "member.ply")
    result = terminal("fit", "member.ply", "--unit", "mm", "--prior", "lv.prior.npz", "-o", "out")
    assert result.code == 0 and "distance to the prior" in result.out
    page = unescape((folder.parent / "out" / "report.html").read_text(encoding="utf-8"))
    assert "with a prior of shape" in page and '"prior": "of 8 shapes"' in page and '"box": [' not in page
    found = qf.load("out/model.json")
    assert np.abs(found.distance(models()[3].mesh(resolution=8).vertices)).max() < 0.5


def test_track_takes_a_prior(terminal, folder):
    terminal("prior", folder, "-o", "lv.prior.npz")
    files = [f"frame{number}.ply" for number in range(2)]
    for number, file in enumerate(files):
        qf.save(models()[number].mesh(resolution=6), file)
    result = terminal("track", *files, "--prior", "lv.prior.npz", "-o", "out")
    assert result.code == 0 and "distance to the prior" in result.out
    page = unescape((folder.parent / "out" / "report.html").read_text(encoding="utf-8"))
    assert '"prior": "of 8 shapes"' in page and '"box": [' not in page
    table = (folder.parent / "out" / "frames.csv").read_text(encoding="utf-8").splitlines()
    assert "prior_distance" in table[0].split(",")
    refused = terminal("track", *files, "--prior", "lv.prior.npz", "--box", "3,3,3", "-o", "other")
    assert refused.code == 2 and "option box" in refused.err and not (folder.parent / "other").exists()


def test_a_file_that_is_no_prior_gives_one_line(terminal, folder):
    qf.save(models()[3].mesh(resolution=8), "member.ply")
    result = terminal("fit", "member.ply", "--prior", folder / "0.json")
    assert result.code == 4 and "prior" in result.err and result.err.count("\n") == 1
