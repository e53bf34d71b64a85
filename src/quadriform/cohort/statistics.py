"""Statistics of shape: mean, principal modes, scores, and shapes of given scores, with scikit-learn's PCA.

`CorrespondingShapes` is a transformer of scikit-learn, the first step of a pipeline: it converts a list of models or of
clouds to a matrix.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from warnings import warn

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.decomposition import PCA
from sklearn.utils.validation import check_is_fitted

from quadriform.cohort.alignment import aligned, check_same_surfaces, reference_of
from quadriform.errors import InputError, OptionError
from quadriform.fitting.fit import fit
from quadriform.fitting.options import check_box
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel

Shape = Any
"""A model, a moving model (its first frame is taken), a cloud (n, 3), or clouds by name."""


class CorrespondingShapes(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Shapes as rows of corresponding features: control points over one reference, in one coordinate frame.

    A row has three features for each control point, 375 for 5 x 5 x 5. The distance of two rows is the RMS distance of
    corresponding points of two surfaces, in the unit of the data. Position and orientation are removed, size is not.

    Args:
        box: control points along each axis of the reference.
        passes: number of alternations of poses and mean.

    Attributes:
        reference_: ellipsoids and box over which shapes are expressed.
        mean_points_: (n, 3), the mean of the training shapes over the reference's points.
        in_world_: whether the training shapes have one orientation in the world, as images of patients do; else they
            were rotated by the axes of their superquadrics.
        space_: of the training models.
        unit_: of their lengths.
    """

    def __init__(self, box: tuple[int, int, int] = (5, 5, 5), passes: int = 3) -> None:
        self.box = box
        self.passes = passes

    def fit(self, X: Sequence[Shape], y: object = None) -> "CorrespondingShapes":
        """Compute reference and mean of one or more shapes, and return self.

        Raises:
            InputError: no shapes, or shapes with different surfaces.
        """
        models = self._models(X)
        found = reference_of(models, check_box(self.box), self.passes)
        self.reference_, self.mean_points_, self.in_world_ = found
        self.space_, self.unit_ = models[0].space, models[0].unit
        return self

    def transform(self, X: Sequence[Shape]) -> Array:
        """Return rows (len(X), 3 k) of shapes, each independent of the others.

        Raises:
            InputError: shapes with other surfaces than those of the training.
        """
        check_is_fitted(self)
        models = self._models(X)
        check_same_surfaces(models, tuple(self.reference_.surfaces))
        rows = []
        for model in models:
            points, _ = aligned(model, self.reference_, self.mean_points_, self.in_world_)
            rows.append(self.reference_.row(points))
        return np.array(rows)

    def inverse_transform(self, X: Array) -> list[DeformableModel]:
        """Return models of rows (n, 3 k), about the origin."""
        check_is_fitted(self)
        return [self.reference_.model(row, space=self.space_, unit=self.unit_) for row in np.atleast_2d(X)]

    def get_feature_names_out(self, input_features: object = None) -> Any:
        """Return the names of the columns (scikit-learn's interface)."""
        check_is_fitted(self)
        count = self.reference_.box.control_points.size
        return np.array([f"control{number // 3}_{'xyz'[number % 3]}" for number in range(count)], dtype=object)

    def _models(self, shapes: Sequence[Shape]) -> list[DeformableModel]:
        models = [self._model(shape) for shape in shapes]
        if not models:
            raise InputError("shapes: expected one or more, found none")
        return models

    def _model(self, shape: Shape) -> DeformableModel:
        if isinstance(shape, DeformableModel):
            return shape
        if isinstance(shape, MovingModel):
            return shape.at(float(shape.frame_times[0]))
        clouds: Mapping[str, Any] | Any = shape
        return fit(clouds, box=check_box(self.box)).model


@dataclass(frozen=True)
class ShapeModes:
    """Mean and principal modes of shapes.

    Attributes:
        shapes: transformer of models to rows.
        pca: of the rows.
    """

    shapes: CorrespondingShapes
    pca: PCA

    @property
    def mean(self) -> DeformableModel:
        """The mean shape."""
        return self.reconstruct(np.zeros((1, 0)))[0]

    @property
    def deviations(self) -> Array:
        """(M,) one sigma of each mode: RMS distance over the surface, in the unit of the data."""
        return np.sqrt(self.pca.explained_variance_)

    @property
    def variance_ratios(self) -> Array:
        """(M,) the explained fraction of the variance of each mode."""
        return self.pca.explained_variance_ratio_

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
        return self.pca.transform(self.shapes.transform(shapes)) / self.deviations

    def reconstruct(self, scores: Array) -> list[DeformableModel]:
        """Return models of scores (n, k) along the first k modes."""
        given = np.atleast_2d(scores)
        # a score is in standard deviations of its mode
        along = (given * self.deviations[: given.shape[1]]) @ self.pca.components_[: given.shape[1]]
        return self.shapes.inverse_transform(self.pca.mean_ + along)


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
    correspond = CorrespondingShapes(box)
    rows = correspond.fit(shapes).transform(shapes)
    return ShapeModes(correspond, PCA(count, svd_solver="full").fit(rows))
