"""Moving models of points at several times, by three strategies (after the paper of 1996 that `motion` names).

"alone" fits each frame for itself; "previous" keeps the superquadrics of the reference frame and continues from the box
of the neighbouring frame on its side; "cycle" finds the control points of all times at once, smooth and periodic.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError, choose, known_options
from quadriform.fitting.diagnostics import low_overlap
from quadriform.fitting.fit import fit, precision_warnings, refine
from quadriform.fitting.noise import partial_notes
from quadriform.fitting.options import Base, TangentOptions
from quadriform.fitting.population.checks import check_prior
from quadriform.fitting.result import Fit, Progress
from quadriform.fitting.threads import one_blas_thread
from quadriform.motion.cycle import named
from quadriform.motion.frames import (
    Frames,
    Noises,
    SliceNumbers,
    checked_frames,
    checked_slices,
    checked_times,
    covariances,
    planes_of_frames,
    time_basis,
)
from quadriform.motion.quality import by_frame
from quadriform.motion.task import Task
from quadriform.motion.track import Track
from quadriform.motion.whole_cycle import whole_cycle
from quadriform.point_sets import ALONE, Given, common_unit
from quadriform.points import Array
from quadriform.shapes.landmarks import GIVEN_BASE, NONE_KNOWN, Landmarks
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.prior import ShapePrior
from quadriform.shapes.splines import TimeBasis


@known_options
@one_blas_thread
def track(
    frames: Sequence[Given],
    *,
    times: ArrayLike | None = None,
    period: float | str | None = "auto",
    strategy: str = "cycle",
    slices: SliceNumbers | None = None,
    box: tuple[int, int, int] = (5, 5, 5),
    regularity: str = "bending",
    strength: float | str = "auto",
    robust: bool = True,
    noise: Noises | None = None,
    base: Base | Sequence[Base] = None,
    prior: ShapePrior | None = None,
    progress: Progress | None = None,
) -> Track:
    """The moving model that fits the points of two or more frames.

    Args:
        frames: for each (n, 3) points or a mesh, or several by name, as in `fit`, the same names in all.
        times: (F,) increasing; 0, 1, 2 ... unless given.
        period: after which the motion repeats, in the unit of the times; "auto": the frames are one whole cycle, evenly
            sampled; None: it does not repeat.
        strategy: "cycle", "previous" or "alone".
        slices: for each frame the slice number of each point, in the form of `frames`, below 0 for points of none;
            slices are then moved, each by one rigid motion in all frames where its number occurs (`Track.moves`): one
            number for each breath-hold. Of parallel slices alone only shifts in their planes are sought, and of these
            none that are smooth along the stack: they cannot be distinguished from the form of the heart. Only for
            "cycle".
        box: control points along each axis.
        regularity: "bending", "springs" or a regulariser of one's own.
        strength: of the regularisation in space, alpha per data point. "auto": each frame's own, as in `fit`; for
            "cycle" the smaller one of the best of two frames, nearest to the undeformed surfaces and farthest from
            them. Points with correlated errors count by their effective number.
        robust: whether outliers are detected and down-weighted.
        noise: what is known of the error of the points, as in `fit`: a standard deviation in their unit, or for each
            frame an entry in the form of `frames`. Distances are weighed by it, and the estimated noise is at least as
            large. Points of images and readers bring theirs; it counts where all frames and surfaces have some.
        base: where the data ends on purpose, as in `fit`: (point, direction) for all frames, or a list with a plane, a
            loop (m, 3) or None for each. The models are stored with it, so that `measure` takes volumes below it.
        prior: a population of which the body is a member at all times (`learn_prior`, of the shapes of all phases);
            its pose and the shapes are estimated together. Not with "previous", `box`, `regularity` or `strength`.
        progress: called with (steps done, about how many).

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
        InputError: a prior of other surfaces, or in another unit.
    """
    choose(strategy, tuple(STRATEGIES), "strategy")
    sets = checked_frames(frames, noise)
    clouds = [{name: each.points for name, each in frame.items()} for frame in sets]
    at = checked_times(times, len(clouds))
    basis = time_basis(at, period)
    numbers = checked_slices(slices, clouds, strategy)
    options = {"box": box, "regularity": regularity, "strength": strength, "robust": robust}
    if prior is not None:
        _check_prior(prior, strategy, options, clouds, common_unit(sets[0]))
    bases = planes_of_frames(base, sets)
    found = STRATEGIES[strategy](Task(clouds, covariances(sets), bases, at, basis, numbers, options, progress, prior))
    warnings = found.warnings | by_frame([precision_warnings(frame) for frame in sets])
    if slices is None:  # the meshes and labels that were given are not shifted with their slices
        overlaps = [low_overlap(model, frame, plane) for model, frame, plane in zip(found.models, sets, bases)]
        warnings |= by_frame(overlaps)
    assumed = dict.fromkeys(note for frame in sets for each in frame.values() for note in each.notes)
    every = {named(n, name): each for n, frame in enumerate(sets) for name, each in frame.items()}
    notes = (*assumed, *partial_notes({name: each.noise for name, each in every.items()}), *found.notes)
    unit = common_unit(every)  # which the lengths have already
    known = [NONE_KNOWN if plane is None else Landmarks(plane, GIVEN_BASE) for plane in bases]
    of_frames = tuple(known) if any(plane is not None for plane in bases) else ()
    moving = None if found.moving is None else replace(found.moving, unit=unit, landmarks=of_frames)
    models = tuple(replace(model, unit=unit, landmarks=each) for model, each in zip(found.models, known))
    return replace(found, models=models, moving=moving, warnings=warnings, notes=notes)


def _check_prior(prior: ShapePrior, strategy: str, options: Mapping[str, Any], clouds: Frames, unit: str) -> None:
    if strategy == "previous":
        raise OptionError("option prior is not one of strategy='previous'; use strategy='cycle' or 'alone'")
    every = {name: np.concatenate([frame[name] for frame in clouds]) for name in clouds[0]}
    check_prior(prior, TangentOptions(**options), every, unit, "unknown")


def _alone(task: Task) -> Track:
    fits = []
    for number, frame in enumerate(task.sets):
        fits.append(fit(frame, **task.options_of(number)))
        task.report(len(fits))
    return _of_fits("alone", task, fits, None)


def _previous(task: Task) -> Track:
    """The fits from the frame `reference` forwards to the last one, and from it backwards to frame 0."""
    fits: dict[int, Fit] = {task.reference: fit(task.sets[task.reference], **task.options_of(task.reference))}
    reference_model = fits[task.reference].model
    for order, before in ((range(task.reference + 1, len(task.clouds)), -1), (range(task.reference - 1, -1, -1), 1)):
        for frame in order:
            done = fits[frame + before]
            fits[frame] = done  # the same points have the same model
            if not _equal(task.clouds[frame], task.clouds[frame + before]):
                surfaces, start = reference_model.surfaces, done.model.box
                fits[frame] = refine(surfaces, task.sets[frame], start=start, **task.options_of(frame))
            task.report(len(fits))
    # one superquadric and one undeformed box for all frames: only the control points move
    ordered = [fits[frame] for frame in range(len(task.clouds))]
    every = TimeBasis(task.times, task.basis.period)
    control = np.stack([found.model.box.control_points for found in ordered])
    undeformed = reference_model.box
    moving = MovingModel(reference_model.surfaces, undeformed.origin, undeformed.edges, every, control)
    return _of_fits("previous", task, ordered, moving)


def _equal(one: Mapping[str, Array], other: Mapping[str, Array]) -> bool:
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


def _of_fits(strategy: str, task: Task, fits: Sequence[Fit], moving: MovingModel | None) -> Track:
    named_residuals = [f.residuals if isinstance(f.residuals, dict) else {ALONE: f.residuals} for f in fits]
    return Track(
        strategy=strategy,
        times=task.times,
        models=tuple(found.model for found in fits),
        moving=None if moving is None else replace(moving, input_sha256=task.sha256),
        residuals=tuple(named_residuals),
        noise=float(np.sqrt(np.mean([found.noise**2 for found in fits]))),
        strengths=(float(np.median([found.strength for found in fits])),),
        warnings=by_frame([found.warnings for found in fits]),
        support=tuple(found.support for found in fits),
        prior_distances=tuple(found.prior_distance for found in fits if found.prior_distance is not None),
        notes=tuple(f"frame {number}: {note}" for number, found in enumerate(fits) for note in found.notes),
    )


STRATEGIES: dict[str, Callable[[Task], Track]] = {"cycle": whole_cycle, "previous": _previous, "alone": _alone}
