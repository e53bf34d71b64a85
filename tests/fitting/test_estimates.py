"""Volumes and areas state the share of them that is extrapolated, wherever they are printed."""

import pytest
from shapes_made import lumpy

import quadriform as qf
from quadriform.errors import OptionError
from quadriform.shapes.record import Estimate, extrapolated, with_deviation


def test_what_is_extrapolated_is_stated_and_marked_above_a_few_per_cent():
    assert [extrapolated(share) for share in (None, 1.0, 0.97, 0.8)] == [
        "",
        "",
        "3 % extrapolated",
        "not observed, 20 % extrapolated",
    ]
    assert str(Estimate(1234.5, "mm^3", 0.8)) == "1234 mm^3, not observed, 20 % extrapolated"
    assert str(Estimate(2.0, "")) == "2"
    assert [Estimate(1.0, "", share).observed for share in (None, 0.96, 0.94)] == [True, True, False]


@pytest.fixture(scope="module")
def half():
    cloud = lumpy(800)
    return qf.fit(cloud[cloud[:, 2] < 10], box=(3, 3, 3), unit="mm")


def test_a_fit_estimates_volume_and_area(half):
    volume, area = half.volume(), half.area()
    assert (volume.value, volume.unit) == (half.model.volume(), "mm^3")
    assert (area.value, area.unit, area.supported) == (half.model.area(), "mm^2", half.supported)
    assert 0.3 < volume.supported < 0.95 and not volume.observed
    with pytest.raises(OptionError, match="'inner' is unknown"):
        half.volume("inner")
    whole = qf.fit(lumpy(800), box=(3, 3, 3))
    assert whole.volume().supported > 0.99 and whole.volume().unit == "" and whole.volume().observed


def test_they_stay_with_the_model(half, tmp_path):
    qf.save(half.with_estimates().model, tmp_path / "m.json")
    found = qf.load(tmp_path / "m.json").record.estimates
    assert found == {"volume": half.volume(), "area": half.area()}


@pytest.mark.parametrize(("level", "halves"), [(0.95, 1.959964), (0.6826895, 1.0), (0.5, 0.6744898)])
def test_intervals_are_those_of_a_normal_distribution(level, halves):
    low, high = Estimate(132.0, "ml", sd=2.0).interval(level)
    assert (low, high) == pytest.approx((132 - 2 * halves, 132 + 2 * halves), rel=1e-6)
    assert Estimate(132.0, "ml").interval() is None


@pytest.mark.parametrize("level", [0.0, 1.0, 95, -0.5, float("nan")])
def test_levels_that_are_no_probabilities_are_refused(level):
    with pytest.raises(OptionError, match="level="):
        Estimate(132.0, "ml", sd=2.0).interval(level)


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (132.123, 2.04, "132.1 ± 2.0"),
        (0.05123, 0.00099, "0.05123 ± 0.00099"),
        (123456.0, 789.0, "123460 ± 790"),
        (-17.25, 12.3, "-17 ± 12"),
        (132.123, None, "132.1"),
        (132.123, 0.0, "132.1"),
        (132.123, 0.024, "132.12 ± 0.02"),
        (132.123, 0.004, "132.1"),
        (0.0, 0.25, "0.00 ± 0.25"),
    ],
)
def test_a_value_is_printed_to_the_second_digit_of_its_deviation(value, sd, text):
    assert with_deviation(value, sd) == text
    assert str(Estimate(value, "ml", sd=sd)) == f"{text} ml"
