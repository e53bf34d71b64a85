"""The multi-start search of the robust superquadric: many starts on few points, the best of them on all.

Coarse to fine: candidates are annealed and compared on a small even sample (each k-th point by distance from the
centroid), and the distinct best ones again on a larger one. A wider search from parts of the cloud follows only where
the best is not accepted (`acceptable`). In this module `sampled` is the problem of the largest sample, from which all
others are taken until the final descent. Starts from boxes around the inliers of the best are then compared with it
(`restarts`). The best, with its alternatives, continues on larger samples and converges on all points.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.cloud import best_first, nearest
from quadriform.fitting.connected import unconnected
from quadriform.fitting.diagnostics import INLIER
from quadriform.fitting.mixture import LARGEST_RATIO, Mixture, all_inliers, annealed, density_log_odds, estimated
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.diagnostics import COVERED
from quadriform.fitting.superquadric.empty_space import empty_space
from quadriform.fitting.superquadric.initial import (
    START_ROTATIONS,
    bound_of_axes,
    dense_parts,
    ellipsoids,
    neighbour_distance,
    principal_axes,
    sides,
    starts_not_radial,
)
from quadriform.fitting.superquadric.levenberg_marquardt import Descent
from quadriform.fitting.superquadric.problem import SearchProblem
from quadriform.fitting.superquadric.restarts import RESTART, restarts
from quadriform.fitting.superquadric.search_settings import SEARCH
from quadriform.fitting.support import covered_fraction
from quadriform.points import Array
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.superquadric import Superquadric

Estimated = tuple[Candidates, Mixture]
"""Candidates with their mixtures."""
UPRIGHT = START_ROTATIONS[::3]
"""Of each half of `START_ROTATIONS` the first: the principal axes as they are, and these rotated by 45 degrees about
z."""
ENOUGH_PAIRS = (4 / (1 - SEARCH.least_independent)) ** 2
"""Least number of pairs for a conclusion: independent distances of so many look correlated once in 30,000 (4 sigma)."""


@dataclass(frozen=True)
class SearchResult:
    """The result of a search.

    Attributes:
        descent: that of the best candidate, at its end.
        converged: whether it converged.
        n_alternatives: number of other surfaces that explain the points equally well.
    """

    descent: Descent
    converged: bool
    n_alternatives: int


def em(descent: Descent) -> Mixture:
    """The mixture re-estimated, with sigma within the bounds of the problem."""
    problem = descent.problem
    found = estimated(descent.distances, descent.inliers, descent.weights, problem.n_estimated)
    return replace(found, sigma=np.clip(found.sigma, problem.least_sigma, problem.largest_sigma))


def solve(problem: SearchProblem) -> SearchResult:
    """The superquadric of points, of which some may be outliers or of other bodies, where parts of it may have none.

    1. The narrow search, with starts from two dense parts of the cloud.
    2. Where its best candidate is not accepted: the wide search, also with starts from parts on one side of a plane,
       for the dense parts may contain more than one body.
    3. Where the best has outliers and is not known to be noisy: a search for a surface through all points, for exact
       points that are sampled unevenly may look like outliers. If it finds one, its descent on all points is the
       result. Viewpoints and support are then not used: points without noise determine their surface alone.
    4. Where it has outliers: the log odds of each point by its density, for outliers are sparse.
    5. Where viewpoints or a support are known: the empty space around the inliers, a penalty in all further steps.
    6. Restarts from boxes around the inliers, for a surface may be too long where points are on one side only.
    7. The descent of the best and its alternatives on all points.

    Steps 2 and 3, and the restarts of step 6, are only for kinds whose surface lies around their centre (`is_radial`).
    """
    sampled = problem.sample(SEARCH.density_points)
    parts = dense_parts(sampled.points)
    core = parts[0] > 0
    longest = bound_of_axes(sampled.points[core])
    problem, sampled = replace(problem, longest=longest), replace(sampled, longest=longest)
    starts = annealed_starts(sampled, parts, orientations(sampled, parts, START_ROTATIONS), SEARCH.coarse)
    found = compared(sampled, starts, SEARCH.kept, None)
    accepted = acceptable(found)
    if KINDS[problem.kind].is_radial and not accepted[best_first(found.scores())[0]]:
        found = wider(sampled, np.concatenate([parts, sides(sampled.points, core)]), found)
        accepted = acceptable(found)
    best = best_first(_ranking(found, accepted))[:1]
    if found.mixture.inlier_ratio[best[0]] < LARGEST_RATIO:
        noisy = accepted[best[0]] and found.mixture.sigma[best[0]] > SEARCH.maybe_exact
        if not noisy and (exact := through_all_points(sampled)):
            return _final_descent(problem, exact, 0)
        problem = _with_density_log_odds(problem, found.picked(best))
    problem, found = _restarted_with_connected(_with_empty_space(problem, found.picked(best)), found)
    alternatives = _alternatives(found, _ranking(found, acceptable(found)))
    return _final_descent(problem, found.picked(alternatives), len(alternatives) - 1)


def best_of_descents(problem: SearchProblem, starts: list[Superquadric]) -> Superquadric:
    """The best surface that descents from given starts reach on a sample, without a search and to about two digits."""
    sampled = problem.sample(SEARCH.fine)
    sampled = replace(sampled, longest=bound_of_axes(sampled.points))
    candidates = sampled.with_fixed(Candidates.of(starts))
    # as many steps as annealing has, but with all points as inliers, for the starts are near already
    descent = _with_all_inliers(sampled, candidates, SEARCH.annealing_steps)
    descent.run(SEARCH.most_steps, em, SEARCH.damped_tolerance)
    return descent.candidates.superquadric(int(best_first(descent.scores())[0]))


def _with_all_inliers(problem: SearchProblem, starts: Candidates, steps: int) -> Descent:
    """A descent after steps with nearly all points as inliers."""
    initial = Mixture(np.full(len(starts), LARGEST_RATIO), np.full(len(starts), SEARCH.first_sigma))
    descent = Descent(problem, starts, initial)
    descent.run(steps, lambda d: all_inliers(d.distances, d.weights))
    return descent


def _inliers(problem: SearchProblem, candidate: Candidates, mixture: Mixture) -> Array:
    """Inlier probabilities (n,) of the points of a problem, of one candidate."""
    return Descent(problem, candidate, mixture).inliers[0]


def _with_empty_space(problem: SearchProblem, best: Estimated) -> SearchProblem:
    """The problem with the empty space around the inliers of the best candidate."""
    if problem.surroundings is None:
        return problem
    inlier_mask = _inliers(problem, *best) >= INLIER
    return replace(problem, empty=empty_space(problem.surroundings, problem.points, inlier_mask))


def _with_density_log_odds(problem: SearchProblem, best: Estimated) -> SearchProblem:
    """The problem with the log odds of the points by their density, for a best candidate with outliers."""
    distances = neighbour_distance(problem.points, problem.sample(SEARCH.density_points).points)
    return replace(problem, log_odds=density_log_odds(distances, _inliers(problem, *best)))


def _restarted_with_connected(problem: SearchProblem, found: Descent) -> tuple[SearchProblem, Descent]:
    """The best candidates after restarts, and the problem in which inliers not connected to the others do not count.

    A surface that extends where the body has no data may be so long that it reaches a neighbouring body. The points
    there are then inliers, and keep the surface long, until they are left out.
    """
    found = restarted(problem.sample(SEARCH.density_points), found)
    for _ in range(RESTART.rounds):
        others = _unconnected_inliers(problem, found)
        if not len(others):
            break
        log_odds = problem.log_odds.copy()
        log_odds[others] = SEARCH.never
        problem = replace(problem, log_odds=log_odds)
        found = restarted(problem.sample(SEARCH.density_points), found)
    return problem, found


def _unconnected_inliers(problem: SearchProblem, found: Descent) -> NDArray[np.int64]:
    """Indices of inliers of the best candidate that are not connected to the others; none of a covered surface."""
    candidate, mixture = _best_by_ranking(found)
    inlier_index = np.flatnonzero(_inliers(problem, candidate, mixture) >= INLIER)
    surface, points = candidate.superquadric(0), problem.points[inlier_index]
    if covered_fraction(surface, points) >= COVERED:
        return inlier_index[:0]
    return inlier_index[unconnected(points)]


def wider(sampled: SearchProblem, parts: Array, earlier: Descent) -> Descent:
    """The comparison after a search from many parts, and one from the inliers of its best along their own axes."""
    of_parts = annealed_starts(sampled, parts, orientations(sampled, parts, UPRIGHT), SEARCH.coarse_wide)
    chosen, mixture = of_parts.picked(distinct(of_parts, of_parts.scores(), SEARCH.kept_wide))
    inliers = Descent(sampled, chosen, mixture).inliers
    rotations = chosen.rotations[:, None] @ START_ROTATIONS
    of_inliers = annealed_starts(sampled, inliers, rotations, SEARCH.coarse_wide)
    return compared(sampled, of_inliers, SEARCH.kept_wide, earlier)


def through_all_points(sampled: SearchProblem) -> Estimated | None:
    """A superellipsoid that passes through every point of a sample exactly, if one is found.

    The search may take exact points that are sampled unevenly for outliers. Here all are inliers, and starts are made
    in the axes of the whole cloud and then, twice, in those of the best results.
    """
    if not KINDS[sampled.kind].is_radial:
        return None
    subset = sampled.sample(SEARCH.coarse)
    rotations = orientations(sampled, np.ones((1, len(sampled.points))), START_ROTATIONS)
    for _ in range(SEARCH.exact_rounds):
        made = ellipsoids(subset.points, np.tile(subset.weights, (len(rotations), 1)), rotations)
        descent = _with_all_inliers(subset, subset.with_fixed(made), SEARCH.maybe_exact_steps)
        # all points are inliers here, so the candidate of the least sigma has the largest likelihood
        best = distinct(descent, -descent.mixture.sigma, SEARCH.kept_wide)
        if descent.mixture.sigma[best[0]] < SEARCH.exact:
            return descent.picked(best[:1])
        if descent.mixture.sigma[best[0]] > SEARCH.maybe_exact:
            break
        rotations = descent.candidates.rotations[best, None] @ START_ROTATIONS
    return None


def restarted(sampled: SearchProblem, found: Descent) -> Descent:
    """The best candidates on the whole sample, with those that start from boxes around the inliers of the best.

    They are compared with the best at a sigma of at most its own. Restarts are to find where a surface ends without
    data; which of several surfaces the points belong to, such as two walls, the annealed search has decided.
    """
    found = _on_all(sampled, *found.picked(distinct(found, _ranking(found, acceptable(found)), SEARCH.kept)))
    for _ in range(RESTART.rounds if KINDS[sampled.kind].is_radial else 0):
        best, mixture = _best_by_ranking(found)
        inliers = _inliers(sampled, best, mixture)
        if covered_fraction(best.superquadric(0), sampled.points[inliers >= INLIER]) >= COVERED:
            break  # points on all sides determine the size
        others, their_mixture = _from_boxes(sampled, inliers, best, mixture)
        # the true extent explains the points with no more noise; a surface between two walls would, with all as inliers
        at_most = replace(sampled, largest_sigma=float(mixture.sigma[0]))
        found = _on_all(at_most, best.joined(others), mixture.joined(their_mixture))
        if best_first(_ranking(found, acceptable(found)))[0] == 0:
            break  # none of the restarts is better
    return found


def _on_all(sampled: SearchProblem, candidates: Candidates, mixture: Mixture) -> Descent:
    descent = Descent(sampled, candidates, mixture)
    descent.run(SEARCH.compare_steps, em, SEARCH.damped_tolerance)
    return descent


def _from_boxes(sampled: SearchProblem, inliers: Array, candidate: Candidates, mixture: Mixture) -> Estimated:
    """The distinct candidates, on a sample, that start from boxes around the inliers of a candidate."""
    boxes = restarts(sampled.points, inliers, candidate.rotations[0])
    sample, repeated = sampled.sample(SEARCH.fine), mixture.take(np.zeros(len(boxes), dtype=np.int64))
    wide = replace(repeated, sigma=RESTART.larger_sigma * repeated.sigma)
    descent = Descent(sample, sample.with_fixed(boxes), wide)
    descent.run(RESTART.steps, em, SEARCH.damped_tolerance)
    return descent.picked(distinct(descent, descent.scores(), len(boxes)))


def annealed_starts(sampled: SearchProblem, parts: Array, rotations: Array, most: int) -> Descent:
    """The descent of starts from weighted parts (H, n) of a sample after annealing and EM, on `most` points.

    Args:
        sampled: the problem of n points.
        parts: weights of these points, a row for each part.
        rotations: (H, k, 3, 3), of the k starts of each part.
        most: points of the sample.
    """
    index = sampled.thinned(most)
    subset = replace(sampled.sample(most), size=0.0)
    made, part = _starts(sampled, parts, rotations)
    starts = subset.with_fixed(made)
    own = (np.maximum(parts[:, index], SEARCH.elsewhere) * subset.weights)[part]
    sizes = np.sqrt(np.exp(2 * starts.log_axes).mean(axis=1))  # RMS radius of the part
    initial = Mixture(np.full(len(starts), LARGEST_RATIO), SEARCH.first_sigma * sizes)
    descent = Descent(subset, starts, initial, own)
    descent.run(SEARCH.own_steps, lambda d: all_inliers(d.distances, d.weights))
    wide = Mixture(descent.mixture.inlier_ratio, np.minimum(descent.mixture.sigma, SEARCH.first_sigma * sizes))
    descent = Descent(subset, descent.candidates, wide)
    descent.run(SEARCH.annealing_steps, lambda d: annealed(d.mixture, sizes))
    descent.run(SEARCH.em_steps, em, SEARCH.comparison_tolerance)
    return descent


def _starts(sampled: SearchProblem, parts: Array, rotations: Array) -> tuple[Candidates, NDArray[np.int64]]:
    """The M starts, and the index (M,) of the part from which each is made: the first unless the kind is radial."""
    if not KINDS[sampled.kind].is_radial:
        found = starts_not_radial(sampled.points[parts[0] > 0], sampled.kind)
        return found, np.zeros(len(found), dtype=np.int64)
    found = ellipsoids(sampled.points, parts * sampled.weights, rotations)
    return found, np.arange(len(parts)).repeat(rotations.shape[1])


def orientations(sampled: SearchProblem, parts: Array, rotations: Array) -> Array:
    """The principal axes of each of H parts under k rotations, (H, k, 3, 3); or only the fixed rotation, if any."""
    rotation = sampled.fixed.get("rotation")
    if rotation is not None:
        return np.broadcast_to(rotation, (len(parts), 1, 3, 3))
    return principal_axes(sampled.points, parts * sampled.weights)[:, None] @ rotations


def compared(sampled: SearchProblem, descent: Descent, kept: int, earlier: Descent | None) -> Descent:
    """The descent of the distinct best candidates, and of those of an earlier comparison, on a larger sample."""
    candidates, mixture = descent.picked(distinct(descent, descent.scores(), kept))
    if earlier is not None:
        candidates, mixture = candidates.joined(earlier.candidates), mixture.joined(earlier.mixture)
    descent = Descent(sampled.sample(SEARCH.fine), candidates, mixture)
    descent.run(SEARCH.compare_steps, em, SEARCH.comparison_tolerance)
    return descent


def distinct(descent: Descent, ranking: Array, most: int) -> NDArray[np.int64]:
    """Indices of at most `most` candidates, the best first, no two of them the same surface at the points."""
    chosen: list[int] = []
    for index in best_first(ranking):
        sigma = SEARCH.same * descent.mixture.sigma[index]
        weight = descent.inliers[index]
        # two candidates are the same surface when their distances agree at the inliers
        differences = descent.distances[chosen] - descent.distances[index]
        if not ((differences**2 @ weight) < sigma**2 * weight.sum()).any():
            chosen.append(int(index))
        if len(chosen) == most:
            break
    return np.array(chosen)


def acceptable(descent: Descent) -> NDArray[np.bool_]:
    """A mask (M,) of the accepted candidates: at least half of the points are inliers, and their noise is independent.

    Distances of neighbours are compared by half of von Neumann's ratio, the sum over pairs of (d_i - d_j)^2 over the
    sum of d_i^2 + d_j^2. It is one for independent noise, and less where the surface is not that of the points, so that
    neighbours have similar distances. It must be above `least_independent`; edges under strong noise alone give about
    0.6. Where sigma is below `exact`, distances are rounding and may be correlated.
    """
    near, counts = nearest(descent.points, descent.points, 2)
    point, rank = counts[:, 1:].nonzero()  # on a lattice several neighbours are at the same distance
    neighbour, weights = near[point, rank + 1], descent.weights / counts[:, 1:].sum(axis=1)
    pair = descent.inliers[:, point] * descent.inliers[:, neighbour] * weights[point]
    own, other = descent.distances[:, point], descent.distances[:, neighbour]
    difference, both = ((pair * (own - other) ** 2).sum(axis=1), (pair * (own**2 + other**2)).sum(axis=1))
    independent = (pair.sum(axis=1) > ENOUGH_PAIRS) & (difference > SEARCH.least_independent * both)
    return (descent.mixture.inlier_ratio >= SEARCH.majority) & (independent | (descent.mixture.sigma < SEARCH.exact))


def _ranking(descent: Descent, accepted: NDArray[np.bool_]) -> Array:
    """Scores (M,), with a bonus for accepted candidates.

    The likelihood takes correlated distances for independent ones, and so prefers candidates that are not accepted.
    """
    return descent.scores() + SEARCH.acceptance_bonus * descent.weights.sum() * accepted


def _best_by_ranking(descent: Descent) -> Estimated:
    """The best candidate by `_ranking`."""
    return descent.picked(best_first(_ranking(descent, acceptable(descent)))[:1])


def _alternatives(descent: Descent, ranking: Array) -> NDArray[np.int64]:
    """Indices of the best candidate and of those within `alternative` of its cost."""
    index = distinct(descent, ranking, SEARCH.kept_wide)
    # log likelihood falls by n / 2 times the relative growth of sigma squared
    margin = SEARCH.alternative / 2 * descent.inliers[index[0]].sum()
    return index[ranking[index] >= ranking[index[0]] - margin]


def _final_descent(problem: SearchProblem, start: Estimated, n_alternatives: int) -> SearchResult:
    """The result of descents on larger and larger samples, then on all points.

    Of alternatives the best on the first sample continues; without a sample, the best on all points after the damped
    steps.
    """
    # most steps are made on few points
    size = SEARCH.fine * SEARCH.growth
    while size * 2 < len(problem.points):
        descent = Descent(problem.sample(size), *start)
        descent.run(SEARCH.sample_steps, em, SEARCH.sample_tolerance)
        start = _best_by_score(descent)
        size *= SEARCH.growth
    descent = Descent(problem, *start)
    descent.run(SEARCH.most_steps, em, SEARCH.damped_tolerance)
    descent = descent if len(start[0]) == 1 else Descent(problem, *_best_by_score(descent))
    converged = descent.converge(SEARCH.most_steps, em, SEARCH.final_tolerance) or descent.run(
        SEARCH.most_steps, em, SEARCH.crease_tolerance
    )
    return SearchResult(descent, converged, n_alternatives)


def _best_by_score(descent: Descent) -> Estimated:
    return descent.picked(best_first(descent.scores())[:1])
