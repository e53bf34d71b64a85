"""The different values among whole numbers."""

import numpy as np
from numpy.typing import NDArray


def different(codes: NDArray[np.int64]) -> NDArray[np.int64]:
    """The values of `codes` (n,), each once and in order.

    Asked for values alone, NumPy 2.4 hashes them first, which takes far longer than sorting; asked for counts as well,
    it sorts.
    """
    return np.unique(codes, return_counts=True)[0]
