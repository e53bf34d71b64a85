"""Every fitter holds the common checks, and every check finds a fitter that does not."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from fitter_checks import CHECKS, Fitter
from fitters_made import FITTERS, at_rest
from shapes_made import even_directions

import quadriform as qf
from quadriform.point_sets import precision_loss


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", FITTERS)
def test_every_fitter_holds_the_common_checks(name, check):
    check(FITTERS[name])


@dataclass(frozen=True)
class Ball:
    """A ball about the middle of the points, the simplest fitter there is."""

    centre: np.ndarray
    radius: float
    rows: np.ndarray
    warnings: dict = field(default_factory=dict)

    @property
    def status(self):
        return "warned" if self.warnings else "ok"


def ball(clouds):
    given = clouds[0]
    points = np.array(given, dtype=float, order="C")
    centre = points.mean(axis=0)
    distances = np.linalg.norm(points - centre, axis=1)
    return Ball(centre, distances.mean(), distances - distances.mean(), precision_loss(given, points))


def surface(found):
    ball = qf.Superquadric(semi_axes=[found.radius] * 3, translation=found.centre)
    return [(at_rest(ball), "surface")]


NEARLY_ROUND = np.roll(even_directions(150), 40, axis=0) * [3.0, 3.0, 3.1] + [1, 2, 3]
HONEST = Fitter([NEARLY_ROUND], ball, surface, lambda found: [found.rows])


def keeps_its_input(clouds):
    found = ball(clouds)
    return replace(found, rows=np.asarray(clouds[0])[:, 0])


def writes_into_its_input(clouds):
    found = ball(clouds)
    clouds[0][0, 0] += 1
    return found


def draws(clouds):
    found = ball(clouds)
    return replace(found, radius=found.radius * (1 + 1e-12 * np.random.standard_normal()))


def believes_the_first_point(clouds):
    found = ball(clouds)
    return replace(found, radius=np.linalg.norm(np.asarray(clouds[0], dtype=float)[0] - found.centre) * 1.001)


def rows_from_the_end(clouds):
    found = ball(clouds)
    return replace(found, rows=np.sort(found.rows))


def prefers_an_axis(clouds):
    found = ball(clouds)
    return replace(found, radius=np.abs(np.asarray(clouds[0], dtype=float) - found.centre)[:, 2].mean() * 2)


def knows_a_unit(clouds):
    found = ball(clouds)
    return replace(found, radius=found.radius + 1e-4)


def hears_the_memory_order(clouds):
    found = ball(clouds)
    return replace(found, radius=found.radius * (1 + 1e-9 * (not np.asarray(clouds[0]).flags.c_contiguous)))


def works_in_single_precision(clouds):
    short = getattr(clouds[0], "dtype", float) == np.float32
    found = ball(clouds)
    return replace(found, radius=found.radius * (1 + 1e-4 * short))


def doubles_the_ball(clouds):
    found = ball(clouds)
    return replace(found, radius=2 * found.radius)


def is_silent(clouds):
    return replace(ball(clouds), warnings={})


def names_no_kind(clouds):
    found = ball(clouds)
    return replace(found, warnings={str(kind): text for kind, text in found.warnings.items()})


def says_nothing_more(clouds):
    return replace(ball(clouds), warnings=dict.fromkeys(ball(clouds).warnings, ""))


def leans_on_silence(clouds):
    np.float64(1e-300) * np.float64(1e-300)
    return ball(clouds)


BROKEN = {
    keeps_its_input: "twice_is_the_same_and_the_input_is_left_alone",
    writes_into_its_input: "twice_is_the_same_and_the_input_is_left_alone",
    draws: "twice_is_the_same_and_the_input_is_left_alone",
    believes_the_first_point: "order_does_not_matter",
    rows_from_the_end: "order_does_not_matter",
    prefers_an_axis: "surfaces_move_with_their_points_also_mirrored_and_in_another_unit",
    knows_a_unit: "surfaces_move_with_their_points_also_mirrored_and_in_another_unit",
    hears_the_memory_order: "dress_does_not_matter",
    works_in_single_precision: "single_precision_is_near",
    doubles_the_ball: "surfaces_are_near_their_points",
    is_silent: "warnings_are_named",
    names_no_kind: "warnings_are_named",
    says_nothing_more: "warnings_are_named",
    leans_on_silence: "callers_may_let_numpy_raise",
}


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_a_ball_is_a_fitter(check):
    check(HONEST)
    assert check.__name__ in BROKEN.values()


@pytest.mark.parametrize("fit", BROKEN, ids=lambda fit: fit.__name__)
def test_what_is_no_fitter_fails_its_check(fit):
    (check,) = (each for each in CHECKS if each.__name__ == BROKEN[fit])
    with pytest.raises((AssertionError, FloatingPointError)):
        check(replace(HONEST, fit=fit))
