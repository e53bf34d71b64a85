"""Principal components of features."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import svd

from quadriform.points import Array

EQUAL = 1e-6
"""Entries of a component whose sizes differ by a smaller fraction are the same."""


@dataclass(frozen=True)
class Components:
    """Principal components of n shapes with p features.

    Attributes:
        mean: (p,), of all rows.
        directions: (min(n, p), p), one component a row, of unit length; the largest entry of each is positive,
            of equal ones the first.
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
        # a component has no sign of its own, and of equal entries, as symmetric shapes have, rounding chooses none
        sizes = np.abs(directions)
        first = (sizes >= (1 - EQUAL) * sizes.max(axis=1, keepdims=True)).argmax(axis=1)
        largest = np.take_along_axis(directions, first[:, None], axis=1)
        return cls(mean, directions * np.sign(largest), singular**2 / (len(rows) - 1))
