"""The posterior distribution of the control points of a model, as samples.

A measure of a model, such as a volume or a strain, is a function of its control points. Samples, which are models
themselves, give its standard deviation without the covariance of thousands of control points.

The posterior is that of a linear problem, in which the data restricts displacements along the normals of the estimate
alone: along the tangents a sample is moved by millimetres, and by the curvature of the surface it then leaves the data,
always to the same side. This is of second order in the deviations, so that samples at a fraction `STEP` of their
deviations are measured, and their standard deviation about their mean is divided by it: a derivative of each measure
along each sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import OptionError
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.words import short_repr

SAMPLES = 32
"""Number of samples: the standard deviation of a measure is known to 1 / sqrt(2 x 32), an eighth of itself. The samples
of a moving model with twelve knots then take half a megabyte in single precision."""
STEP = 0.25
"""Fraction of the deviations at which samples are measured. Terms of second order, which are as large as those of first
order in whole deviations, are then a quarter of these, and mostly a part of the mean; steps much smaller would magnify
jumps, such as that of the apex of a heart from one vertex of a mesh to the next."""
SEED = 0
"""Of the random numbers behind the samples: the same data has the same samples."""


@dataclass(frozen=True, repr=False)
class Posterior:
    """Samples of the control points of a model, given its data.

    Attributes:
        deviations: (n, ..., l+1, m+1, n+1, 3), of the control points from their estimate, in single precision; of a
            moving model with an axis for its knots, of a still one without. A box with more control points than that
            of the model stands for the same deformation with more degrees of freedom.
        source: hash of the data. The samples of models of one source belong together by their number; those of
            different sources are independent of each other
            (`heart/deviations.py:aligned_samples`).
    """

    __repr__ = short_repr

    deviations: NDArray[Any]
    source: str = ""

    def __post_init__(self) -> None:
        values = np.asarray(self.deviations, dtype=np.float32)  # as in files, so that these change no digit
        if values.ndim < 5 or values.shape[-1] != 3 or not len(values) or not np.isfinite(values).all():
            raise OptionError(
                f"deviations: expected finite numbers of shape (samples, l+1, m+1, n+1, 3), with an axis for the knots "
                f"of a moving model, found {values.shape}"
            )
        object.__setattr__(self, "deviations", values)

    def __len__(self) -> int:
        """The number of samples."""
        return len(self.deviations)

    def at(self, weights: Array) -> Posterior:
        """The posterior at a time, of a moving model whose splines (K,) have these values then."""
        return Posterior(np.tensordot(weights, self.deviations, (0, 1)), self.source)

    def scaled(self, scale: float) -> Posterior:
        """The posterior in another unit of length."""
        return Posterior(scale * self.deviations, self.source)

    def rotated(self, rotation: Array) -> Posterior:
        """The posterior after a rotation (3, 3) of the world."""
        return Posterior(self.deviations @ rotation.T, self.source)

    def boxes(self, box: ControlBox, step: float = 1.0) -> list[ControlBox]:
        """The control boxes of all samples, given that of the estimate, at a fraction `step` of their deviations."""
        along_s, along_t, along_u = self.deviations.shape[-4:-1]
        whole = box.elevate((along_s - 1, along_t - 1, along_u - 1))
        return [whole.with_control_points(whole.control_points + step * each) for each in self.deviations]
