"""The three other kinds of superquadric (paper 2), fitted and refined by the same algorithm."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from quadriform import examples
from quadriform.fitting.fit import fit
from quadriform.fitting.result import Fit, SuperquadricFit, rms
from quadriform.fitting.superquadric.fit import fit_superquadric
from quadriform.points import Array
from quadriform.report.paper.subjects import Box
from quadriform.shapes.barr import bend
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

TRUE = (
    Superquadric("toroid", np.array((15.0, 15.0, 20.0)), np.array((0.7, 1.0)), hole_radius=2.3),
    Superquadric("hyperboloid1", np.array((25.0, 20.0, 30.0)), np.array((0.8, 0.7)), height=50),
    Superquadric("hyperboloid2", np.array((15.0, 20.0, 20.0)), np.array((1.0, 0.8)), height=50),
)
CURVATURES = (0.008, 0.002, 0.001)
"""Curvatures of the bends in 1 / mm; the ends move by 1 to 3 mm."""


@dataclass(frozen=True)
class Bent:
    """A body of one kind: its superquadric found, and refined after the body was bent.

    Attributes:
        truth: the superquadric.
        points: (n, 3) of it, with noise of 0.5 mm.
        found: the superquadric by the paper's criterion, from these points.
        error: RMS distance of the true points to that, in mm.
        bent: (n, 3) the points after a bend.
        fits: of them, by the paper's method and by default.
    """

    truth: Superquadric
    points: Array
    found: SuperquadricFit
    error: float
    bent: Array
    fits: tuple[Fit, Fit]


Kinds = Sequence[Bent]


def measure_kinds(box: Box, resolution: int = 10) -> Kinds:
    """One body of each kind."""
    return [_bent(truth, curvature, box, resolution) for truth, curvature in zip(TRUE, CURVATURES)]


def _bent(truth: Superquadric, curvature: float, box: Box, resolution: int) -> Bent:
    surface = truth.grid(resolution)[0]
    points = examples.noisy(surface)
    found = fit_superquadric(points, truth.kind, "paper")
    # distances are those of models; in an undeformed box they are the superquadric's own
    alone = DeformableModel({"surface": found.superquadric}, ControlBox.around(found.superquadric))
    error = rms(alone.distance(surface))
    moved = bend(points, curvature)
    fits = (fit(moved, kind=truth.kind, method="paper", box=box), fit(moved, kind=truth.kind, box=box))
    return Bent(truth, points, found, error, moved, fits)
