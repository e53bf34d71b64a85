"""What the strategies of `track` are given: the checked input of all frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.result import Progress
from quadriform.motion.frames import Covariances, Frames, Sets
from quadriform.point_sets import PointSet, points_sha256
from quadriform.points import Array
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.prior import ShapePrior
from quadriform.shapes.splines import TimeBasis


@dataclass(frozen=True)
class Task:
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
        prior: the population that the body is a member of in all frames, or None.
    """

    clouds: Frames
    noise: Covariances
    bases: list[BasePlane | None]
    times: Array
    basis: TimeBasis
    slices: list[dict[str, NDArray[np.int64]]] | None
    options: dict
    progress: Progress | None
    prior: ShapePrior | None = None

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
        return self.options | {"base": None if base is None else (base.point, base.direction), "prior": self.prior}

    def report(self, done: int) -> None:
        """Call back with how many frames are done."""
        if self.progress is not None:
            self.progress(done, len(self.clouds))
