"""What candidates for a superquadric lose besides their distances from points."""

from dataclasses import dataclass
from typing import Protocol

from quadriform.fitting.mixture import Mixture
from quadriform.fitting.superquadric.candidates import Candidates
from quadriform.points import Array


@dataclass(frozen=True)
class PenaltyTerms:
    """A penalty at M candidates: log likelihood that is lost, its gradient and matrix as those of weighted squares.

    Attributes:
        cost: (M,).
        gradient: (M, p), times the square of sigma.
        matrix: (M, p, p), likewise, of Gauss and Newton.
    """

    cost: Array
    gradient: Array
    matrix: Array


class Penalty(Protocol):
    """What candidates lose besides their distances from points."""

    def __call__(self, candidates: Candidates, mixture: Mixture) -> PenaltyTerms:
        """Its terms at candidates."""

    def scaled(self, factor: float) -> "Penalty":
        """The same for a fraction of the points."""
