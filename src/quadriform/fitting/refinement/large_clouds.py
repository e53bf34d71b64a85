"""Clouds of very many points: a fit to a sample, then a few rounds on all of them, a part at a time.

Memory grows with the cloud only by arrays with one value for each point: weights, hashes, and the distances and inlier
probabilities that are returned. Neighbourhoods and first foot points are those of the nearest point of the sample.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from quadriform.errors import WarningKind, Warnings
from quadriform.fitting.cloud import Centred
from quadriform.fitting.diagnostics import duplicates, named_texts, outliers
from quadriform.fitting.least_squares.marginal_likelihood import LinearProblem, Solution
from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.least_squares.uncertainty import EnrichedBox
from quadriform.fitting.noise import KnownNoise
from quadriform.fitting.options import TangentOptions, check_strength
from quadriform.fitting.refinement.base_prior import base_prior
from quadriform.fitting.refinement.point_to_plane import data_rows, displaced, linear_problem_from, probes, record
from quadriform.fitting.refinement.surface_data import SurfaceData, with_excess
from quadriform.fitting.refinement.unfolding import JacobianPenalty, remove_folds
from quadriform.fitting.result import Fit, unnamed
from quadriform.point_sets import points_sha256
from quadriform.points import Array, Frame
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.threads import threads_for


@dataclass(frozen=True)
class LargeClouds:
    """The constants of fits to very many points."""

    many: int = 50_000
    """A cloud of more points is fitted to a sample first: memory grows with the points that are held at once."""
    sample: int = 30_000
    """About so many of its points: 80 for each unknown of a box of 5 control points a side."""
    part: int = 16_000
    """Points that are handled at once; the parts are distributed to the cores."""
    rounds: int = 3
    """Rounds on all points after the fit to the sample, to which the surface is near already."""
    tangential_steps: int = 4
    """Of each foot point in a round, one more than in other fits: the first begins at that of its nearest neighbour."""
    stronger: tuple[int, ...] = (1, 10, 100)
    """Where the removal of folds would cost too much noise, the strength is made so many times larger."""
    accepted: float = 1.01
    """Fold removal may make the noise this many times larger: the fit to the sample had no folds."""


LARGE = LargeClouds()
MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
"""Odd numbers without a pattern in their bits, 2^64 over the golden ratio among them: as factors modulo 2^64 they can
be undone, so different coordinates stay different."""
T = TypeVar("T")


def sample_of_large(clouds: Mapping[str, Array], weights: Mapping[str, Array]) -> dict[str, NDArray[np.int64]] | None:
    """Name -> indices of a sample of the points (n, 3); None where no cloud has more than `many`."""
    if max(map(len, clouds.values())) <= LARGE.many:
        return None
    return {name: sampled(cloud, weights[name]) for name, cloud in clouds.items()}


def sampled(cloud: Array, weights: Array) -> NDArray[np.int64]:
    """Indices of about `sample` points (n, 3) that have a weight; of all where they are not too many.

    They are chosen by a hash of their coordinates: independent of their order and of patterns of a scan.
    """
    if len(cloud) <= LARGE.many:
        return np.arange(len(cloud))
    # hashes are uniform in 64 bits, so the fraction below the limit is the fraction of points that is chosen;
    # 2^64 - 2^11 is the largest float below 2^64
    limit = np.uint64(min(LARGE.sample / int(np.count_nonzero(weights)), 1.0) * (2**64 - 2**11))
    chosen = []
    for part in _parts(len(cloud)):
        mask = (_hashes(cloud[part]) <= limit) & (weights[part] > 0)
        chosen.append(part.start + np.flatnonzero(mask))
    return np.concatenate(chosen)


def _hashes(points: Array) -> NDArray[np.uint64]:
    """Hashes (n,) of points (n, 3): bits of the coordinates mixed by odd constants, unrelated between neighbours.

    A product moves information to higher bits only, and the shifts move it down again: by about half of the 64 bits in
    the last two lines. Those of 0, 21 and 42 differ between the coordinates, so that equal ones do not cancel.
    """
    words = (points + 0.0).view(np.uint64) * MIX  # a zero has one sign
    mixed = words[:, 0] ^ (words[:, 1] >> np.uint64(21)) ^ (words[:, 2] >> np.uint64(42))
    mixed = (mixed ^ (mixed >> np.uint64(29))) * MIX[1]
    return np.asarray(mixed ^ (mixed >> np.uint64(32))) * MIX[2]


def _parts(count: int) -> Iterator[slice]:
    return (slice(start, min(start + LARGE.part, count)) for start in range(0, count, LARGE.part))


@dataclass(frozen=True)
class _Surface:
    """All points of one surface.

    Attributes:
        name: of the surface.
        cloud: (n, 3), in the world.
        weights: (n,), on the scale of those of the sample; zero for points of other bodies, which are outliers.
        counted: (n,), which points the user gave a weight above zero.
        noise: (n, 3, 3), covariances of the points in the world, or None.
        data: of the sample, in the centred, scaled frame.
        tree: of the points of the sample, likewise.
    """

    name: str
    cloud: Array
    weights: Array
    counted: NDArray[np.bool_]
    noise: Array | None
    data: SurfaceData
    tree: cKDTree

    @property
    def duplicates(self) -> Warnings:
        """DUPLICATES of all points that have a weight, by their hashes: eight bytes a point, no sorted rows."""
        parts = list(_parts(len(self.cloud)))
        hashes = np.concatenate([_hashes(self.cloud[part])[self.weights[part] > 0] for part in parts])
        return duplicates(len(hashes) - len(np.unique(hashes)), len(self.cloud))


@dataclass(frozen=True)
class _All:
    """All points of all surfaces; sums over them do not depend on the number of threads."""

    surfaces: Sequence[_Surface]
    frame: Frame
    known: KnownNoise
    options: TangentOptions

    def part(self, surface: _Surface, chosen: slice, box: ControlBox, sigma: float) -> SurfaceData:
        """The data of some points with foot points, and if robust with probabilities at the sample's inlier ratio."""
        points, relative = self.frame.to_local(surface.cloud[chosen]), None
        if surface.noise is not None:
            relative = surface.noise[chosen] / (self.known.least_sigma * self.frame.scale) ** 2
        data = surface.data.beside(points, surface.weights[chosen], surface.tree.query(points)[1], relative)
        data = data.with_tangential_steps(box, LARGE.tangential_steps)
        return data.with_inliers_at_ratio(box, sigma) if self.options.robust else data

    def updated(self, box: ControlBox, sigma: float) -> "_All":
        """The points with the samples' foot points, and if robust their inlier ratios, updated to another box."""
        samples = [each.data.with_tangential_steps(box, LARGE.tangential_steps) for each in self.surfaces]
        updated = with_excess(samples, [box] * len(samples))
        if self.options.robust:
            updated = tuple(data.with_inliers(box, sigma) for data in updated)
        return replace(self, surfaces=[replace(each, data=data) for each, data in zip(self.surfaces, updated)])

    def each(self, surfaces: Sequence[_Surface], work: Callable[[_Surface, slice], T]) -> Iterator[T]:
        """The results of a function of each part, in the order of the parts."""
        # so sums are added in the same order, whatever thread is done first
        jobs = [(surface, chosen) for surface in surfaces for chosen in _parts(len(surface.cloud))]
        with ThreadPoolExecutor(threads_for(LARGE.part * len(jobs))) as pool:
            yield from pool.map(lambda job: work(*job), jobs)

    def linear_problem(
        self, box: ControlBox, elevated: ControlBox, sigma: float, effective_fraction: float
    ) -> LinearProblem:
        """The linear problem of all points for a box `elevated` that deforms like `box`, without priors."""

        def of_part(surface: _Surface, chosen: slice) -> tuple[NormalEquations, float]:
            """Normal equations of a part of the points, and how many these count for."""
            data = self.part(surface, chosen, box, sigma)
            return data_rows(data, box).equations(box, elevated.degrees), data.total_weight

        parts = self.each(self.surfaces, of_part)
        total, count = next(parts)
        for equations, weight in parts:
            total, count = total + equations, count + weight
        least = self.known.least_sigma
        return linear_problem_from(total, elevated, self.options.regularity, count, effective_fraction, least)

    def with_priors(self, linear: LinearProblem, box: ControlBox) -> LinearProblem:
        """The problem with the priors of the surfaces that have a base."""
        for surface in self.surfaces:
            # as many inliers as the sample has
            ratio = surface.data.total_weight / float(surface.data.weights.sum())
            for prior in base_prior(surface.data, box, ratio * float(surface.weights.sum())):
                linear = linear.with_extra_terms(prior.equations(box))
        return linear


def on_all(
    found: Fit,
    enriched: EnrichedBox,
    clouds: Mapping[str, Array],
    weights: Mapping[str, Array],
    counted: Mapping[str, NDArray[np.bool_]],
    noise: Mapping[str, Array],
    sample: Centred,
    known: KnownNoise,
    options: TangentOptions,
) -> Fit:
    """The fit to a sample continued on all points.

    Args:
        found: the fit to the sample.
        enriched: the same data with more control points.
        clouds: name -> (n, 3), all points.
        weights: name -> (n,), 0 also for points of something else.
        counted: name -> (n,), which points the user gave a weight above zero.
        noise: name -> (n, 3, 3), covariances of all points; empty where they are not known.
        sample: the points that were fitted.
        known: what is known of the noise of these.
        options: of the fit.
    """
    local = sample.frame.shape_to_local(found.model)
    base, surfaces = local.landmarks.base, []
    half_space = None if base is None else (base.point, base.direction)
    for name, cloud in clouds.items():
        surface, some, some_weights = local.surfaces[name], sample.points[name], sample.weights[name]
        covariances, least = known.relative.get(name), known.least_sigma
        data = SurfaceData.of(surface, some, some_weights, half_space, None, covariances, least)
        data = data.with_nearest_foot_points(local.box)
        # the weights of the sample have mean one
        scaled = weights[name] if sample.mean_weight == 1 else weights[name] / sample.mean_weight
        surfaces.append(_Surface(name, cloud, scaled, counted[name], noise.get(name), data, cKDTree(data.points)))
    points = _All(surfaces, sample.frame, known, options)
    return _with_arrays(*_rounds(points, found, enriched, local.box))


def _rounds(points: _All, found: Fit, enriched: EnrichedBox, box: ControlBox) -> tuple[_All, Fit]:
    """The points and the fit, in the world, after a few rounds from the box of the sample.

    The fit to the sample itself where their results fold or leave control points undetermined.
    """
    scale, fraction = points.frame.scale, enriched.linear.effective_fraction
    sigma, history, after = found.noise / scale, list(found.history), None
    measured = probes(surface.data.superquadric for surface in points.surfaces)
    for _ in range(LARGE.rounds):
        points = points.updated(box, sigma)
        linear = points.with_priors(points.linear_problem(box, box, sigma, fraction), box)
        after = _next(points, linear, box, found.strength, after)
        if after is None:
            break
        before, box, sigma = box, after.box, after.solution.sigma
        history.append(record(before, box, measured, sigma).scaled(scale))
    if after is None:
        return points, found
    solution, elevated = after.solution, box.elevate(enriched.degrees)
    linear = points.updated(box, sigma).linear_problem(box, elevated, sigma, fraction)
    result = replace(
        found,
        model=replace(found.model, box=points.frame.shape_to_world(box)),
        history=tuple(history),
        strength=solution.strength,
        noise=scale * sigma,
        covariance=scale**2 * solution.covariance(),
        enriched=EnrichedBox(elevated, linear, solution.strength, scale),
    )
    return points, result


@dataclass(frozen=True)
class _Solved:
    """A box moved by the solution of a linear problem."""

    box: ControlBox
    solution: Solution


def _next(
    points: _All, linear: LinearProblem, box: ControlBox, strength: float, previous: _Solved | None
) -> _Solved | None:
    """The box after a round, without folds, at the strength of the options or at the best one; None where neither is.

    Args:
        points: with foot points.
        linear: the problem of the round.
        box: before the round.
        strength: of the fit to the sample.
        previous: the round before, or None.
    """
    given = check_strength(points.options.strength)
    if given is not None:
        solution = linear.solve(given)
    else:
        solution = linear.best(strength) if previous is None else linear.best_after(previous.solution)
    return None if solution is None else _unfolded(points, linear, box, solution)


def _unfolded(points: _All, linear: LinearProblem, box: ControlBox, solution: Solution) -> _Solved | None:
    """The box moved by a solution, without folds; regularised more strongly where that would cost too much noise."""
    surfaces = {surface.name: surface.data.superquadric for surface in points.surfaces}
    penalty = JacobianPenalty.of(box, surfaces, linear.total_weight, solution.sigma)

    def penalised(state: _Solved, penalty: JacobianPenalty, strength: float) -> _Solved | None:
        """The box after one round with a penalty on folds, None where nothing determines it."""
        # the penalty is linear about the state's box; the sums over all points are not taken anew
        found = linear.with_extra_terms(penalty.equations(state.box)).solve(strength)
        return None if found is None else _Solved(displaced(state.box, found), found)

    for factor in LARGE.stronger:
        first = solution if factor == 1 else linear.solve(factor * solution.strength)
        if first is None:
            continue
        state = _Solved(displaced(box, first), first)
        largest_sigma = LARGE.accepted * solution.sigma
        found = remove_folds(penalised, state, penalty, first.strength, surfaces, largest_sigma)
        if found is not None:
            # `solve` leaves the second derivative of the criterion unknown; `best_after` of the next round needs it
            return replace(found, solution=replace(found.solution, criterion_curvature=solution.criterion_curvature))
    return None


def _with_arrays(points: _All, fit: Fit) -> Fit:
    """The fit with distances and probabilities of all points in place of those of the sample."""
    frame, sigma = points.frame, fit.noise / points.frame.scale
    after = frame.shape_to_local(fit.model)
    before = replace(after, box=after.box.with_control_points(after.box.rest))
    points = points.updated(after.box, sigma)

    def of_part(surface: _Surface, chosen: slice) -> tuple[Array, Array, Array]:
        """Distances to the model and to its superquadric, and inlier probabilities, of a part of the points."""
        local = frame.to_local(surface.cloud[chosen])
        inliers = points.part(surface, chosen, after.box, sigma).inliers * (surface.weights[chosen] > 0)
        distances, undeformed = (frame.scale * each.distance(local, surface.name) for each in (after, before))
        return distances, undeformed, inliers

    arrays: list[dict[str, Array]] = [{}, {}, {}]
    for surface in points.surfaces:
        for found, parts in zip(arrays, zip(*points.each([surface], of_part))):
            found[surface.name] = np.concatenate(parts)
    sha256 = points_sha256(surface.cloud for surface in points.surfaces)
    return replace(
        _with_outliers(points, fit, arrays[2]),
        model=replace(fit.model, input_sha256=sha256),
        residuals=unnamed(arrays[0]),
        superquadric_residuals=unnamed(arrays[1]),
        inliers=unnamed(arrays[2]),
    )


def _with_outliers(points: _All, fit: Fit, inliers: Mapping[str, Array]) -> Fit:
    """The fit with warnings and notes about outliers and copies among all points instead of those of the sample."""
    of_points = named_texts({s.name: outliers(inliers[s.name], s.counted) | s.duplicates for s in points.surfaces})
    warnings = {kind: text for kind, text in fit.warnings.items() if kind != WarningKind.MANY_OUTLIERS} | of_points
    notes = tuple(note for note in fit.notes if not note.startswith((WarningKind.OUTLIERS, WarningKind.DUPLICATES)))
    return replace(fit, warnings=warnings, notes=notes)
