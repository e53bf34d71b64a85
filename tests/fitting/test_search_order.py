"""The order of the search for a superquadric, by stand-ins whose candidates are accepted or not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import even_directions, made

from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric import multistart
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.initial import bound_of_axes
from quadriform.fitting.superquadric.problem import SearchProblem

POINTS = even_directions(60)


def problem(kind="ellipsoid"):
    return SearchProblem(POINTS, np.ones(60), kind, {}, np.zeros(60), np.ones(60))


def found(ratio=0.9, sigma=0.1, accepted=True, scores=(1.0,)):
    """What a comparison ends with."""
    n = len(scores)
    return SimpleNamespace(
        mixture=Mixture(np.full(n, ratio), np.full(n, sigma)),
        scores=lambda: np.array(scores),
        weights=np.ones(60),
        accepted=np.broadcast_to(accepted, n),
        picked=lambda index: (f"candidate {list(map(int, index))}", "mixture"),
    )


def searched(monkeypatch, narrow, wide=None, exact=None, kind="ellipsoid"):
    """The steps that `solve` makes with given results, and how it ends."""
    log = []

    def note(name, result):
        return lambda *of, **more: log.append(name) or result

    def bounded(of):
        if of != "by density":
            log.append("even odds")
        return "bounded"

    parts = np.stack([np.arange(60) < 50, np.arange(60) < 9]).astype(float)
    monkeypatch.setattr(multistart, "dense_parts", lambda points: parts)
    monkeypatch.setattr(
        multistart, "orientations", lambda cloud, parts, rotations: (len(parts), len(rotations), cloud.longest)
    )
    monkeypatch.setattr(
        multistart, "annealed_starts", lambda cloud, parts, rotations, most: log.append((len(parts), most, rotations))
    )
    monkeypatch.setattr(
        multistart, "compared", lambda cloud, starts, kept, earlier: log.append((kept, earlier)) or narrow
    )
    monkeypatch.setattr(multistart, "wider", lambda cloud, parts, earlier: log.append(("wider", len(parts))) or wide)
    monkeypatch.setattr(multistart, "through_all_points", note("exact", exact))
    monkeypatch.setattr(multistart, "acceptable", lambda best: best.accepted)
    monkeypatch.setattr(
        multistart,
        "_with_empty_space",
        lambda p, best: ((p == "by density" or log.append("even odds")) and 0) or "bounded",
    )
    monkeypatch.setattr(multistart, "_with_density_log_odds", lambda p, best: log.append(best[0]) or "by density")
    monkeypatch.setattr(multistart, "_restarted_with_connected", lambda p, best: log.append(p) or (p, best))
    monkeypatch.setattr(multistart, "_alternatives", lambda best, ranking: np.array([0, 1]))
    monkeypatch.setattr(multistart, "_final_descent", lambda p, start, others: (p, start, others))
    return multistart.solve(problem(kind)), log


ORDERED = POINTS[problem().thinned(60)]
NARROW = [(2, 160, (2, 6, bound_of_axes(ORDERED[:50]))), (4, None)]
"""Starts in the frames of two parts, no axis longer than those of the first part allow."""


def test_an_accepted_surface_of_all_points_needs_no_more():
    with pytest.MonkeyPatch.context() as patch:
        end, log = searched(patch, found(ratio=0.999))
    assert log == [*NARROW, "even odds", "bounded"]
    assert end == ("bounded", ("candidate [0, 1]", "mixture"), 1)


@pytest.mark.parametrize(("sigma", "looks"), [(0.021, False), (0.019, True)])
def test_outliers_beside_little_noise_may_be_exact_points(sigma, looks):
    with pytest.MonkeyPatch.context() as patch:
        end, log = searched(patch, found(0.9, sigma))
        assert log == [*NARROW, *(["exact"] if looks else []), "candidate [0]", "bounded"]
        _, log = searched(patch, found(0.9, sigma), exact="exact one")
        assert ("exact" in log) == looks
    assert end[0] == "bounded"


def test_a_surface_through_all_points_ends_the_search():
    with pytest.MonkeyPatch.context() as patch:
        end, log = searched(patch, found(0.9, 0.01), exact="exact one")
        assert end[1:] == ("exact one", 0) and log == [*NARROW, "exact"]
        # one that is not accepted is looked at whatever its noise
        rejected = found(0.9, 0.5, accepted=False)
        end, log = searched(patch, rejected, rejected, exact="exact one")
        assert end[1:] == ("exact one", 0)


def test_where_the_best_is_not_accepted_many_parts_are_tried():
    better = found(0.999, scores=(1.0, 5.0), accepted=[True, False])
    with pytest.MonkeyPatch.context() as patch:
        _, log = searched(patch, found(0.9, accepted=False), better)
        assert log[:3] == [*NARROW, ("wider", 28)]
        _, log = searched(patch, better, found(0.999))  # the highest score decides, not the bonus
        assert ("wider", 28) in log
        _, log = searched(patch, found(0.9, accepted=False), kind="toroid")
        assert ("wider", 28) not in log


def test_accepted_candidates_come_first_within_a_tenth_for_each_point():
    chosen = []
    best = found(0.9, scores=(1.0, 6.9), accepted=[True, False])
    best.picked = lambda index: chosen.append(index.tolist()) or ("c", "m")
    best.accepted = np.array([True, False])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(multistart, "wider", lambda cloud, parts, earlier: best)
        searched(patch, best, best)
    assert chosen[0] == [0]  # 1 + 6 against 6.9


def test_restarts_go_on_while_one_of_them_is_better(monkeypatch):
    """Of a surface that is not covered; at most four times."""
    log, firsts = [], iter([1, 1, 0, 1])
    body = Candidates.of([replace(made(exponents=(1, 1)), translation=np.zeros(3))])
    mixture = Mixture(np.array([0.9]), np.array([0.1]))

    class On:
        weights = np.ones(60)

        def __init__(self, first=0):
            self.first, self.mixture = first, mixture

        def scores(self):
            return np.array([0.0, 1.0]) if self.first else np.array([1.0, 0.0])

        def picked(self, index):
            return body, mixture

    monkeypatch.setattr(multistart, "acceptable", lambda best: np.array([True, True]))
    monkeypatch.setattr(multistart, "distinct", lambda *of: np.array([0]))
    monkeypatch.setattr(
        multistart,
        "_on_all",
        lambda cloud, c, m: log.append((len(c), cloud.largest_sigma)) or On(next(firsts) if len(log) > 1 else 0),
    )
    monkeypatch.setattr(multistart, "_from_boxes", lambda cloud, inliers, c, m: (body, mixture))
    monkeypatch.setattr(multistart, "covered_fraction", lambda surface, points: covered)
    covered = 0.5
    multistart.restarted(problem(), On())
    assert log == [(1, np.inf), *3 * [(2, 0.1)]]  # the third is no better; none may have more noise than the best
    log.clear()
    firsts = iter([1] * 9)
    multistart.restarted(problem(), On())
    assert log == [(1, np.inf), *4 * [(2, 0.1)]]
    for value, kind in ((0.85, "ellipsoid"), (0.5, "toroid")):
        log.clear()
        covered = value
        multistart.restarted(problem(kind), On())
        assert log == [(1, np.inf)]
