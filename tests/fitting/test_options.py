"""Choices of a refinement are checked once, and refused by name."""

import numpy as np
import pytest
from shapes_made import lumpy, made

import quadriform as qf
from quadriform.errors import OptionError, PointsError
from quadriform.fitting.options import PaperOptions, TangentOptions, options_for, scaled_base

CLOUD = lumpy(200)


@pytest.mark.parametrize(
    ("method", "option"),
    [
        ("paper", {"robust": False}),
        ("paper", {"base": CLOUD}),
        ("paper", {"max_error": 1.0}),
        ("tangent", {"matching": "data-to-model"}),
        ("tangent", {"iterations": 3}),
        ("tangent", {"tolerance": 1e-3}),
    ],
)
def test_options_of_the_other_method_are_refused_by_name(method, option):
    name = next(iter(option))
    for door in (lambda **given: qf.fit(CLOUD, **given), lambda **given: qf.refine(made(), CLOUD, **given)):
        with pytest.raises(OptionError, match=f"option {name} is not one of method='{method}'; expected box"):
            door(method=method, **option)


@pytest.mark.parametrize(("name", "hint"), [("bix", "did you mean box"), ("q", "expected one of points, kind, method")])
def test_an_unknown_option_is_refused_with_the_nearest_one(name, hint):
    with pytest.raises(OptionError, match=f"option {name} is unknown; {hint}"):
        qf.fit(CLOUD, **{name: 3})
    for call in (lambda **given: qf.refine(made(), CLOUD, **given), lambda **given: qf.track([CLOUD] * 2, **given)):
        with pytest.raises(OptionError, match=f"option {name} is unknown"):
            call(**{name: 3})


def test_the_defaults_of_a_method_may_be_given_as_none():
    """As a program does that passes on what its user said."""
    for method in ("paper", "tangent"):
        nothing = dict.fromkeys(("regularity", "robust", "base", "matching", "iterations", "tolerance"))
        assert options_for(method, nothing) == options_for(method, {})


def test_weights_are_not_the_papers():
    with pytest.raises(OptionError, match=r"weights .*method='paper'"):
        qf.fit(CLOUD, method="paper", weights=np.ones(len(CLOUD)))


BAD = [
    ({"box": (5, 5)}, "box"),
    ({"box": (5, 5, 1)}, "box"),
    ({"box": (5, 5, 21)}, "box"),
    ({"box": 5}, "box"),
    ({"box": (5, 5.0, 5)}, "box"),
    ({"box": "auto"}, "max_error"),
    ({"max_error": 1.0}, "max_error"),
    ({"box": "auto", "max_error": -1.0}, "max_error"),
    ({"box": "auto", "max_error": 0}, "max_error=0 is out of range; expected a number above 0"),
    ({"box": "auto", "max_error": np.nan}, "max_error"),
    ({"regularity": "svd"}, "regularity"),
    ({"regularity": "bends"}, "regularity"),
    ({"strength": -1.0}, "strength"),
    ({"strength": np.nan}, "strength"),
    ({"strength": "car"}, "strength"),
    ({"base": (np.zeros(3), np.zeros(3))}, "base"),
    ({"base": CLOUD[:2]}, "base"),
]


@pytest.mark.parametrize(("option", "name"), BAD, ids=[f"{k}-{name}" for k, (_, name) in enumerate(BAD)])
def test_values_out_of_their_range_are_refused_by_name(option, name):
    with pytest.raises(OptionError, match=name) as caught:
        qf.refine(made(), CLOUD, **option)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "call",
    [lambda: qf.refine(made(), CLOUD, method="paper", box="auto"), lambda: qf.track([CLOUD] * 2, box="auto")],
    ids=["paper", "cycle"],
)
def test_a_box_that_is_chosen_is_not_offered_where_there_is_none(call):
    with pytest.raises(OptionError, match=r"box='auto' is out of range; expected three whole numbers from 2 to 20$"):
        call()


def test_counts_may_be_whole_numbers_of_numpy():
    assert PaperOptions(iterations=np.int64(3)).iterations == 3
    for count in (np.float64(3), np.bool_(True), np.int64(0)):
        with pytest.raises(OptionError, match="iterations"):
            PaperOptions(iterations=count)


@pytest.mark.parametrize("base", [np.full((4, 3), np.nan), np.ones((4, 2)), (np.zeros(3), np.array([0, np.inf, 1]))])
def test_a_base_of_no_numbers_is_refused(base):
    with pytest.raises(PointsError, match="base"):
        qf.refine(made(), CLOUD, base=base)


def test_an_unknown_method_is_refused():
    with pytest.raises(OptionError, match=r"method='best'.*'tangent', 'paper'"):
        qf.fit(CLOUD, method="best")


def test_each_method_has_its_own_options():
    assert isinstance(options_for("paper", {"iterations": 3}), PaperOptions)
    chosen = options_for("tangent", {"box": [3, 4, 5]})
    assert isinstance(chosen, TangentOptions) and chosen.box == (3, 4, 5)


def test_a_loop_is_the_plane_through_it():
    """A wobble-free ring above the cloud: its middle, and the direction away from the cloud."""
    t = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    direction = np.array([1.0, 2, 2]) / 3
    first = np.array([2.0, -1, 0]) / np.sqrt(5)
    ring = CLOUD.mean(axis=0) + 30 * direction
    ring = ring + 12 * (np.cos(t)[:, None] * first + np.sin(t)[:, None] * np.cross(direction, first))
    plane = (CLOUD.mean(axis=0) + 30 * direction, 7 * direction)
    for base in (ring, ring[::-1], plane):
        found = TangentOptions(base=base).base_plane({"surface": CLOUD})
        np.testing.assert_allclose(found.direction, direction, atol=1e-12)
        np.testing.assert_allclose(found.point, plane[0], atol=1e-9)
    below = TangentOptions(base=2 * CLOUD.mean(axis=0) - ring).base_plane({"surface": CLOUD})
    np.testing.assert_allclose(below.direction, -direction, atol=1e-12)
    assert TangentOptions().base_plane({"surface": CLOUD}) is None


def test_a_box_to_go_on_from_is_not_the_papers():
    with pytest.raises(OptionError, match=r"start .*method='paper'"):
        qf.refine(made(), CLOUD, method="paper", start=qf.refine(made(), CLOUD, box=(2, 2, 2)).model.box)


def test_weights_have_the_names_of_the_points():
    with pytest.raises(OptionError, match=r"weights \['epi'\] and points \['endo'\]"):
        qf.fit({"endo": CLOUD}, weights={"epi": np.ones(len(CLOUD))})


def test_two_surfaces_with_the_same_points_have_no_wall():
    clouds = {"endo": CLOUD, "epi": CLOUD.copy()}
    for call in (lambda: qf.fit(clouds), lambda: qf.track([clouds, clouds])):
        with pytest.raises(PointsError, match=r"'endo' and 'epi' have the same .* no wall between them"):
            call()


def test_lengths_of_a_base_are_scaled_and_its_direction_is_not():
    point, direction = scaled_base(([1, 2, 3], (0, 0, 2)), 1000.0)
    assert point.tolist() == [1000, 2000, 3000] and direction == (0, 0, 2)
    loop = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
    np.testing.assert_array_equal(scaled_base(loop, 0.1), 0.1 * loop)
    assert scaled_base(None, 7.0) is None and scaled_base(loop, 1) is loop
    with pytest.raises(PointsError, match="base"):
        scaled_base(([1, 2], (0, 0, 2)), 10.0)
