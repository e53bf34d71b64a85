"""A moving model: a deformable model at any time, and the paths of its material points."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError
from quadriform.points import Array, check_points
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.landmarks import NONE_KNOWN, Landmarks
from quadriform.shapes.model import DeformableModel, lines_of
from quadriform.shapes.posterior import Posterior
from quadriform.shapes.record import ModelRecord, Recorded
from quadriform.shapes.spaces import rotation_between
from quadriform.shapes.splines import TimeBasis
from quadriform.shapes.superquadric import Superquadric
from quadriform.words import summary


@dataclass(frozen=True, repr=False)
class MovingModel(Recorded):
    """Superquadrics that do not move in a box whose control points do.

    Attributes:
        surfaces: name -> superquadric before deformation, the same at all times.
        origin: (3,), corner of the undeformed box.
        edges: (3, 3), its rows S, T, U.
        basis: the splines over time.
        control_points: (K, l+1, m+1, n+1, 3), at the knots of the basis.
        space: frame of the world: "LPS", "RAS" or "unknown".
        unit: "mm", "m" or "unknown".
        input_sha256: hash of the input that the model was fitted to.
        frame_times: (F,), increasing, of the frames that it was fitted to; those of the knots unless given.
        record: status, warnings and sources of its fit, those of all frames together.
        landmarks: of a ventricle, one entry a frame; empty where none are known.
        posterior: samples of the control points at the knots, given the data; None where they are not known.
    """

    surfaces: dict[str, Superquadric]
    origin: Array
    edges: Array
    basis: TimeBasis
    control_points: Array
    space: str = "unknown"
    unit: str = "unknown"
    input_sha256: str = ""
    frame_times: Array = ()  # type: ignore[assignment]
    record: ModelRecord = field(default_factory=ModelRecord)
    landmarks: tuple[Landmarks, ...] = ()
    posterior: Posterior | None = None

    def __repr__(self) -> str:
        knots, *counts = self.control_points.shape[:4]
        period = "no period" if self.basis.period is None else f"period {self.basis.period:.4g}"
        size = f"{' x '.join(map(str, counts))} control points at {knots} knots, {self.n_parameters} parameters"
        times = f"{len(self.frame_times)} frames from {self.frame_times[0]:.4g} to {self.frame_times[-1]:.4g}, {period}"
        about = f"status {self.status}, space {self.space}, unit {self.unit}"
        return summary(f"MovingModel: {size}", times, about, *lines_of(self.surfaces))

    def __post_init__(self) -> None:
        expected = len(self.basis.knots)
        if self.control_points.ndim != 5 or len(self.control_points) != expected:
            raise OptionError(
                f"control_points: expected shape ({expected}, l+1, m+1, n+1, 3), one box a knot, found "
                f"{self.control_points.shape}"
            )
        given = np.asarray(self.frame_times, dtype=np.float64)
        times = given if given.size else self.basis.knots
        if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise OptionError(f"frame_times: expected increasing times, found {times}")
        self.basis.values(times)  # refuses those that a motion without period does not cover
        object.__setattr__(self, "frame_times", times)
        if self.landmarks and len(self.landmarks) != len(times):
            raise OptionError(f"landmarks: expected one entry for each of {len(times)} frames, or none")
        if self.posterior is not None and self.posterior.deviations.shape[1:] != self.control_points.shape:
            found = self.posterior.deviations.shape[1:]
            raise OptionError(f"posterior: expected samples of shape {self.control_points.shape}, found {found}")

    @property
    def n_parameters(self) -> int:
        """The number of parameters: those of its superquadrics and 3 of each control point and knot."""
        return sum(len(s.parameters) for s in self.surfaces.values()) + self.control_points.size

    def box(self, time: float) -> ControlBox:
        """The control box at a time, in the unit of the knots."""
        weights = self.basis.values(np.array([time]))[0]
        return ControlBox(self.origin, self.edges, np.tensordot(weights, self.control_points, 1))

    def at(self, time: float) -> DeformableModel:
        """The model at a time, in the unit of the knots; with a period any time; landmarks of the nearest frame.

        Raises:
            OptionError: a time that a motion without period does not cover.
        """
        known = self.space, self.unit, self.input_sha256, self.record
        weights = self.basis.values(np.array([time]))[0]
        posterior = None if self.posterior is None else self.posterior.at(weights)
        return DeformableModel(self.surfaces, self.box(time), *known, self._landmarks_at(time), posterior)

    def _landmarks_at(self, time: float) -> Landmarks:
        """Those of the frame that is nearest in time."""
        if not self.landmarks:
            return NONE_KNOWN
        distances = np.abs(self.frame_times - time)
        if (period := self.basis.period) is not None:
            distances = np.minimum(distances % period, -distances % period)
        return self.landmarks[int(distances.argmin())]

    def trajectories(self, points: ArrayLike, times: ArrayLike) -> Array:
        """Positions (T, n, 3) at (T,) times of material points, given before deformation (n, 3)."""
        # The deformation is linear in the control points, and these are linear in the splines.
        matrix = self.rest.matrix(check_points(points))
        weights = self.basis.values(np.asarray(times, dtype=np.float64))
        return np.einsum(
            "tk,np,kpc->tnc", weights, matrix, self.control_points.reshape(len(weights.T), -1, 3), optimize=True
        )

    def undeform(self, points: ArrayLike, time: float) -> Array:
        """The material points (n, 3), before deformation, that are at world points at a time."""
        return self.box(time).undeform(points)

    @property
    def rest(self) -> ControlBox:
        """The undeformed control box, which is the same at all times; `ControlBox.rest` are control points."""
        along_s, along_t, along_u = self.control_points.shape[1:4]
        return ControlBox.undeformed(self.origin, self.edges, (along_s, along_t, along_u))

    def transformed(self, scale: float, offset: Array) -> MovingModel:
        """The same model after `scale` x + `offset`; time stays."""
        surfaces = {name: s.transformed(scale, offset) for name, s in self.surfaces.items()}
        return replace(
            self,
            surfaces=surfaces,
            origin=scale * self.origin + offset,
            edges=scale * self.edges,
            control_points=scale * self.control_points + offset,
            landmarks=tuple(each.transformed(scale, offset) for each in self.landmarks),
            posterior=None if self.posterior is None else self.posterior.scaled(scale),
        )

    def in_space(self, space: str) -> MovingModel:
        """The same model in another frame of the world, "LPS" or "RAS": a half-rotation about z lies between them.

        Raises:
            OptionError: another frame.
            InputError: the model's own is unknown.
        """
        rotation = rotation_between(self.space, space)
        return replace(
            self,
            surfaces={name: s.rotated(rotation) for name, s in self.surfaces.items()},
            origin=rotation @ self.origin,
            edges=self.edges @ rotation.T,
            control_points=self.control_points @ rotation.T,
            space=space,
            landmarks=tuple(each.rotated(rotation) for each in self.landmarks),
            posterior=None if self.posterior is None else self.posterior.rotated(rotation),
        )
