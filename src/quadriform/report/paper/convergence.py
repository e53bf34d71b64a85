"""The paper's iteration to its end: the error of each step against that of the default (Fig. 22)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from quadriform.fitting.fit import refine
from quadriform.fitting.result import Fit
from quadriform.report.paper.subjects import Box, Subject

LONGEST = 300
"""Iterations at most."""
STOP = 1e-5
"""The stop test: |X_{n+1} - X_n| below this share of the RMS radius of the data."""
WITHIN = 0.01
"""The error has converged when it stays within this share of its last value."""
STEPS = (1, 3, 10)
"""Iterations after which the distance of the points to the surface is measured, besides 0, 30 and the last."""


@dataclass(frozen=True)
class Convergence:
    """One set of data, iterated by the paper's method until the stop test.

    Attributes:
        subject: the data with its fits of 30 iterations and by default.
        long: the fit at the end.
        steps: iterations after which the error was measured.
        errors: RMS distance of the points to the surface then, in mm.
    """

    subject: Subject
    long: Fit
    steps: Sequence[int]
    errors: Sequence[float]

    @property
    def converged(self) -> int | None:
        """The first iteration from which on the error is within WITHIN of its last value; None: not by LONGEST."""
        if self.long.iterations == LONGEST:
            return None
        error = np.array([record.error for record in self.long.history])
        far = np.flatnonzero(np.abs(error - error[-1]) > WITHIN * error[-1])
        # iterations count from 1, and the first one within the limit follows the last one outside of it
        return int(far[-1]) + 2 if len(far) else 1


def measure_convergence(subject: Subject, box: Box) -> Convergence:
    """Iterate from the superquadric(s) of the subject's own fit by the paper's method."""
    start = subject.paper.model.surfaces

    def after(iterations: int, tolerance: float | None) -> Fit:
        """The fit after so many iterations."""
        return refine(start, subject.points, method="paper", box=box, iterations=iterations, tolerance=tolerance)

    long = after(LONGEST, STOP)
    # the history has the error of the least squares only; distances are measured on fits of so many steps
    errors = {0: subject.paper.superquadric_rms} | {count: after(count, None).rms for count in STEPS}
    errors |= {subject.paper.iterations: subject.paper.rms, long.iterations: long.rms}
    steps = sorted(errors)
    return Convergence(subject, long, steps, [errors[count] for count in steps])
