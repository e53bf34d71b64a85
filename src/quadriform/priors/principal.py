"""Principal components of features."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import svd

from quadriform.points import Array


@dataclass(frozen=True)
class Components:
    """Principal components of n shapes with p features.

    Attributes:
        mean: (p,), of all rows.
        directions: (min(n, p), p), one component a row, of unit length; the largest entry of each is positive.
        variances: (min(n, p),), in descending order.
    """

    mean: Array
    directions: Array
    variances: Array

    @classmethod
    def of(cls, rows: Array) -> "Components":
        """All components of rows (n, p), by singular values as in scikit-learn's PCA, to all digits."""
        mean = rows.mean(axis=0)
        _, singular, directions = svd(rows - mean, full_matrices=False)
        # a component has no sign of its own
        largest = np.take_along_axis(directions, np.abs(directions).argmax(axis=1)[:, None], axis=1)
        return cls(mean, directions * np.sign(largest), singular**2 / (len(rows) - 1))
