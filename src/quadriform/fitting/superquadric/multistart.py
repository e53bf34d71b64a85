"""The multi-start search of the robust superquadric: many starts on few points, the best of them on all.

Coarse to fine: candidates are annealed and compared on a small even sample (each k-th point by distance from the
centroid), and the distinct best ones again on a larger one. A wider search from parts of the cloud follows only where
the best is not accepted (`acceptable`). Starts from boxes around the inliers of the best are then compared with it
(`restarts`). The best, with its alternatives, continues on larger samples and converges on all points.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.cloud import best_first, nearest
from quadriform.fitting.connected import unconnected
from quadriform.fitting.diagnostics import INLIER
from quadriform.fitting.mixture import LARGEST_RATIO, Mixture, all_inliers, annealed, density_odds, estimated
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.diagnostics import COVERED
from quadriform.fitting.superquadric.initial import (
    FRAMES,
    bound_of_axes,
    dense_parts,
    ellipsoids,
    other_kind,
    principal_axes,
    reach,
    sides,
)
from quadriform.fitting.superquadric.levenberg_marquardt import Descent
from quadriform.fitting.superquadric.problem import SearchProblem
from quadriform.fitting.superquadric.restarts import RESTART, restarts
from quadriform.fitting.support import covered_fraction
from quadriform.points import Array
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.superquadric import Superquadric


@dataclass(frozen=True)
class SearchSettings:
    """The constants of the search; lengths in RMS radii."""

    cloud: int = 1500
    """Points from which the density is estimated: enough for 9 neighbours to be near."""
    fine: int = 500
    """Points on which the best candidates are compared."""
    coarse: int = 160
    """Points on which all candidates of the narrow search are tried: a dozen for each parameter."""
    coarse_wide: int = 320
    """Points on which those of the wide search are tried, whose parts have only some of them."""
    own_steps: int = 4
    """Steps on the part of the cloud from which a start was made: it moves to that part, and no further."""
    annealing_steps: int = 8
    """Steps while sigma is lowered to a tenth of its first value."""
    em_steps: int = 6
    """Steps with an estimated sigma, until candidates can be compared."""
    compare_steps: int = 8
    """Steps of the comparison on more points."""
    maybe_exact_steps: int = 16
    """Steps with all points as inliers, which must converge to `exact`."""
    growth: int = 16
    """Factor between the sizes of successive samples, until all points are in one."""
    kept: int = 4
    """Distinct candidates that are kept on the larger sample after the narrow search."""
    kept_wide: int = 8
    """Those that are kept after the wide search, which finds more."""
    tolerance: float = 1e-10
    """The last descent ends when no parameter moves more than this."""
    near: float = 1e-2
    """Descents with damped steps end below this; undamped, accelerated steps follow."""
    comparable: float = 1e-4
    """Candidates that move less than this can be compared."""
    all_steps: float = 0.0
    """The tolerance of descents of which every step is made."""
    sample_steps: int = 15
    """Most steps on a sample of the points: the next one begins near its minimum."""
    sampled: float = 1e-6
    """The tolerance of these."""
    exact_rounds: int = 3
    """Rounds of the search for a surface through all points: in the axes of the cloud, and twice in those found."""
    elsewhere: float = 1e-6
    """Weight of the points of other parts, so that every problem has full rank."""
    majority: float = 0.5
    """Least inlier ratio of an accepted candidate."""
    nearly: float = 1e-6
    """The tolerance at a crease, where derivatives are discontinuous and no descent converges."""
    most_steps: int = 40
    """Most steps of one descent, more than convergence takes where there is a minimum."""
    pattern: float = 0.5
    """Largest fraction of the distances' variance that neighbours may have in common in an accepted candidate."""
    acceptance_bonus: float = 0.1
    """Log likelihood per point that is added to that of accepted candidates in a comparison with others."""
    exact: float = 1e-6
    """Noise below this is rounding, of data in single precision too."""
    maybe_exact: float = 0.02
    """Sigma of the best surface above which points are not exact: near exact ones even a wrong surface has less."""
    alternative: float = 0.01
    """Surfaces whose cost, sigma squared, is within this fraction of the best are alternative minima."""
    first_sigma: float = 0.5
    """Largest sigma at the start of annealing, as a fraction of the RMS semi-axis of a start from a part of the cloud;
    in RMS radii of the cloud for starts from all of it."""
    never: float = -100.0
    """Log odds of a point that is of another body."""
    same: float = 0.5
    """Surfaces nearer to each other than this many sigma at the points are one."""


SEARCH = SearchSettings()
UPRIGHT = FRAMES[::3]
"""The first of the frames and its dual."""
ENOUGH_PAIRS = (4 / (1 - SEARCH.pattern)) ** 2
"""Least number of pairs for a conclusion: independent distances of so many look correlated once in 30,000 (4 sigma)."""


@dataclass(frozen=True)
class SearchResult:
    """The result of a search.

    Attributes:
        descent: that of the best candidate, at its end.
        converged: whether it converged.
        alternatives: number of other surfaces that explain the points equally well.
    """

    descent: Descent
    converged: bool
    alternatives: int


def em(descent: Descent) -> Mixture:
    """The mixture re-estimated."""
    count = int((~descent.fixed).sum())
    found = estimated(descent.distances, descent.inliers, descent.weights, count)
    return replace(found, sigma=np.maximum(found.sigma, descent.least_sigma))


def solve(problem: SearchProblem) -> SearchResult:
    """The superquadric of points, of which some may be outliers or of other bodies, where parts of it may have none.

    In this order: the narrow search from two dense parts; the wide search where its best is not accepted; where there
    are outliers, a search for a surface through all points exactly, and else the odds of each point by its density,
    for outliers are sparse; restarts from boxes around the inliers; and the descent of the best and its alternatives.
    """
    cloud = problem.sample(SEARCH.cloud)
    parts = dense_parts(cloud.points)
    core = parts[0] > 0
    longest = bound_of_axes(cloud.points[core])
    search = Search(cloud, longest)
    best = search.compared(
        search.annealed_starts(parts, search.frames(parts, FRAMES), SEARCH.coarse), SEARCH.kept, None
    )
    accepted = acceptable(best)
    if KINDS[problem.kind].is_radial and not accepted[best_first(best.scores())[0]]:
        best = search.wider(np.concatenate([parts, sides(cloud.points, core)]), best)
        accepted = acceptable(best)
    # accepted candidates first: the likelihood takes correlated distances for independent ones
    first = best_first(_ranking(best, accepted))[:1]
    if best.mixture.inlier_ratio[first[0]] < LARGEST_RATIO:
        noisy = accepted[first[0]] and best.mixture.sigma[first[0]] > SEARCH.maybe_exact
        if not noisy and (exact := search.through_all_points()):
            return _converged(problem, exact, 0, longest)
        problem = _with_density_odds(problem, best.picked(first), longest)
    problem, best = _restarted(problem.bounded(*best.picked(first), longest), best, longest)
    alternatives = _alternatives(best, _ranking(best, acceptable(best)))
    return _converged(problem, best.picked(alternatives), len(alternatives) - 1, longest)


def nearby(problem: SearchProblem, starts: list[Superquadric]) -> Superquadric:
    """The best surface that descents from given starts reach on a sample, without a search and to few digits."""
    cloud = problem.sample(SEARCH.fine)
    candidates = cloud.with_fixed(Candidates.of(starts))
    longest = bound_of_axes(cloud.points)
    spread = Mixture(np.full(len(starts), LARGEST_RATIO), np.full(len(starts), SEARCH.first_sigma))
    descent = cloud.descent(candidates, spread, longest)
    # as many steps as annealing has, but with all points as inliers, for the starts are near already
    descent.run(SEARCH.annealing_steps, SEARCH.all_steps, lambda d: all_inliers(d.distances, d.weights))
    descent.run(SEARCH.most_steps, SEARCH.near, em)
    return descent.candidates.superquadric(int(best_first(descent.scores())[0]))


def _with_density_odds(problem: SearchProblem, best: tuple[Candidates, Mixture], longest: float) -> SearchProblem:
    """The problem with the odds of the points by their density, for a best candidate with outliers."""
    inliers = problem.descent(*best, longest).inliers[0]
    return replace(problem, odds=density_odds(reach(problem.points, problem.sample(SEARCH.cloud).points), inliers))


def _restarted(problem: SearchProblem, best: Descent, longest: float) -> tuple[SearchProblem, Descent]:
    """The best candidates after restarts, and the problem without inliers that are not connected to the others.

    Where a surface goes on without data it may meet points of a neighbour, which then are what it is long for.
    """
    best = Search(problem.sample(SEARCH.cloud), longest).restarted(best)
    for _ in range(RESTART.rounds):
        others = _unconnected_inliers(problem, best, longest)
        if not len(others):
            break
        odds = problem.odds.copy()
        odds[others] = SEARCH.never
        problem = replace(problem, odds=odds)
        best = Search(problem.sample(SEARCH.cloud), longest).restarted(best)
    return problem, best


def _unconnected_inliers(problem: SearchProblem, best: Descent, longest: float) -> NDArray[np.int64]:
    """Indices of inliers of the best candidate that are not connected to the others; none of a covered surface."""
    first = best.picked(best_first(_ranking(best, acceptable(best)))[:1])
    inliers = np.flatnonzero(problem.descent(*first, longest).inliers[0] >= INLIER)
    surface, points = first[0].superquadric(0), problem.points[inliers]
    if covered_fraction(surface, points) >= COVERED:
        return inliers[:0]
    return inliers[unconnected(points)]


@dataclass(frozen=True)
class Search:
    """The comparison of candidates on samples of a cloud; no semi-axis is above `longest`."""

    cloud: SearchProblem
    longest: float

    def wider(self, parts: Array, earlier: Descent) -> Descent:
        """The comparison after a search from many parts, and one from the inliers of its best in their own frames."""
        first = self.annealed_starts(parts, self.frames(parts, UPRIGHT), SEARCH.coarse_wide)
        chosen, mixture = first.picked(distinct(first, first.scores(), SEARCH.kept_wide))
        inliers = self.cloud.descent(chosen, mixture, self.longest).inliers
        second = self.annealed_starts(inliers, chosen.rotations[:, None] @ FRAMES, SEARCH.coarse_wide)
        return self.compared(second, SEARCH.kept_wide, earlier)

    def through_all_points(self) -> tuple[Candidates, Mixture] | None:
        """A superellipsoid that passes through every point of a sample exactly, if one is found.

        The search may take exact points that are sampled unevenly for outliers. Here all are inliers, and starts are
        made in the axes of the whole cloud and then, twice, in those of the best results.
        """
        if not KINDS[self.cloud.kind].is_radial:
            return None
        subset = self.cloud.sample(SEARCH.coarse)
        frames = self.frames(np.ones((1, len(self.cloud.points))), FRAMES)
        for _ in range(SEARCH.exact_rounds):
            starts = subset.with_fixed(ellipsoids(subset.points, np.tile(subset.weights, (len(frames), 1)), frames))
            spread = Mixture(np.full(len(starts), LARGEST_RATIO), np.full(len(starts), SEARCH.first_sigma))
            descent = subset.descent(starts, spread, self.longest)
            descent.run(SEARCH.maybe_exact_steps, SEARCH.all_steps, lambda d: all_inliers(d.distances, d.weights))
            # all points are inliers here, so the candidate of the least sigma has the largest likelihood
            best = distinct(descent, -descent.mixture.sigma, SEARCH.kept_wide)
            if descent.mixture.sigma[best[0]] < SEARCH.exact:
                return descent.picked(best[:1])
            if descent.mixture.sigma[best[0]] > SEARCH.maybe_exact:
                break
            frames = descent.candidates.rotations[best, None] @ FRAMES
        return None

    def restarted(self, best: Descent) -> Descent:
        """The best candidates on the whole cloud, with those that start from boxes around the inliers of the best."""
        best = self._on_all(*best.picked(distinct(best, _ranking(best, acceptable(best)), SEARCH.kept)))
        for _ in range(RESTART.rounds if KINDS[self.cloud.kind].is_radial else 0):
            first = best.picked(best_first(_ranking(best, acceptable(best)))[:1])
            inliers = self.cloud.descent(*first, self.longest).inliers[0]
            if covered_fraction(first[0].superquadric(0), self.cloud.points[inliers >= INLIER]) >= COVERED:
                break  # points on all sides determine the size
            candidates, mixture = self._from_boxes(inliers, *first)
            best = self._on_all(first[0].joined(candidates), first[1].joined(mixture))
            if best_first(_ranking(best, acceptable(best)))[0] == 0:
                break  # none of the restarts is better
        return best

    def _on_all(self, candidates: Candidates, mixture: Mixture) -> Descent:
        descent = self.cloud.descent(candidates, mixture, self.longest)
        descent.run(SEARCH.compare_steps, SEARCH.near, em)
        return descent

    def _from_boxes(self, inliers: Array, candidate: Candidates, mixture: Mixture) -> tuple[Candidates, Mixture]:
        """The distinct candidates, on a sample, that start from boxes around the inliers of a candidate."""
        boxes = restarts(self.cloud.points, inliers, candidate.rotations[0])
        sample, first = self.cloud.sample(SEARCH.fine), np.zeros(len(boxes), dtype=np.int64)
        wide = Mixture(mixture.inlier_ratio[first], RESTART.larger_sigma * mixture.sigma[first])
        descent = sample.descent(sample.with_fixed(boxes), wide, self.longest)
        descent.run(RESTART.steps, SEARCH.near, em)
        return descent.picked(distinct(descent, descent.scores(), len(boxes)))

    def annealed_starts(self, parts: Array, rotations: Array, most: int) -> Descent:
        """The descent of starts from weighted parts (H, n) of the cloud after annealing and EM, on `most` points.

        Args:
            parts: weights of the cloud's points, a row for each part.
            rotations: (H, k, 3, 3), the frames of the k starts of each part.
            most: points of the sample.
        """
        index = self.cloud.thinned(most)
        subset = replace(self.cloud.sample(most), size=0.0)
        made, part = self._starts(parts, rotations)
        starts = subset.with_fixed(made)
        own = (np.maximum(parts[:, index], SEARCH.elsewhere) * subset.weights)[part]
        sizes = np.sqrt(np.exp(2 * starts.log_axes).mean(axis=1))  # RMS radius of the part
        spread = Mixture(np.full(len(starts), LARGEST_RATIO), SEARCH.first_sigma * sizes)
        descent = subset.weighted_descent(starts, own, spread, self.longest)
        descent.run(SEARCH.own_steps, SEARCH.all_steps, lambda d: all_inliers(d.distances, d.weights))
        wide = Mixture(descent.mixture.inlier_ratio, np.minimum(descent.mixture.sigma, SEARCH.first_sigma * sizes))
        descent = subset.descent(descent.candidates, wide, self.longest)
        descent.run(SEARCH.annealing_steps, SEARCH.all_steps, lambda d: annealed(d.mixture, sizes))
        descent.run(SEARCH.em_steps, SEARCH.comparable, em)
        return descent

    def _starts(self, parts: Array, rotations: Array) -> tuple[Candidates, NDArray[np.int64]]:
        """The M starts, and the index (M,) of the part from which each is made: of other kinds always the first."""
        if not KINDS[self.cloud.kind].is_radial:
            found = other_kind(self.cloud.points[parts[0] > 0], self.cloud.kind)
            return found, np.zeros(len(found), dtype=np.int64)
        found = ellipsoids(self.cloud.points, parts * self.cloud.weights, rotations)
        return found, np.arange(len(parts)).repeat(rotations.shape[1])

    def frames(self, parts: Array, rotations: Array) -> Array:
        """Orientations (k, 3, 3) of the principal axes of each part, or the fixed rotation: (H, k, 3, 3)."""
        rotation = self.cloud.fixed.get("rotation")
        if rotation is not None:
            return np.broadcast_to(rotation, (len(parts), 1, 3, 3))
        return principal_axes(self.cloud.points, parts * self.cloud.weights)[:, None] @ rotations

    def compared(self, descent: Descent, kept: int, earlier: Descent | None) -> Descent:
        """The descent of the distinct best candidates, and of those of an earlier comparison, on a larger sample."""
        candidates, mixture = descent.picked(distinct(descent, descent.scores(), kept))
        if earlier is not None:
            candidates, mixture = (candidates.joined(earlier.candidates), mixture.joined(earlier.mixture))
        descent = self.cloud.sample(SEARCH.fine).descent(candidates, mixture, self.longest)
        descent.run(SEARCH.compare_steps, SEARCH.comparable, em)
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
    """A mask (M,) of the candidates with at least half of the points as inliers and distances that are not a pattern.

    Distances of neighbours are compared by half of von Neumann's ratio: one for noise, less where the surface is not
    that of the points. It must be above `pattern`; edges under strong noise alone give about 0.6. Where sigma is below
    `exact`, distances are rounding and may be correlated.
    """
    near, counts = nearest(descent.points, descent.points, 2)
    point, rank = counts[:, 1:].nonzero()  # on a lattice several neighbours are at the same distance
    neighbour, weights = near[point, rank + 1], descent.weights / counts[:, 1:].sum(axis=1)
    pair = descent.inliers[:, point] * descent.inliers[:, neighbour] * weights[point]
    own, other = descent.distances[:, point], descent.distances[:, neighbour]
    difference, both = ((pair * (own - other) ** 2).sum(axis=1), (pair * (own**2 + other**2)).sum(axis=1))
    # of independent distances the squares of the differences sum up to those of both
    white = (pair.sum(axis=1) > ENOUGH_PAIRS) & (difference > SEARCH.pattern * both)
    return (descent.mixture.inlier_ratio >= SEARCH.majority) & (white | (descent.mixture.sigma < SEARCH.exact))


def _ranking(descent: Descent, accepted: NDArray[np.bool_]) -> Array:
    """Scores (M,), larger for accepted candidates: the likelihood takes correlated distances for independent ones."""
    return descent.scores() + SEARCH.acceptance_bonus * descent.weights.sum() * accepted


def _alternatives(descent: Descent, ranking: Array) -> NDArray[np.int64]:
    """Indices of the best candidate and of those within `alternative` of its cost."""
    index = distinct(descent, ranking, SEARCH.kept_wide)
    # log likelihood falls by n / 2 times the relative growth of sigma squared
    margin = SEARCH.alternative / 2 * descent.inliers[index[0]].sum()
    return index[ranking[index] >= ranking[index[0]] - margin]


def _converged(problem: SearchProblem, start: tuple[Candidates, Mixture], others: int, longest: float) -> SearchResult:
    """The result of descents on larger and larger samples, then on all points.

    Of alternatives the best on the first sample continues; without a sample, the best at `near` on all points.
    """
    candidates, mixture = start
    # most steps are made on few points
    size = SEARCH.fine * SEARCH.growth
    while size * 2 < len(problem.points):
        descent = problem.sample(size).descent(candidates, mixture, longest)
        descent.run(SEARCH.sample_steps, SEARCH.sampled, em)
        candidates, mixture = _best(descent)
        size *= SEARCH.growth
    descent = problem.descent(candidates, mixture, longest)
    descent.run(SEARCH.most_steps, SEARCH.near, em)
    descent = descent if len(candidates) == 1 else problem.descent(*_best(descent), longest)
    converged = descent.converge(SEARCH.most_steps, SEARCH.tolerance, em) or descent.run(
        SEARCH.most_steps, SEARCH.nearly, em
    )
    return SearchResult(descent, converged, others)


def _best(descent: Descent) -> tuple[Candidates, Mixture]:
    return descent.picked(best_first(descent.scores())[:1])
