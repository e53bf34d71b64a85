"""The rounds of a cycle on a stand-in whose states are numbers: how many, at which strengths, and when they end."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from quadriform.errors import DegenerateError, OptionError
from quadriform.motion import cycle_rounds
from quadriform.motion.cycle_rounds import ROUNDS


@dataclass(frozen=True)
class State:
    """A state that knows its number of steps."""

    sigma: float = 1.0
    fraction: float = 1.0
    steps: int = 0
    boxes: tuple = (0, 0)
    datasets: tuple = ()
    start: str = "smooth"
    slices: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(with_prior_of=lambda other: other))
    estimates: int = 0

    def nearest(self):
        return self

    def with_estimated_prior(self):
        return replace(self, estimates=self.estimates + 1)


class Counted:
    """A cycle whose rounds are recorded; the noise of each is given."""

    in_space = SimpleNamespace(first_factor=100.0)

    def __init__(self, noises=(), fails_at=None, verified_at=None):
        self.noises, self.fails_at, self.verified_at = list(noises), fails_at, verified_at
        self.log, self.searches, self.fractions, self.spaces, self.widenings = [], [], [], [], []

    def step(self, state, strengths, widening=1.0):
        self.log.append(strengths)
        self.widenings.append(widening)
        if self.fails_at is not None and len(self.log) > self.fails_at:
            return None
        sigma = self.noises.pop(0) if self.noises else state.sigma
        return replace(state, sigma=sigma, steps=state.steps + 1)

    def strength_in_space(self, state, frames, near, before_rounds=False):
        self.spaces.append((near, before_rounds))
        return 2.0 + len(self.spaces)

    def effective_fraction(self, state, before_rounds=False):
        self.fractions.append(before_rounds)
        return 0.25

    def linear_problem(self, state):
        def best_in_time(alpha, gamma):
            self.searches.append((alpha, gamma))
            return 10 * gamma

        return SimpleNamespace(best_in_time=best_in_time)

    def with_checked_folds(self, state):
        verified = self.verified_at is not None and state.steps >= self.verified_at
        return (True, verified), state

    def result(self, state, strengths, verified, before=None):
        self.before = before
        return state, strengths, verified


def report():
    return cycle_rounds.Report(None)


FIRST = 1 / (2 * np.pi) ** 4


def test_strengths_fall_to_their_own_and_are_then_estimated():
    cycle = Counted()
    state, strengths = cycle_rounds._fitted(cycle, State(), (0, 1), None, report())
    factors = [100, 100 ** (2 / 3), 100 ** (1 / 3), 1]
    np.testing.assert_allclose(cycle.log[:4], [(3 * f, FIRST * f) for f in factors])
    np.testing.assert_allclose(cycle.widenings[:4], np.sqrt(factors))
    assert set(cycle.widenings[4:]) == {1.0}
    # six rounds in which the strength in space is estimated, that in time in the first two
    assert [near for near, _ in cycle.spaces] == [None, *np.arange(3.0, 9.0)]
    assert [first for _, first in cycle.spaces] == [True] + [False] * 6
    np.testing.assert_allclose(cycle.log[4:], [(4 + k, FIRST * 10 ** min(k + 1, 2)) for k in range(6)])
    np.testing.assert_allclose(cycle.searches, [(4, FIRST), (5, 10 * FIRST)])
    assert cycle.fractions == [True, False, False] and state.fraction == 0.25
    np.testing.assert_allclose(strengths, (9, 100 * FIRST))
    assert len(cycle.log) == 10 and state.steps == 10
    assert state.estimates == 11  # of the prior of slices, before the rounds and after each


def test_a_given_strength_is_kept():
    cycle = Counted()
    _, strengths = cycle_rounds._fitted(cycle, State(), (0, 1), 7.0, report())
    assert not cycle.spaces and strengths[0] == 7 and all(alpha == 7 for alpha, _ in cycle.log[3:])


@pytest.mark.parametrize(("change", "rounds"), [(0.0049, 6), (0.0051, 16)])
def test_rounds_end_where_the_noise_changes_by_less_than_half_a_per_cent(change, rounds):
    cycle = Counted(np.cumprod(np.full(30, 1 - change)))
    cycle_rounds._fitted(cycle, State(), (0, 1), 1.0, report())
    assert len(cycle.log) == 4 + rounds
    later = Counted([1.0] * 4 + [0.9**k for k in range(8)] + [0.9**7] * 9)
    cycle_rounds._fitted(later, State(), (0, 1), 1.0, report())
    assert len(later.log) == 4 + 9


@pytest.mark.parametrize("alpha", [None, 5.0])
def test_a_round_that_leaves_control_points_undetermined_is_an_error(alpha, monkeypatch):
    monkeypatch.setattr(cycle_rounds, "_affine_images", lambda cycle, undeformed, start, report: State())
    cycle = Counted(fails_at=6)
    cycle.init, cycle.extremes = State, lambda state: (0, 1)
    with pytest.raises(DegenerateError if alpha is None else OptionError, match="undetermined"):
        cycle_rounds.fit_cycle(cycle, cycle_rounds.FromOneFrame("box"), alpha)
    early = Counted(fails_at=2)  # the last state goes on
    state, _ = cycle_rounds._fitted(Counted(), State(), (0, 1), 1.0, report())
    assert cycle_rounds._fitted(early, State(), (0, 1), 1.0, report()) is None and state.steps == 10


FACTORS = np.geomspace(1000, 1, 8)


@pytest.mark.parametrize("at", [0, 3, 14])
def test_folds_are_removed_in_fifteen_rounds_from_the_fit(at):
    cycle = Counted(verified_at=at)
    state, strengths, verified = cycle_rounds._unfolded_fit(cycle, State(), State(), (2.0, 3.0))
    assert cycle.log == [(2, 3)] * at
    assert state.steps == at and strengths == (2, 3) and verified == (True, True) and cycle.before is None
    assert state.estimates == 0


def test_folds_that_stay_are_removed_from_the_first_state_at_decreasing_strengths():
    """Four rounds at each of eight strengths, one of which is enough where nothing folds; then the strengths given."""
    first = State(start="affine")
    cycle = Counted(verified_at=15)
    state, strengths, verified = cycle_rounds._unfolded_fit(cycle, first, State(fraction=0.3), (2.0, 3.0))
    factors = [*np.repeat(FACTORS[:3], 4), *np.repeat(FACTORS[3], 3), *FACTORS[4:]]
    np.testing.assert_allclose(cycle.log[15:], [(2 * f, 3 * f) for f in factors])
    assert (state.start, state.fraction, state.steps) == ("affine", 0.3, len(factors))
    assert strengths == (2, 3) and verified == (True, True)


def test_the_fit_stays_where_no_strength_removes_folds():
    cycle = Counted()
    state, strengths, verified = cycle_rounds._unfolded_fit(cycle, State(), State(), (2.0, 3.0))
    assert len(cycle.log) == 15 + 8 * 4 + 15
    assert strengths == (2, 3) and state.steps == 0 and verified == (True, False)


def test_the_last_strength_is_kept_at_which_nothing_folds():
    """At the strengths themselves only within one and a half times the noise, at larger ones at any."""
    noises = [1.6, *np.full(7, 1.7), 1.6]
    cycle = Counted(noises, verified_at=1)
    state, strengths, verified = cycle_rounds._unfolded_fit(cycle, State(), State(steps=-1), (2.0, 3.0))
    np.testing.assert_allclose(strengths, (2, 3))
    assert state.sigma == 1.6 and verified == (True, True) and cycle.before == 1
    little = Counted([0.024, 0.024], verified_at=2)  # a fortieth of the radius is always accepted
    assert cycle_rounds._unfolded_fit(little, State(), State(0.001), (2.0, 3.0))[0].steps == 2
    fails = Counted(fails_at=0, verified_at=2)
    assert cycle_rounds._unfolded_fit(fails, State(), State(), (2.0, 3.0))[2] == (True, False)


def test_where_nothing_folds_at_larger_strengths_only_the_last_of_them_is_kept():
    """Folds come back at the third of the eight strengths, and stay."""

    class Folds(Counted):
        def with_checked_folds(self, state):
            return (True, bool(self.log) and self.log[-1][0] > 2.001 * FACTORS[2]), state

    cycle = Folds()
    first, folded = State(start="affine"), State(0.3)
    state, strengths, verified = cycle_rounds._unfolded_fit(cycle, first, folded, (2.0, 3.0))
    np.testing.assert_allclose(strengths, (2 * FACTORS[1], 3 * FACTORS[1]))
    assert verified == (True, True) and (state.start, cycle.before) == ("affine", 0.3)


def test_progress_counts_to_the_rounds_that_are_always_made():
    seen = []
    of = cycle_rounds.Report(lambda done, total: seen.append((done, total)))
    for _ in range(18):
        of.round()
    total = ROUNDS.affine_rounds + ROUNDS.falling_rounds + ROUNDS.least_rounds
    assert seen == [(min(k, total), total) for k in range(1, 19)] and total == 16


def test_the_first_strength_in_time_is_that_of_a_sinusoidal_motion():
    assert cycle_rounds._initial_strength_in_time(State(0.3)) == pytest.approx(0.09 / (2 * np.pi) ** 4)
