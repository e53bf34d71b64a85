"""The strategy "cycle" of `track`: the control points of all times at once, smooth and periodic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from quadriform.fitting.noise import KnownNoise
from quadriform.fitting.options import TangentOptions, check_box, check_strength
from quadriform.fitting.population.diagnostics import notes_on_walls, outside_population
from quadriform.fitting.population.fit import posed
from quadriform.fitting.refinement.refine import RefinementInput, smooth_box
from quadriform.fitting.refinement.starts import nested_ellipsoids
from quadriform.fitting.result import HalfSpace
from quadriform.motion.cycle import Cycle, CycleFit, named
from quadriform.motion.cycle_rounds import Approach, FromOneFrame, fit_cycle
from quadriform.motion.energies import InSpace, Smoothness
from quadriform.motion.frames import Covariances, Frames
from quadriform.motion.members import AsMembers, Population
from quadriform.motion.quality import (
    by_frame,
    cycle_warnings,
    support_of_frame,
    support_warnings,
    support_warnings_of_members,
)
from quadriform.motion.slice_motions import SlicePlanes
from quadriform.motion.slice_move import slice_moves, unmoved_slices
from quadriform.motion.task import Task
from quadriform.motion.track import Track
from quadriform.points import Array, Frame
from quadriform.shapes.control_box import ControlBox, common_box
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.posterior import Posterior
from quadriform.shapes.prior import ShapePrior
from quadriform.shapes.superquadric import Superquadric

STACK = (
    "slices are parallel: shifts that are smooth along the stack cannot be distinguished from the form of the heart, "
    "and were not sought; neither were shifts out of their planes and rotations"
)


@dataclass(frozen=True)
class Start:
    """Where all frames begin, in centred, scaled coordinates.

    Attributes:
        surfaces: name -> superquadric.
        box: undeformed.
        approach: how the rounds begin and end.
        in_space: what is known of the shape at any one time.
        prior: the population that the bodies are members of, in its pose, or None.
    """

    surfaces: dict[str, Superquadric]
    box: ControlBox
    approach: Approach
    in_space: InSpace
    prior: ShapePrior | None = None


def whole_cycle(task: Task) -> Track:
    """The track by the strategy "cycle"."""
    normalisation = Frame.of(np.concatenate([cloud for clouds in task.clouds for cloud in clouds.values()]))
    local = [{name: normalisation.to_local(cloud) for name, cloud in clouds.items()} for clouds in task.clouds]
    bases = [
        None if each is None else (normalisation.to_local(each.point[None])[0], each.direction) for each in task.bases
    ]
    start = _start(task, local, bases, normalisation)
    planes = None if task.slices is None else (SlicePlanes.of(local, task.slices), task.slices)
    cycle = Cycle(
        start.surfaces,
        start.box,
        local,
        task.basis.values(task.times),
        task.basis,
        start.in_space,
        task.options["robust"],
        planes,
        _local_noise(task.noise, local, normalisation.scale),
        bases,
    )
    found = fit_cycle(cycle, start.approach, check_strength(task.options["strength"]), task.progress)
    result = _cycle_in_world(task, normalisation, _moving(task, start, normalisation, found), found)
    if start.prior is not None:
        result = _of_population(result, start.prior, found.prior_distances)
    if planes is None:
        return result
    notes = ((STACK,) if planes[0].are_parallel else ()) + unmoved_slices(planes[0], task.slices or [])
    moves = slice_moves(planes[0], found.slices, found.motion_covariance, normalisation)
    return replace(result, moves=moves, notes=(*result.notes, *notes))


def _of_population(track: Track, prior: ShapePrior, distances: tuple[float, ...]) -> Track:
    """A track with the distances of its frames to a population, and what follows from the use of a prior."""
    warnings = track.warnings | by_frame([outside_population(prior, each) for each in distances])
    notes = (*track.notes, *notes_on_walls(prior.surfaces))
    return replace(track, prior_distances=distances, warnings=warnings, notes=notes)


def _start(task: Task, local: Frames, bases: Sequence[HalfSpace | None], normalisation: Frame) -> Start:
    points, base = local[task.reference], bases[task.reference]
    if task.prior is not None:
        known = {name: each / normalisation.scale**2 for name, each in task.noise[task.reference].items()}
        return member_start(normalisation.shape_to_local(task.prior), points, base, known, task.options["robust"])
    return smooth_start(points, base, task.options)


def smooth_start(points: Mapping[str, Array], base: HalfSpace | None, options: Mapping[str, Any]) -> Start:
    """Nested ellipsoids, and a smooth box of one frame fitted alone."""
    surfaces = nested_ellipsoids(points)  # data on an open surface does not determine exponents
    shape = check_box(options["box"])
    chosen = TangentOptions(options["box"], options["regularity"], robust=options["robust"])
    weights = {name: np.ones(len(cloud)) for name, cloud in points.items()}
    given = RefinementInput(points, weights, {}, KnownNoise({}, 0.0), chosen, base)
    in_space = Smoothness(options["regularity"], shape)
    return Start(surfaces, common_box(surfaces, shape), FromOneFrame(smooth_box(given, dict(surfaces))), in_space)


def member_start(
    prior: ShapePrior, points: Mapping[str, Array], base: HalfSpace | None, noise: Mapping[str, Array], robust: bool
) -> Start:
    """A population in the pose of one frame, with its weights there.

    Args:
        prior: the population, in any pose.
        points: name -> (n, 3) of the frame.
        base: where its data ends on purpose.
        noise: name -> covariances (n, 3, 3) of the points; empty where they are not known.
        robust: whether outliers are down-weighted.
    """
    weights = {name: np.ones(len(cloud)) for name, cloud in points.items()}
    known = KnownNoise.of_local(dict(noise), dict(points))
    found = posed(RefinementInput(points, weights, {}, known, TangentOptions(robust=robust), base), prior)
    member = Population(found.prior, found.ratio)
    return Start(found.prior.surfaces, found.prior.box, AsMembers(found.prior), member, found.prior)


def _moving(task: Task, start: Start, normalisation: Frame, found: CycleFit) -> MovingModel:
    """The moving model in the unit and coordinates of the points."""
    control, posterior = found.control_points, None
    if found.posterior is not None:
        deviations = found.posterior.deviations
        posterior = Posterior(deviations.reshape(len(deviations), *control.shape), task.sha256)
    known: dict[str, Any] = {"input_sha256": task.sha256, "frame_times": task.times, "posterior": posterior}
    moving = MovingModel(start.surfaces, start.box.origin, start.box.edges, task.basis, control, **known)
    return normalisation.shape_to_world(moving)


def _local_noise(noise: Covariances, local: Frames, scale: float) -> KnownNoise:
    """What is known of the noise of all frames, named as `Cycle` does, in centred, scaled coordinates."""
    covariances, clouds = (
        {named(n, name): values for n, frame in enumerate(frames) for name, values in frame.items()}
        for frames in (noise, local)
    )
    return KnownNoise.of_local({name: each / scale**2 for name, each in covariances.items()}, clouds)


def _cycle_in_world(task: Task, normalisation: Frame, moving: MovingModel, found: CycleFit) -> Track:
    """The track in the unit and coordinates of the points, with distances and warnings."""
    models = tuple(moving.at(time) for time in task.times)
    feet = tuple(
        # of the points after the motions of their slices
        {name: model.foot_points(normalisation.to_world(data.points), name) for name, data in datasets.items()}
        for model, datasets in zip(models, found.datasets)
    )
    noise, sigma = task.noise, normalisation.scale * found.sigma
    support = tuple(
        support_of_frame(models[k], found.datasets[k], feet[k], normalisation, sigma, task.bases[k], noise[k])
        for k in range(len(models))
    )
    of_support = support_warnings(support)
    if task.prior is not None:
        of_support = support_warnings_of_members(models, support, feet, found, normalisation.scale)
    return Track(
        strategy="cycle",
        times=task.times,
        models=models,
        moving=moving,
        residuals=tuple({name: each.signed for name, each in nearest.items()} for nearest in feet),
        noise=sigma,
        strengths=found.strengths,
        warnings=cycle_warnings(models, feet, found, normalisation.scale) | of_support,
        support=support,
    )
