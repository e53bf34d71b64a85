"""Standard deviations of measures by samples whose deviations are known: a body that is scaled as a whole."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from quadriform.errors import OptionError
from quadriform.heart.deviations import MOST_FAILED, aligned_samples, with_deviations
from quadriform.heart.measure import measure
from quadriform.heart.measures_table import Row, write_measures
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.posterior import Posterior
from quadriform.shapes.superquadric import Superquadric

CAVITY = Superquadric("ellipsoid", (20, 20, 30), (1, 1), np.eye(3), (0, 0, 0))
SCALES = np.array([0.010, -0.013, 0.004, 0.021, -0.008, -0.014])
"""Relative changes of all lengths, with the mean zero."""
SD = SCALES.std(ddof=1)


def scaled(size, source, scales=SCALES):
    """A cavity of a size whose samples have other sizes."""
    box = ControlBox.around(CAVITY, (2, 2, 2))
    control = size * box.rest
    posterior = Posterior(scales[:, None, None, None, None] * control, source)
    return DeformableModel({"endo": CAVITY}, box.with_control_points(control), unit="mm", posterior=posterior)


def test_relative_deviations_of_volumes_are_three_times_those_of_lengths():
    found = measure(scaled(1.0, "one"))
    assert found.estimate("end-diastolic volume").sd == pytest.approx(3 * SD * found["end-diastolic volume"], rel=0.01)


def test_what_both_phases_have_in_common_does_not_change_the_ejection_fraction():
    found = measure([scaled(1.0, "one"), scaled(0.8, "one")])
    assert found.estimate("ejection fraction").sd == pytest.approx(0, abs=1e-6)
    stroke = found.estimate("stroke volume")
    assert stroke.sd == pytest.approx(3 * SD * stroke.value, rel=0.01)


def test_fits_of_different_data_have_independent_errors():
    scales = np.random.default_rng(0).normal(0, 0.01, 1000)
    models = [scaled(1.0, "one", scales), scaled(1.0, "other", scales)]
    one, other = np.array([[m.box.control_points[0, 0, 0, 0] for m in pair] for pair in aligned_samples(models)]).T
    assert abs(np.corrcoef(one, other)[0, 1]) < 3 / np.sqrt(1000)
    joint = np.array(aligned_samples([models[0], models[0]])).T
    np.testing.assert_array_equal(*[[m.box.control_points for m in of] for of in joint])


def test_without_a_posterior_of_each_model_there_is_no_deviation():
    models = [scaled(1.0, "one"), replace(scaled(0.8, "one"), posterior=None)]
    assert all(row.sd is None for row in measure(models).rows)


def test_samples_that_cannot_be_measured_are_left_out_unless_there_are_many():
    model = scaled(1.0, "one")

    def rows_of(fails):
        numbers = iter(range(len(SCALES)))

        def measured(models):
            if (number := next(numbers)) < fails:
                raise OptionError("the base misses it")
            return [Row("size", float(number), "mm", "")]

        return measured

    row = [Row("size", 0.0, "mm", "")]
    least = int(MOST_FAILED * len(SCALES))
    assert with_deviations(row, [model], rows_of(least))[0].sd == pytest.approx(4 * np.std(range(least, 6), ddof=1))
    assert with_deviations(row, [model], rows_of(least + 1))[0].sd is None


def test_the_curve_of_the_volume_has_the_deviations_of_its_rows():
    found = measure([scaled(1.0, "one"), scaled(0.9, "one"), scaled(0.8, "one")])
    curve, sd = found.curves["cavity volume"], found.curves_sd["cavity volume"]
    np.testing.assert_allclose(sd, 3 * SD * curve, rtol=0.01)
    assert found.record()["curves_sd"] == {"cavity volume": sd.tolist()}
    assert measure(scaled(1.0, "one")).curves_sd == {}


def test_deviations_are_printed_and_in_the_table(tmp_path):
    found = measure(scaled(1.0, "one"))
    write_measures(found, tmp_path / "table.csv")
    with open(tmp_path / "table.csv", newline="", encoding="utf-8") as file:
        row = next(csv.DictReader(file))
    assert float(row["sd"]) == found.estimate("end-diastolic volume").sd == found.record()["measures"][0]["sd"]
    assert "end-diastolic volume: 50.3 ± 2.1 ml" in repr(found)
