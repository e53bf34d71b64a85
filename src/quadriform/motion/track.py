"""The result of `track`: models of all frames, with distances, motions of slices, and warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from quadriform.errors import Warnings
from quadriform.fitting.result import Warned, flat
from quadriform.fitting.support import Support
from quadriform.motion.slice_move import SliceMove
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.spaces import rotation_between
from quadriform.words import summary

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
        prior_distances: for each frame the distance to the population of a prior, as `Fit.prior_distance`; empty
            without one.
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
    prior_distances: tuple[float, ...] = ()

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
