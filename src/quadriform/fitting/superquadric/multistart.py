"""The search behind the robust superquadric: many starts on few points, the best of them on all.

Coarse to fine: candidates are annealed and compared on a small even sample, the distinct best ones again on a larger
one, and boxes around the inliers of the best (`restarts`); what is best then converges on all points. A wider search
over parts of the cloud follows only where the best is not accepted.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.cloud import best_first, canonical_order, nearest
from quadriform.fitting.diagnostics import COVERED, INLIER
from quadriform.fitting.mixture import LARGEST_RATIO, Mixture, all_inliers, annealed, density_odds, estimated
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
from quadriform.fitting.superquadric.levenberg_marquardt import Candidates, Descent
from quadriform.fitting.superquadric.restarts import RESTART, restarts
from quadriform.fitting.support import covered_fraction
from quadriform.points import Array
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.superquadric import Superquadric


@dataclass(frozen=True)
class Settings:
    """The constants of the search; lengths in RMS radii."""

    cloud: int = 1500
    """Points that density is taken from: enough for 9 neighbours to be near."""
    fine: int = 500
    """Points that the best candidates are compared on."""
    coarse: int = 160
    """Points that all candidates of the narrow search are tried on: a dozen for each parameter."""
    coarse_wide: int = 320
    """The same in the wide search, whose parts have only some of them."""
    own_steps: int = 4
    """On the part that a start came from: it moves to that part, and no further."""
    annealing_steps: int = 8
    """While sigma is forced down, to a tenth of its first value."""
    em_steps: int = 6
    """With sigma free, until candidates can be compared."""
    compare_steps: int = 8
    """In the comparison on more points."""
    clean_steps: int = 16
    """Where all points count, and convergence must reach `exact`."""
    growth: int = 16
    """From one sample to the next, until all points are in it."""
    kept: int = 4
    """Distinct candidates on the larger sample after the narrow search."""
    kept_wide: int = 8
    """The same after the wide search, which finds more."""
    tolerance: float = 1e-10
    """The last descent ends when no parameter moves more than this."""
    near: float = 1e-2
    """Steps below this need no guard any more."""
    nearly: float = 1e-6
    """The tolerance on a crease, where derivatives jump and no descent converges."""
    most_steps: int = 40
    """Of one descent, more than convergence takes where there is a minimum."""
    pattern: float = 0.5
    """Fraction of the distances' variance that neighbours must not have in common."""
    pattern_cost: float = 0.1
    """Log likelihood per point that a pattern in the distances costs a candidate."""
    exact: float = 1e-6
    """Noise below this is rounding, of data in single precision too."""
    clean: float = 0.02
    """Where the best surface leaves more than this, points are no clean sample: on one a wrong one leaves less."""
    alternative: float = 0.01
    """Surfaces whose cost, sigma squared, is within this fraction of the best are alternative minima."""
    hottest: float = 0.5
    """Annealing starts no hotter than this fraction of a candidate's size."""
    same: float = 0.5
    """Surfaces nearer to each other than this many sigma at the points are one."""


SEARCH = Settings()
PARTS = ("semi_axes", "exponents", "rotation", "translation", "hole_radius")
"""The parameters of a superquadric in the order of those of `Candidates`."""
ENOUGH_PAIRS = (4 / (1 - SEARCH.pattern)) ** 2
"""With fewer neighbours pure noise has as much in common one time in 30,000 (four sigma), so nothing is concluded."""


@dataclass(frozen=True)
class Problem:
    """What is fitted: centred and scaled distinct points with weights of mean one, and what is fixed.

    Attributes:
        points: (n, 3).
        weights: (n,).
        kind: of the superquadric.
        fixed: values of parameters that stay, by name, in the frame of the points.
        odds: (n,) log odds to be an inlier, besides the distance to the surface.
        noise: (n,) standard deviations of the points along the normal, relative to that of a point of average weight.
        least_sigma: lower bound of the latter.
        size: how much the size counts, 0 while sigma is forced: it is weighed against the noise.
    """

    points: Array
    weights: Array
    kind: str
    fixed: dict[str, Array]
    odds: Array
    noise: Array
    least_sigma: float = 0.0
    size: float = 1.0

    @cached_property
    def _order(self) -> NDArray[np.int64]:
        return canonical_order(self.points)

    def thinned(self, most: int) -> NDArray[np.int64]:
        """Indices of at most `most` points, even over their order by distance from the centre."""
        count = len(self.points)
        return self._order[np.linspace(0, count - 1, min(most, count)).round().astype(np.int64)]

    def sample(self, most: int) -> "Problem":
        """The same on an even sample of the points."""
        index = self.thinned(most)
        arrays = (self.points, self.weights, self.odds, self.noise)
        points, weights, odds, noise = (each[index] for each in arrays)
        return replace(self, points=points, weights=weights, odds=odds, noise=noise)

    @property
    def fixed_mask(self) -> NDArray[np.bool_]:
        """(11,) or (12,): which parameters stay."""
        names = np.repeat(PARTS, [3, 2, 3, 3, 1])
        return np.isin(names[: KINDS[self.kind].n_parameters], list(self.fixed))

    def with_fixed(self, candidates: Candidates) -> Candidates:
        """Candidates with the fixed values."""
        values: dict[str, Array] = dict(zip(PARTS, candidates.arrays))
        for name, value in self.fixed.items():
            values[name] = np.broadcast_to(np.log(value) if name == "semi_axes" else value, values[name].shape)
        return Candidates(self.kind, *values.values())

    def descent(self, candidates: Candidates, mixture: Mixture, longest: float) -> Descent:
        """A descent of the candidates on these points."""
        return self.weighted_descent(candidates, self.weights, mixture, longest)

    def weighted_descent(self, candidates: Candidates, weights: Array, mixture: Mixture, longest: float) -> Descent:
        """The same with other weights (n,) or (M, n)."""
        noise = self.noise, self.least_sigma, self.size
        return Descent(candidates, self.points, weights, mixture, longest, self.fixed_mask, self.odds, *noise)


@dataclass(frozen=True)
class Solution:
    """The winner and what is known of it.

    Attributes:
        descent: converged, with one candidate.
        converged: whether it converged.
        alternatives: other surfaces that explain the points equally well.
    """

    descent: Descent
    converged: bool
    alternatives: int


def em(descent: Descent) -> Mixture:
    """The mixture re-estimated."""
    count = int((~descent.fixed).sum())
    found = estimated(descent.distances, descent.inliers, descent.weights, count)
    return replace(found, sigma=np.maximum(found.sigma, descent.least_sigma))


def solve(problem: Problem) -> Solution:
    """The superquadric of points of which some may be outliers, parts of other things, or missing."""
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
    # accepted candidates first: the likelihood does not see patterns in the distances
    winner = best_first(_ranking(best, accepted))[:1]
    if best.mixture.inlier_ratio[winner[0]] < LARGEST_RATIO:
        noisy = accepted[winner[0]] and best.mixture.sigma[winner[0]] > SEARCH.clean
        if not noisy and (clean := search.met_by_all()):
            return _converged(problem, clean, 0, longest)
        problem = _with_density_odds(problem, best.picked(winner), longest)
    best = Search(problem.sample(SEARCH.cloud), longest).restarted(best)
    alternatives = _alternatives(best, _ranking(best, acceptable(best)))
    return _converged(problem, best.picked(alternatives), len(alternatives) - 1, longest)


def nearby(problem: Problem, starts: list[Superquadric]) -> Superquadric:
    """The best of what lies near given starts, on a sample: no search, and no convergence to the last digit."""
    cloud = problem.sample(SEARCH.fine)
    candidates = cloud.with_fixed(Candidates.of(starts))
    longest = bound_of_axes(cloud.points)
    spread = Mixture(np.full(len(starts), LARGEST_RATIO), np.full(len(starts), SEARCH.hottest))
    descent = cloud.descent(candidates, spread, longest)
    descent.run(SEARCH.annealing_steps, 0, lambda d: all_inliers(d.distances, d.weights))
    descent.run(SEARCH.most_steps, SEARCH.near, em)
    return descent.candidates.superquadric(int(best_first(descent.scores())[0]))


def _with_density_odds(problem: Problem, winner: tuple[Candidates, Mixture], longest: float) -> Problem:
    """The problem with the odds that the density of points gives, when the best candidate leaves outliers."""
    inliers = problem.descent(*winner, longest).inliers[0]
    return replace(problem, odds=density_odds(reach(problem.points, problem.sample(SEARCH.cloud).points), inliers))


@dataclass(frozen=True)
class Search:
    """Candidates against each other on samples of a cloud; no semi-axis above `longest`."""

    cloud: Problem
    longest: float

    def wider(self, parts: Array, earlier: Descent) -> Descent:
        """A search from many parts, another from the inliers of its best in their own frames, and the comparison."""
        first = self.annealed_starts(parts, self.frames(parts, FRAMES[::3]), SEARCH.coarse_wide)
        winners, mixture = first.picked(distinct(first, first.scores(), SEARCH.kept_wide))
        inliers = self.cloud.descent(winners, mixture, self.longest).inliers
        second = self.annealed_starts(inliers, winners.rotations[:, None] @ FRAMES, SEARCH.coarse_wide)
        return self.compared(second, SEARCH.kept_wide, earlier)

    def met_by_all(self) -> tuple[Candidates, Mixture] | None:
        """An ellipsoid that meets every point of a sample exactly, if one is found.

        The search may take points of a clean but uneven sample for outliers; here all count, from the axes of the whole
        cloud and then, twice, from those of what the best starts come to.
        """
        if not KINDS[self.cloud.kind].is_radial:
            return None
        subset = self.cloud.sample(SEARCH.coarse)
        frames = self.frames(np.ones((1, len(self.cloud.points))), FRAMES)
        for _ in range(3):
            starts = subset.with_fixed(ellipsoids(subset.points, np.tile(subset.weights, (len(frames), 1)), frames))
            spread = Mixture(np.full(len(starts), LARGEST_RATIO), np.full(len(starts), SEARCH.hottest))
            descent = subset.descent(starts, spread, self.longest)
            descent.run(SEARCH.clean_steps, 0, lambda d: all_inliers(d.distances, d.weights))
            # all points are inliers here, so the least sigma is the largest likelihood
            best = distinct(descent, -descent.mixture.sigma, SEARCH.kept_wide)
            if descent.mixture.sigma[best[0]] < SEARCH.exact:
                return descent.picked(best[:1])
            if descent.mixture.sigma[best[0]] > SEARCH.clean:
                break
            frames = descent.candidates.rotations[best, None] @ FRAMES
        return None

    def restarted(self, best: Descent) -> Descent:
        """The best candidates on the whole cloud, beside what boxes around the inliers of the best of them lead to."""
        best = self._on_all(*best.picked(distinct(best, _ranking(best, acceptable(best)), SEARCH.kept)))
        for _ in range(RESTART.rounds if KINDS[self.cloud.kind].is_radial else 0):
            winner = best.picked(best_first(_ranking(best, acceptable(best)))[:1])
            inliers = self.cloud.descent(*winner, self.longest).inliers[0]
            if covered_fraction(winner[0].superquadric(0), self.cloud.points[inliers >= INLIER]) >= COVERED:
                break  # no end is hidden
            candidates, mixture = self._from_boxes(inliers, *winner)
            best = self._on_all(winner[0].joined(candidates), winner[1].joined(mixture))
            if best_first(_ranking(best, acceptable(best)))[0] == 0:
                break  # they led nowhere better
        return best

    def _on_all(self, candidates: Candidates, mixture: Mixture) -> Descent:
        descent = self.cloud.descent(candidates, mixture, self.longest)
        descent.run(SEARCH.compare_steps, SEARCH.near, em)
        return descent

    def _from_boxes(self, inliers: Array, candidate: Candidates, mixture: Mixture) -> tuple[Candidates, Mixture]:
        """What boxes around the inliers of a candidate lead to, on a sample."""
        boxes = restarts(self.cloud.points, inliers, candidate.rotations[0])
        sample, first = self.cloud.sample(SEARCH.fine), np.zeros(len(boxes), dtype=np.int64)
        warm = Mixture(mixture.inlier_ratio[first], RESTART.warmer * mixture.sigma[first])
        descent = sample.descent(sample.with_fixed(boxes), warm, self.longest)
        descent.run(RESTART.steps, SEARCH.near, em)
        return descent.picked(distinct(descent, descent.scores(), len(boxes)))

    def annealed_starts(self, parts: Array, rotations: Array, most: int) -> Descent:
        """Starts from weighted parts (H, n) of the cloud, annealed and then by EM, on `most` points.

        Args:
            parts: weights of the cloud's points, a row for each part.
            rotations: (H, k, 3, 3), the frames of the k starts of each part.
            most: points of the sample.
        """
        index = self.cloud.thinned(most)
        subset = replace(self.cloud.sample(most), size=0.0)
        starts = subset.with_fixed(self._starts(parts, rotations))
        # points of other parts keep a small weight, so that every problem has full rank
        own = np.repeat(np.maximum(parts[:, index], 1e-6) * subset.weights, -(-len(starts) // len(parts)), axis=0)
        sizes = np.sqrt(np.exp(2 * starts.log_axes).mean(axis=1))  # RMS radius of the part
        spread = Mixture(np.full(len(starts), LARGEST_RATIO), SEARCH.hottest * sizes)
        descent = subset.weighted_descent(starts, own[: len(starts)], spread, self.longest)
        descent.run(SEARCH.own_steps, 0, lambda d: all_inliers(d.distances, d.weights))
        hot = Mixture(descent.mixture.inlier_ratio, np.minimum(descent.mixture.sigma, SEARCH.hottest * sizes))
        descent = subset.descent(descent.candidates, hot, self.longest)
        descent.run(SEARCH.annealing_steps, 0, lambda d: annealed(d.mixture, sizes))
        descent.run(SEARCH.em_steps, 1e-4, em)
        return descent

    def _starts(self, parts: Array, rotations: Array) -> Candidates:
        if not KINDS[self.cloud.kind].is_radial:
            return other_kind(self.cloud.points[parts[0] > 0], self.cloud.kind)
        return ellipsoids(self.cloud.points, parts * self.cloud.weights, rotations)

    def frames(self, parts: Array, rotations: Array) -> Array:
        """Orientations (k, 3, 3) of the principal axes of each part, or the fixed rotation: (H, k, 3, 3)."""
        fixed_mask = self.cloud.fixed.get("rotation")
        if fixed_mask is not None:
            return np.broadcast_to(fixed_mask, (len(parts), 1, 3, 3))
        return principal_axes(self.cloud.points, parts * self.cloud.weights)[:, None] @ rotations

    def compared(self, descent: Descent, kept: int, earlier: Descent | None) -> Descent:
        """The distinct best candidates, and those of an earlier comparison, on a larger sample."""
        candidates, mixture = descent.picked(distinct(descent, descent.scores(), kept))
        if earlier is not None:
            candidates, mixture = (candidates.joined(earlier.candidates), mixture.joined(earlier.mixture))
        descent = self.cloud.sample(SEARCH.fine).descent(candidates, mixture, self.longest)
        descent.run(SEARCH.compare_steps, 1e-4, em)
        return descent


def distinct(descent: Descent, ranking: Array, most: int) -> NDArray[np.int64]:
    """The best candidates, at most `most`, no two of them the same surface at the points."""
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
    """Which candidates (M,) have half of the points as inliers and distances without much of a pattern.

    Distances of neighbours are compared by von Neumann's ratio: one for noise, less where the surface is not that of
    the points. Edges seen through strong noise alone give about 0.6.
    """
    near, counts = nearest(descent.points, descent.points, 2)
    point, rank = counts[:, 1:].nonzero()  # on a lattice several neighbours are at the same distance
    neighbour, weights = near[point, rank + 1], descent.weights / counts[:, 1:].sum(axis=1)
    pair = descent.inliers[:, point] * descent.inliers[:, neighbour] * weights[point]
    own, other = descent.distances[:, point], descent.distances[:, neighbour]
    difference, both = ((pair * (own - other) ** 2).sum(axis=1), (pair * (own**2 + other**2)).sum(axis=1))
    # of independent distances the squares of the differences sum up to those of both
    white = (pair.sum(axis=1) > ENOUGH_PAIRS) & (difference > SEARCH.pattern * both)
    return (descent.mixture.inlier_ratio >= 0.5) & (white | (descent.mixture.sigma < SEARCH.exact))


def _ranking(descent: Descent, accepted: NDArray[np.bool_]) -> Array:
    """Scores (M,), with an advantage for accepted candidates: the likelihood does not see patterns."""
    return descent.scores() + SEARCH.pattern_cost * descent.weights.sum() * accepted


def _alternatives(descent: Descent, ranking: Array) -> NDArray[np.int64]:
    """The best candidate and those within `alternative` of its cost."""
    index = distinct(descent, ranking, SEARCH.kept_wide)
    # log likelihood falls by n / 2 times the relative growth of sigma squared
    margin = SEARCH.alternative / 2 * descent.inliers[index[0]].sum()
    return index[ranking[index] >= ranking[index[0]] - margin]


def _converged(problem: Problem, start: tuple[Candidates, Mixture], alternatives: int, longest: float) -> Solution:
    """Larger and larger samples, then all points; alternatives are compared up to the last."""
    candidates, mixture = start
    # most steps are made on few points; a larger sample begins near its minimum
    size = SEARCH.fine * SEARCH.growth
    while size * 2 < len(problem.points):
        descent = problem.sample(size).descent(candidates, mixture, longest)
        descent.run(15, 1e-6, em)
        candidates, mixture = _winner(descent)
        size *= SEARCH.growth
    descent = problem.descent(candidates, mixture, longest)
    descent.run(SEARCH.most_steps, SEARCH.near, em)
    descent = descent if len(candidates) == 1 else problem.descent(*_winner(descent), longest)
    converged = descent.converge(SEARCH.most_steps, SEARCH.tolerance, em) or descent.run(
        SEARCH.most_steps, SEARCH.nearly, em
    )
    return Solution(descent, converged, alternatives)


def _winner(descent: Descent) -> tuple[Candidates, Mixture]:
    return descent.picked(best_first(descent.scores())[:1])
