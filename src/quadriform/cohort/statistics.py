"""Statistics of shape, and the first step of a pipeline of scikit-learn, which is imported here only."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted

from quadriform.cohort.principal_modes import Shape, ShapeModes, as_models, shape_modes
from quadriform.fitting.options import check_box
from quadriform.points import Array
from quadriform.priors.alignment import PASSES, Correspondence
from quadriform.shapes.model import DeformableModel

__all__ = ["CorrespondingShapes", "ShapeModes", "shape_modes"]


class CorrespondingShapes(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Shapes as rows of corresponding features, as a transformer of scikit-learn.

    Args:
        box: control points along each axis of the reference.
        passes: number of alternations of poses and mean.

    Attributes:
        correspondence_: how shapes become rows, and rows become models.
    """

    def __init__(self, box: tuple[int, int, int] = (5, 5, 5), passes: int = PASSES) -> None:
        self.box = box
        self.passes = passes

    def fit(self, X: Sequence[Shape], y: object = None) -> "CorrespondingShapes":
        """Compute reference and mean of one or more shapes, and return self.

        Raises:
            InputError: no shapes, or shapes with different surfaces.
        """
        self.correspondence_ = Correspondence.of(as_models(X, self.box), check_box(self.box), self.passes)
        return self

    def transform(self, X: Sequence[Shape]) -> Array:
        """Return rows (len(X), 3 k) of shapes, each independent of the others.

        Raises:
            InputError: shapes with other surfaces than those of the training.
        """
        check_is_fitted(self)
        return self.correspondence_.transform(as_models(X, self.box))

    def inverse_transform(self, X: Array) -> list[DeformableModel]:
        """Return models of rows (n, 3 k), about the origin."""
        check_is_fitted(self)
        return self.correspondence_.inverse_transform(X)

    def get_feature_names_out(self, input_features: object = None) -> Any:
        """Return the names of the columns (scikit-learn's interface)."""
        check_is_fitted(self)
        count = self.correspondence_.reference.box.control_points.size
        return np.array([f"control{number // 3}_{'xyz'[number % 3]}" for number in range(count)], dtype=object)
