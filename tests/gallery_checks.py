"""The gallery, for `make docs`: each example runs without a warning, prints what its page shows, finds the truth."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
gallery = runpy.run_path(str(ROOT / "docs" / "gallery_figures.py"))


@pytest.mark.parametrize("name", gallery["ORDER"])
def test_an_example_runs_and_finds_the_truth(name):
    if name == "shape_modes":
        pytest.importorskip("sklearn", reason="scikit-learn (extra cohort) is not installed")
    names, printed = gallery["run"](name)
    shown = gallery["printed_on_page"]()[name]
    number = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")  # rounding differs between processors
    assert number.sub("#", printed).split() == number.sub("#", shown).split() != []
    TRUE[name](names)


def close(value, truth, relative):
    assert value == pytest.approx(truth, rel=relative)


def beating(names):
    assert names["measures"]["ejection fraction"] == pytest.approx(names["exact"]["ejection fraction"], abs=3)


def outliers(names):
    moved = np.abs(names["points"] - names["clean"]).max(axis=1) > 0
    found = names["fit"].inliers < 0.5
    assert np.mean(found[moved]) > 0.9 and np.mean(found[~moved]) < 0.02


def carried(names):
    assert np.abs(names["back"] - names["inner"]).max() < 1e-9


def bodies(names):
    close(names["fit"].model.volume("epi"), names["heart"].model(0.0).volume("epi"), 0.03)


def modes(names):
    assert names["found"].variance_ratios[0] > 0.9


def paper(names):
    assert names["fit"].rms < names["fit"].superquadric_rms / 4


def statuses(names):
    whole, seen, two = names["fits"].values()
    assert [each.status for each in (whole, seen, two)] == ["ok", "warned", "unreliable"]
    assert whole.supported > 0.99 and abs(seen.supported - 0.5) < 0.1


TRUE = {
    "which_results_to_use": statuses,
    "ellipsoid_from_points": lambda n: close(np.sort(n["found"].superquadric.semi_axes), [20, 30, 40], 0.02),
    "mask_to_model": lambda n: close(n["fit"].model.volume(), n["voxels"], 0.02),
    "mesh_to_model": lambda n: close(n["surface"].volume, n["mesh"].volume, 0.01),
    "two_surfaces": bodies,
    "cycle_and_ejection_fraction": beating,
    "outliers": outliers,
    "open_cavity": lambda n: close(n["fit"].rms, 0.5, 0.15),
    "save_and_load": lambda n: np.testing.assert_array_equal(n["model"].mesh().vertices, n["again"].mesh().vertices),
    "deform_inner_points": carried,
    "shape_modes": modes,
    "paper_method": paper,
}
