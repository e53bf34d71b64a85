"""What a fit returns beside the model: how good it is, how it went, and what to be wary of."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from quadriform.errors import FitError, Warnings
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

Progress = Callable[[int, int], None]
"""Called with (steps done, steps in all)."""


@dataclass(frozen=True)
class Iteration:
    """One turn of the two-step iteration; lengths in the unit of the data.

    Attributes:
        error: RMS distance between the model points after the step and where they were wanted.
        box_motion: RMS motion of the control points in this step, |P_{n+1} - P_n|.
        box_displacement: RMS distance of the control points from the undeformed box, |P_{n+1} - P_0|.
        surface_motion: RMS motion of the model points in this step, |X_{n+1} - X_n|: the stop test.
    """

    error: float
    box_motion: float
    box_displacement: float
    surface_motion: float


@dataclass(frozen=True)
class SuperquadricFit:
    """A fitted superquadric.

    Attributes:
        superquadric: the answer, in the unit and frame of the points.
        warnings: kind -> sentence.
        rank: of the derivatives at the answer; below 11 (12 for the toroid) the points do not determine it.
        condition: largest over smallest singular value of the same, lengths in units of the cloud's RMS radius.
        history: the criterion after each iteration.
        iterations: how many there were.
    """

    superquadric: Superquadric
    warnings: Warnings
    rank: int
    condition: float
    history: tuple[float, ...]
    iterations: int

    @property
    def status(self) -> str:
        """The word "ok", or "warned" when there are warnings."""
        return "warned" if self.warnings else "ok"


@dataclass(frozen=True)
class Fit:
    """A fitted deformable model.

    Attributes:
        model: the answer, in the unit and frame of the points.
        warnings: kind -> sentence.
        residuals: signed distance of each point to its surface, (n,), negative inside; with several surfaces a
            mapping from their names.
        superquadric_residuals: the same for the superquadric(s) before refinement.
        history: one record for each iteration.
        strength: how strongly the box was held, as `refine` takes it.
    """

    model: DeformableModel
    warnings: Warnings
    residuals: Array | dict[str, Array]
    superquadric_residuals: Array | dict[str, Array]
    history: tuple[Iteration, ...]
    strength: float
    options: dict[str, object] = field(default_factory=dict)

    @property
    def status(self) -> str:
        """The word "ok", or "warned" when there are warnings."""
        return "warned" if self.warnings else "ok"

    @property
    def iterations(self) -> int:
        """How many turns of the two-step iteration were made."""
        return len(self.history)

    @property
    def rms(self) -> float:
        """RMS distance of the points to the model, in their unit."""
        return rms(self.residuals)

    @property
    def superquadric_rms(self) -> float:
        """RMS distance of the points to the superquadric(s) alone."""
        return rms(self.superquadric_residuals)

    @property
    def n_points(self) -> int:
        """How many points were fitted."""
        return len(flat(self.residuals))

    @property
    def compression_ratio(self) -> float:
        """Numbers in the points over numbers in the model: 3 n / n_parameters."""
        return 3 * self.n_points / self.model.n_parameters

    def require_ok(self) -> "Fit":
        """Return itself when the status is "ok".

        Raises:
            FitError: there are warnings; the message holds them.
        """
        if self.warnings:
            raise FitError("; ".join(f"{kind}: {text}" for kind, text in self.warnings.items()))
        return self


def flat(residuals: Array | dict[str, Array]) -> Array:
    """Residuals of all surfaces as one array."""
    return np.concatenate(list(residuals.values())) if isinstance(residuals, dict) else residuals


def rms(residuals: Array | dict[str, Array]) -> float:
    """Root of the mean square of all residuals."""
    return float(np.sqrt((flat(residuals) ** 2).mean()))
