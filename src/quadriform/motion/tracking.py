"""Moving models of points at several times, by three strategies (after the paper of 1996 that `motion` names).

"alone" fits each frame for itself; "previous" keeps the superquadrics of the reference frame and continues from the box
of the neighbouring frame on its side; "cycle" finds the control points of all times at once, smooth and periodic.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import Warnings, choose, known_options
from quadriform.fitting.diagnostics import low_overlap
from quadriform.fitting.fit import fit, precision_warnings, refine
from quadriform.fitting.noise import KnownNoise, partial_notes
from quadriform.fitting.options import Base, TangentOptions, check_box, check_strength
from quadriform.fitting.refinement.refine import RefinementInput, smooth_box
from quadriform.fitting.refinement.starts import nested_ellipsoids
from quadriform.fitting.result import Fit, HalfSpace, Progress, Warned, flat
from quadriform.fitting.support import Support
from quadriform.fitting.threads import one_blas_thread
from quadriform.motion.cycle import Cycle, CycleFit, named
from quadriform.motion.cycle_rounds import fit_cycle
from quadriform.motion.frames import (
    Covariances,
    Frames,
    Noises,
    Sets,
    SliceNumbers,
    checked_frames,
    checked_slices,
    checked_times,
    covariances,
    planes_of_frames,
    time_basis,
)
from quadriform.motion.quality import by_frame, cycle_warnings, support_of_frame, support_warnings
from quadriform.motion.slice_motions import SlicePlanes
from quadriform.motion.slice_move import SliceMove, slice_moves, unmoved_slices
from quadriform.point_sets import ALONE, Given, PointSet, common_unit, points_sha256
from quadriform.points import Array, Frame
from quadriform.shapes.control_box import ControlBox, common_box
from quadriform.shapes.landmarks import GIVEN_BASE, NONE_KNOWN, BasePlane, Landmarks
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.posterior import Posterior
from quadriform.shapes.spaces import rotation_between
from quadriform.shapes.splines import TimeBasis
from quadriform.shapes.superquadric import Superquadric
from quadriform.words import summary

STACK = (
    "slices are parallel: shifts that are smooth along the stack cannot be distinguished from the form of the heart, "
    "and were not sought; neither were shifts out of their planes and rotations"
)
AnyModel = TypeVar("AnyModel", DeformableModel, MovingModel)


@dataclass(frozen=True, repr=False)
class Track(Warned):
    """Models of all frames.

    Attributes:
        strategy: its name.
        times: (F,) of the frames.
        models: one a frame.
        moving: the same as one moving model; None for "alone", whose superquadrics differ.
        residuals: for each frame the signed distance of each point (moved with its slice) to its surface.
        noise: standard deviation of the points along the normal, in their unit; of "alone" and "previous" the root mean
            square of those of the frames.
        strengths: in space and in time; of "alone" and "previous" the median of those of the frames, in space.
        moves: slice number -> the rigid motion of its points; empty where none was sought.
        warnings: kind -> sentence; every model carries those of all frames, whose texts name the frames.
        notes: remarks that leave the status "ok", one sentence each.
        support: for each frame how far its data supports each surface.
    """

    strategy: str
    times: Array
    models: tuple[DeformableModel, ...]
    moving: MovingModel | None
    residuals: tuple[dict[str, Array], ...]
    noise: float
    strengths: tuple[float, ...]
    moves: dict[int, SliceMove] = field(default_factory=dict)
    warnings: Warnings = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    support: tuple[Mapping[str, Support], ...] = ()

    def __repr__(self) -> str:
        times = f"{len(self.times)} frames from {self.times[0]:.4g} to {self.times[-1]:.4g}, strategy {self.strategy!r}"
        points = f"RMS distance {self.rms:.4g}, noise {self.noise:.4g}"
        return summary(f"Track: {self.status}", times, points, *self._texts)

    def __post_init__(self) -> None:
        """Copy status, warnings and notes to the records of all models, also after `dataclasses.replace`."""
        super().__post_init__()
        models = tuple(self._recorded(model) for model in self.models)
        object.__setattr__(self, "models", models)
        object.__setattr__(self, "moving", None if self.moving is None else self._recorded(self.moving))

    def _recorded(self, model: AnyModel) -> AnyModel:
        record = replace(model.record, status=self.status, warnings=self.warnings, notes=self.notes)
        return replace(model, record=record)

    @property
    def rms(self) -> float:
        """RMS distance of all points of all frames to their surfaces."""
        return float(np.sqrt(np.concatenate([flat(found) ** 2 for found in self.residuals]).mean()))

    @property
    def frame_rms(self) -> Array:
        """RMS distances (F,) of the points of each frame to their surfaces."""
        return np.array([np.sqrt((flat(found) ** 2).mean()) for found in self.residuals])

    @property
    def supported(self) -> Array:
        """Share [0, 1] of the area that data supports in each frame, (F,), of the surface that has the least."""
        return np.array([min(each.area for each in frame.values()) for frame in self.support])

    @property
    def shifts(self) -> dict[int, Array]:
        """Slice number -> shift (3,) of its centre, that of `moves`, in the unit of the points."""
        return {number: move.shift for number, move in self.moves.items()}

    def in_space(self, space: str) -> Track:
        """The track with models and motions of slices in other world coordinates, "LPS" or "RAS".

        Raises:
            OptionError: other coordinates.
            InputError: those of the models are unknown.
        """
        rotation = rotation_between(self.models[0].space, space)
        return replace(
            self,
            models=tuple(model.in_space(space) for model in self.models),
            moving=None if self.moving is None else self.moving.in_space(space),
            moves={number: move.rotated(rotation) for number, move in self.moves.items()},
        )


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
        progress: called with (steps done, about how many).

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
    """
    choose(strategy, tuple(STRATEGIES), "strategy")
    sets = checked_frames(frames, noise)
    clouds = [{name: each.points for name, each in frame.items()} for frame in sets]
    at = checked_times(times, len(clouds))
    basis = time_basis(at, period)
    numbers = checked_slices(slices, clouds, strategy)
    options = {"box": box, "regularity": regularity, "strength": strength, "robust": robust}
    bases = planes_of_frames(base, sets)
    found = STRATEGIES[strategy](_Task(clouds, covariances(sets), bases, at, basis, numbers, options, progress))
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


@dataclass(frozen=True)
class _Task:
    """What a strategy is given: the checked input, in the unit of the points.

    Attributes:
        clouds: the points of each frame.
        noise: their covariances.
        bases: where the data of each frame ends on purpose.
        times: (F,) of the frames.
        basis: the splines in time.
        slices: for each frame the slice number of each point, by surface; or None.
        options: of the fits.
        progress: called with steps done, and about how many.
    """

    clouds: Frames
    noise: Covariances
    bases: list[BasePlane | None]
    times: Array
    basis: TimeBasis
    slices: list[dict[str, NDArray[np.int64]]] | None
    options: dict
    progress: Progress | None

    @property
    def reference(self) -> int:
        """The frame whose superquadrics serve for all: of the largest product of number of points and median radius.

        Of a heart this is a frame near end diastole. Its superquadrics determine along which lines the thickness of the
        wall is measured in all frames: the deformed images of lines that were straight between them.
        """
        every = [np.concatenate(list(frame.values())) for frame in self.clouds]
        sizes = [np.median(np.linalg.norm(points - points.mean(axis=0), axis=1)) for points in every]
        return int(np.argmax([len(points) * size for points, size in zip(every, sizes)]))

    @property
    def sets(self) -> Sets:
        """The points of each frame with their noise, as `fit` takes them."""
        return [
            {name: PointSet(cloud, noise=known.get(name)) for name, cloud in clouds.items()}
            for clouds, known in zip(self.clouds, self.noise)
        ]

    @property
    def sha256(self) -> str:
        """The hash of the points of all frames."""
        return points_sha256(cloud for frame in self.clouds for cloud in frame.values())

    def options_of(self, frame: int) -> dict[str, Any]:
        """The options of a frame that is fitted alone."""
        base = self.bases[frame]
        return self.options | {"base": None if base is None else (base.point, base.direction)}

    def report(self, done: int) -> None:
        """Call back with how many frames are done."""
        if self.progress is not None:
            self.progress(done, len(self.clouds))


def _alone(task: _Task) -> Track:
    fits = []
    for number, frame in enumerate(task.sets):
        fits.append(fit(frame, **task.options_of(number)))
        task.report(len(fits))
    return _of_fits("alone", task, fits, None)


def _previous(task: _Task) -> Track:
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


def _of_fits(strategy: str, task: _Task, fits: Sequence[Fit], moving: MovingModel | None) -> Track:
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
        notes=tuple(f"frame {number}: {note}" for number, found in enumerate(fits) for note in found.notes),
    )


def _cycle(task: _Task) -> Track:
    normalisation = Frame.of(np.concatenate([cloud for clouds in task.clouds for cloud in clouds.values()]))
    local = [{name: normalisation.to_local(cloud) for name, cloud in clouds.items()} for clouds in task.clouds]
    surfaces = nested_ellipsoids(local[task.reference])  # data on an open surface does not determine exponents
    box = common_box(surfaces, check_box(task.options["box"]))
    planes = None if task.slices is None else (SlicePlanes.of(local, task.slices), task.slices)
    splines_at_frames, options = task.basis.values(task.times), task.options
    noise = _local_noise(task.noise, local, normalisation.scale)
    bases = [
        None if each is None else (normalisation.to_local(each.point[None])[0], each.direction) for each in task.bases
    ]
    regularity, robust = options["regularity"], options["robust"]
    cycle = Cycle(surfaces, box, local, splines_at_frames, task.basis, regularity, robust, planes, noise, bases)
    start = _start(surfaces, local[task.reference], bases[task.reference], options)
    found = fit_cycle(cycle, start, check_strength(task.options["strength"]), task.progress)
    control, posterior = found.control_points, None
    if found.posterior is not None:
        deviations = found.posterior.deviations
        posterior = Posterior(deviations.reshape(len(deviations), *control.shape), task.sha256)
    known: dict[str, Any] = {"input_sha256": task.sha256, "frame_times": task.times, "posterior": posterior}
    moving = MovingModel(surfaces, box.origin, box.edges, task.basis, control, **known)
    result = _cycle_in_world(task, normalisation, normalisation.shape_to_world(moving), found)
    if planes is None:
        return result
    notes = ((STACK,) if planes[0].are_parallel else ()) + unmoved_slices(planes[0], task.slices or [])
    moves = slice_moves(planes[0], found.slices, found.motion_covariance, normalisation)
    return replace(result, moves=moves, notes=(*result.notes, *notes))


def _start(
    surfaces: Mapping[str, Superquadric],
    points: Mapping[str, Array],
    base: HalfSpace | None,
    options: Mapping[str, Any],
) -> ControlBox:
    """A smooth box of one frame fitted alone, where all frames begin."""
    chosen = TangentOptions(options["box"], options["regularity"], robust=options["robust"])
    weights = {name: np.ones(len(cloud)) for name, cloud in points.items()}
    return smooth_box(RefinementInput(points, weights, {}, KnownNoise({}, 0.0), chosen, base), dict(surfaces))


def _local_noise(noise: Covariances, local: Frames, scale: float) -> KnownNoise:
    """What is known of the noise of all frames, named as `Cycle` does, in centred, scaled coordinates."""
    covariances, clouds = (
        {named(n, name): values for n, frame in enumerate(frames) for name, values in frame.items()}
        for frames in (noise, local)
    )
    return KnownNoise.of_local({name: each / scale**2 for name, each in covariances.items()}, clouds)


def _cycle_in_world(task: _Task, normalisation: Frame, moving: MovingModel, found: CycleFit) -> Track:
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
    return Track(
        strategy="cycle",
        times=task.times,
        models=models,
        moving=moving,
        residuals=tuple({name: each.signed for name, each in nearest.items()} for nearest in feet),
        noise=sigma,
        strengths=found.strengths,
        warnings=cycle_warnings(models, feet, found, normalisation.scale) | support_warnings(support),
        support=support,
    )


STRATEGIES: dict[str, Callable[[_Task], Track]] = {"cycle": _cycle, "previous": _previous, "alone": _alone}
