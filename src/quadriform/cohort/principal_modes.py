"""Statistics of shape: mean, principal modes, scores, and shapes of given scores."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from warnings import warn

import numpy as np

from quadriform.errors import InputError, OptionError
from quadriform.fitting.fit import fit
from quadriform.fitting.options import check_box
from quadriform.points import Array
from quadriform.priors.alignment import Correspondence
from quadriform.priors.principal import Components
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel

Shape = Any
"""A model, a moving model (its first frame is taken), a cloud (n, 3), or clouds by name."""


def as_models(shapes: Sequence[Shape], box: tuple[int, int, int]) -> list[DeformableModel]:
    """Return a model of each shape; clouds are fitted with this number of control points along each axis.

    Raises:
        InputError: no shapes.
    """
    if not len(shapes):
        raise InputError("shapes: expected one or more, found none")
    return [_model(shape, box) for shape in shapes]


def _model(shape: Shape, box: tuple[int, int, int]) -> DeformableModel:
    if isinstance(shape, DeformableModel):
        return shape
    if isinstance(shape, MovingModel):
        return shape.at(float(shape.frame_times[0]))
    clouds: Mapping[str, Any] | Any = shape
    return fit(clouds, box=check_box(box)).model


@dataclass(frozen=True)
class ShapeModes:
    """Mean and principal modes of shapes.

    Attributes:
        shapes: transforms models to rows, and rows to models.
        box: control points along each axis of the reference.
        mean_row: (3 k,), of all rows.
        components: (M, 3 k), one mode a row, of unit length.
        deviations: (M,) one sigma of each mode: RMS distance over the surface, in the unit of the data.
        variance_ratios: (M,) the explained fraction of the variance of each mode.
    """

    shapes: Correspondence
    box: tuple[int, int, int]
    mean_row: Array
    components: Array
    deviations: Array
    variance_ratios: Array

    @property
    def mean(self) -> DeformableModel:
        """The mean shape."""
        return self.reconstruct(np.zeros((1, 0)))[0]

    @property
    def shares(self) -> Array:
        """The name of `variance_ratios` in earlier versions."""
        warn("ShapeModes.shares is named variance_ratios; shares will be removed", DeprecationWarning, stacklevel=2)
        return self.variance_ratios

    def modes_for(self, fraction: float) -> int:
        """Return the number of modes that explain a fraction of the variance.

        Raises:
            OptionError: all modes together explain less.
        """
        total = np.cumsum(self.variance_ratios)
        if not 0 < fraction <= total[-1] + 1e-12:
            raise OptionError(
                f"fraction={fraction}: expected a number in (0, {total[-1]:.4g}], that of all {len(total)} modes"
            )
        return int(np.searchsorted(total, fraction - 1e-12)) + 1

    def scores(self, shapes: Sequence[Shape]) -> Array:
        """Return (n, M) scores of each shape along each mode, in standard deviations."""
        rows = self.shapes.transform(as_models(shapes, self.box))
        return (rows @ self.components.T - self.mean_row @ self.components.T) / self.deviations

    def reconstruct(self, scores: Array) -> list[DeformableModel]:
        """Return models of scores (n, k) along the first k modes."""
        given = np.atleast_2d(scores)
        # a score is in standard deviations of its mode
        along = (given * self.deviations[: given.shape[1]]) @ self.components[: given.shape[1]]
        return self.shapes.inverse_transform(self.mean_row + along)


def shape_modes(shapes: Sequence[Shape], modes: int | None = None, box: tuple[int, int, int] = (5, 5, 5)) -> ShapeModes:
    """Return mean and principal modes of two or more shapes.

    Args:
        shapes: models, moving models (their first frames), clouds (n, 3), or clouds by name.
        modes: number of modes; all unless given.
        box: control points along each axis of the reference.

    Raises:
        InputError: fewer than two, or shapes with different surfaces.
        OptionError: more modes than shapes allow.
    """
    if len(shapes) < 2:
        raise InputError(f"shapes: expected two or more to have modes, found {len(shapes)}")
    # n shapes span n - 1 modes about their mean
    most = min(len(shapes) - 1, 3 * int(np.prod(check_box(box))))
    count = most if modes is None else modes
    if not 1 <= count <= most:
        raise OptionError(f"option modes={modes!r}: expected 1 to {most} of {len(shapes)} shapes")
    models = as_models(shapes, box)
    found = Correspondence.of(models, box)
    return _principal_modes(found, found.transform(models), count, box)


def _principal_modes(shapes: Correspondence, rows: Array, count: int, box: tuple[int, int, int]) -> ShapeModes:
    """The first modes of rows (n, 3 k)."""
    found = Components.of(rows)
    ratios = found.variances / found.variances.sum()
    deviations = np.sqrt(found.variances[:count])
    return ShapeModes(shapes, box, found.mean, found.directions[:count], deviations, ratios[:count])
