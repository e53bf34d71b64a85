"""What a robust superquadric is fitted to, whole or a sample of it."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.fitting.cloud import canonical_order
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.fitting.superquadric.empty_space import EmptySpace
from quadriform.fitting.superquadric.surroundings import Surroundings
from quadriform.points import Array
from quadriform.shapes.kinds import KINDS

PARTS = ("semi_axes", "exponents", "rotation", "translation", "hole_radius")
"""The parameters of a superquadric in the order of those of `Candidates`."""
PART_OF_PARAMETER = np.repeat(PARTS, [3, 2, 3, 3, 1])
"""To which of them each of the 12 single parameters belongs."""


@dataclass(frozen=True)
class SearchProblem:
    """What is fitted: centred and scaled distinct points with weights of mean one, and what is fixed.

    Attributes:
        points: (n, 3), in RMS radii.
        weights: (n,).
        kind: of the superquadric.
        fixed: values of parameters that stay, by name, in the frame of the points.
        log_odds: (n,), of each point to be an inlier, by what is known besides its distance to the surface; 0 is even.
        relative_noise: (n,) known standard deviations of the points along the normal, divided by the root of their mean
            variance (`KnownNoise`); ones where nothing is known. Distances are divided by them, so that all have the
            standard deviation sigma.
        least_sigma: lower bound of sigma: the root of that mean variance, 0 where nothing is known.
        largest_sigma: upper bound of sigma, in a comparison with a surface whose sigma is known.
        size: weight of the penalty on the size of the body (`Extent`), which is weighed against the noise; 0 during
            annealing, where the noise is not known.
        surroundings: what is known beside the points, one viewpoint for each of them, or None.
        empty: space that the body is not in, or None while the body is not known.
        longest: no semi-axis grows above it; `solve` determines it from the extent of the points.
    """

    points: Array
    weights: Array
    kind: str
    fixed: dict[str, Array]
    log_odds: Array
    relative_noise: Array
    least_sigma: float = 0.0
    largest_sigma: float = np.inf
    size: float = 1.0
    surroundings: Surroundings | None = None
    empty: EmptySpace | None = None
    longest: float = 100.0

    @cached_property
    def _order(self) -> NDArray[np.int64]:
        return canonical_order(self.points)

    def thinned(self, most: int) -> NDArray[np.int64]:
        """Indices of at most `most` points: each k-th in their order by distance from the centre."""
        count = len(self.points)
        return self._order[np.linspace(0, count - 1, min(most, count)).round().astype(np.int64)]

    def sample(self, most: int) -> "SearchProblem":
        """The problem of an even sample of at most `most` points."""
        index = self.thinned(most)
        return self.take(index, len(index) / len(self.points))

    def take(self, index: NDArray[np.int64], fraction: float) -> "SearchProblem":
        """The problem of some points, that stand for a fraction of all."""
        names = ("points", "weights", "log_odds", "relative_noise")
        arrays: dict[str, Any] = {name: getattr(self, name)[index] for name in names}
        surroundings = None if self.surroundings is None else self.surroundings.take(index)
        empty = None if self.empty is None else self.empty.of_sample(fraction)
        return replace(self, **arrays, surroundings=surroundings, empty=empty)

    @property
    def fixed_mask(self) -> NDArray[np.bool_]:
        """(11,) or (12,): which parameters stay."""
        return np.isin(PART_OF_PARAMETER[: KINDS[self.kind].n_parameters], list(self.fixed))

    @property
    def n_estimated(self) -> int:
        """The number of parameters that are not fixed."""
        return int((~self.fixed_mask).sum())

    def with_fixed(self, candidates: Candidates) -> Candidates:
        """Candidates with the fixed values."""
        values: dict[str, Array] = dict(zip(PARTS, candidates.arrays))
        for name, value in self.fixed.items():
            values[name] = np.broadcast_to(np.log(value) if name == "semi_axes" else value, values[name].shape)
        return Candidates(self.kind, *values.values())
