"""Points and their two fits, by the paper's own algorithm and by default."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from quadriform.fitting.fit import fit
from quadriform.fitting.paper.displacement import data_to_model
from quadriform.fitting.result import Fit, rms
from quadriform.point_sets import ALONE
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel

SYNTHETIC = "synthetic, made by quadriform (MIT)"
SAMPLE = 20
"""Cells along a cube's edge for the model points of a displacement field, as in the paper's method itself: 2,402."""

Box = tuple[int, int, int]


@dataclass(frozen=True)
class Subject:
    """Points and their fits.

    Attributes:
        name: what it is, in a few words.
        source: data, author and licence, for under its pictures.
        points: (n, 3) in mm by surface; a single one is called "surface".
        paper: the fit by the paper's algorithm: P7 by SVD with all singular values above rounding, 30 iterations.
        default: the fit with all defaults.
        surface: the one that pictures show.
        note: what has to be known to compare the fits fairly; a sentence, or nothing.
    """

    name: str
    source: str
    points: Mapping[str, Array]
    paper: Fit
    default: Fit
    surface: str = ALONE
    note: str = ""

    @property
    def cloud(self) -> Array:
        """The points (n, 3) that pictures show."""
        return self.points[self.surface]

    @property
    def length(self) -> float:
        """The largest extent of the points along their principal axes, in mm."""
        centred = self.cloud - self.cloud.mean(axis=0)
        # along principal axes, because a heart is oblique in its image
        return float(np.ptp(centred @ np.linalg.svd(centred, full_matrices=False)[2].T, axis=0).max())

    @property
    def fits(self) -> tuple[Fit, Fit]:
        """By the paper's method, and by default."""
        return self.paper, self.default


def fitted(
    name: str,
    source: str,
    points: Mapping[str, Array] | Array,
    box: Box = (5, 5, 5),
    surface: str = ALONE,
    note: str = "",
) -> Subject:
    """A subject with both fits."""
    named = points if isinstance(points, Mapping) else {surface: points}
    return Subject(name, source, named, fit(named, method="paper", box=box), fit(named, box=box), surface, note)


@dataclass(frozen=True)
class Sparse:
    """A complete cloud, and what is left of it (Fig. 9).

    Attributes:
        whole: the complete data.
        planes: points near three orthogonal planes.
        grid: where the lines of a regular lattice meet the surface.
    """

    whole: Subject
    planes: Subject
    grid: Subject

    @property
    def parts(self) -> tuple[Subject, Subject]:
        """Both reduced clouds."""
        return self.planes, self.grid

    def distance(self, part: Subject, method: int) -> float:
        """RMS distance in mm from the surface of the complete data to that of a part, both by method 0 or 1."""
        surface = self.whole.fits[method].model.mesh(self.whole.surface, SAMPLE).vertices
        return rms(part.fits[method].model.distance(surface, part.surface))


@dataclass(frozen=True)
class Walls:
    """Two surfaces in one box, and each in a box of its own (3.4.2).

    Attributes:
        together: both in one box.
        alone: each by its name.
    """

    together: Subject
    alone: Mapping[str, Subject]


def walls(name: str, source: str, points: Mapping[str, Array], box: Box, note: str = "") -> Walls:
    """All fits of two surfaces; pictures show the inner one, "endo"."""
    alone = {each: fitted(f"{name}, {each}", source, {each: cloud}, box, each) for each, cloud in points.items()}
    return Walls(fitted(name, source, points, box, "endo", note), alone)


def before(model: DeformableModel) -> DeformableModel:
    """The model in its undeformed box."""
    # the superquadrics alone: without displacement the box is the identity
    return replace(model, box=model.box.with_control_points(model.box.rest))


def displacement_field(model: DeformableModel, cloud: Array, surface: str) -> tuple[Array, Array]:
    """The paper's displacement field (3.2.2) between a model and data (n, 3): model points (m, 3) and dX (m, 3).

    Each data point chooses its closest model point; a model point that none chose takes an interpolated displacement.
    """
    at = model.mesh(surface, SAMPLE).vertices
    return at, data_to_model(at, cloud)
