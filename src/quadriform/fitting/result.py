"""What a fit returns beside the model: residuals, noise, convergence, support by the data, and warnings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import UNRELIABLE, FitError, OptionError, Warnings, status_of, without_notes
from quadriform.fitting.least_squares.uncertainty import EnrichedBox
from quadriform.fitting.posterior import Extrapolation, posterior_of
from quadriform.fitting.support import Support
from quadriform.fitting.threads import one_blas_thread
from quadriform.point_sets import ALONE
from quadriform.points import Array
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.posterior import Posterior
from quadriform.shapes.record import Estimate
from quadriform.shapes.superquadric import Superquadric
from quadriform.words import listed, summary

Value = TypeVar("Value")
COARSE = 16
"""Resolution of the meshes on which samples of a posterior are measured: deviations need few digits."""
HalfSpace = tuple[Array, Array]
"""A point of a plane and the unit direction to the side that is meant, (3,) each."""
Progress = Callable[[int, int], None]
"""Called with (steps done, steps in all)."""


class Warned:
    """Status and texts of a result with warnings; those that leave the status "ok" are kept among its notes."""

    warnings: Warnings
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        warnings, notes = without_notes(self.warnings)
        object.__setattr__(self, "warnings", warnings)
        object.__setattr__(self, "notes", tuple(dict.fromkeys((*self.notes, *notes))))

    @property
    def status(self) -> str:
        """The reliability: "ok"; "warned", usable where the warnings allow; "unreliable", not to be used."""
        return status_of(self.warnings)

    @property
    def _texts(self) -> list[str]:
        """The warnings, each with its kind."""
        return [f"{kind}: {text}" for kind, text in self.warnings.items()]


@dataclass(frozen=True)
class Iteration:
    """One iteration of the paper's method, or one round of the default method; lengths in the unit of the data.

    Attributes:
        error: of the paper's method the RMS distance between the model points after the step and their targets; of the
            default method the noise.
        box_motion: RMS motion of the control points in this step, |P_{n+1} - P_n|.
        box_displacement: RMS distance of the control points from the undeformed box, |P_{n+1} - P_0|.
        surface_motion: RMS motion of the model points in this step, |X_{n+1} - X_n|: the stop test.
    """

    error: float
    box_motion: float
    box_displacement: float
    surface_motion: float

    def scaled(self, scale: float) -> Iteration:
        """The record with its lengths times `scale`."""
        lengths = (self.error, self.box_motion, self.box_displacement, self.surface_motion)
        return Iteration(*(scale * length for length in lengths))


@dataclass(frozen=True, repr=False)
class SuperquadricFit(Warned):
    """A fitted superquadric.

    Attributes:
        superquadric: the fitted one, in the unit and frame of the points.
        warnings: kind -> sentence.
        rank: of the derivatives at the solution; below 11 (12 for the toroid) the points do not determine it.
        condition: largest over smallest singular value of the same, lengths in units of the cloud's RMS radius.
        covariance: (11, 11) or (12, 12), in the order a1 a2 a3, e1 e2, rotations about the object's own three axes
            (radians), tx ty tz, hole radius; unit of the data; zero for what was fixed.
        inliers: (n,) probability of each point to be of the surface, 0 for points of weight 0.
        noise: standard deviation of the inliers' distances, in the unit of the data.
        history: the criterion P3 after each iteration; for the robust fit the least standard deviation of the noise.
        iterations: their number.
        notes: as for `Fit`.
    """

    superquadric: Superquadric
    warnings: Warnings
    rank: int
    condition: float
    covariance: Array
    inliers: Array
    noise: float
    history: tuple[float, ...]
    iterations: int
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        s = self.superquadric
        fitted = f"{s.kind} with semi-axes {listed(s.semi_axes)}, exponents {listed(s.exponents)}"
        points = f"{len(self.inliers)} points, noise {self.noise:.4g}, {self.iterations} iterations"
        return summary(f"SuperquadricFit: {self.status}", fitted, points, *self._texts, *self.notes)


@dataclass(frozen=True, repr=False)
class Fit(Warned):
    """A fitted deformable model.

    Attributes:
        model: the fitted one, in the unit and frame of the points.
        warnings: kind -> sentence.
        residuals: signed distance of each point to its surface, (n,), negative inside; with several surfaces a
            mapping from their names.
        superquadric_residuals: the same for the superquadric(s) before refinement.
        history: one record for each iteration.
        strength: of the regularisation, as `refine` takes it.
        noise: standard deviation of the points along the normal, in their unit; for the paper's method their RMS.
        inliers: probability of each point to be of its surface, (n,) or a mapping; all one where none was estimated.
        covariance: posterior covariance (3 k, 3 k) of the k control points, coordinates of a point together, in
            squared units; None for the paper's method, which estimates none.
        enriched: the same data with more control points, for `uncertainty`; None for the paper's method.
        notes: remarks that leave the status "ok", one sentence each.
        support: surface -> the shares of its area and volume that data supports, and its extent beyond the data.
        extrapolations: surface -> what is known of it without data, for `uncertainty`; none by `refine`.
        prior_distance: Mahalanobis distance of the shape to the population of the prior, over the modes of this: its
            square has as its mean over the population the number of modes. None without a prior.
    """

    model: DeformableModel
    warnings: Warnings
    residuals: Array | dict[str, Array]
    superquadric_residuals: Array | dict[str, Array]
    history: tuple[Iteration, ...]
    strength: float
    noise: float
    inliers: Array | dict[str, Array]
    covariance: Array | None = None
    enriched: EnrichedBox | None = None
    notes: tuple[str, ...] = ()
    support: Mapping[str, Support] = field(default_factory=dict)
    extrapolations: Mapping[str, Extrapolation] = field(default_factory=dict)
    prior_distance: float | None = None

    def __repr__(self) -> str:
        numbers = f"RMS distance {self.rms:.4g}, noise {self.noise:.4g}, strength {self.strength:.2g}"
        counts = " x ".join(map(str, self.model.box.control_points.shape[:3]))
        model = f"{', '.join(self.model.surfaces)} in {counts} control points, {self.model.n_parameters} parameters"
        return summary(f"Fit: {self.status}", f"{self.n_points} points, {numbers}", model, *self._texts, *self.notes)

    def __post_init__(self) -> None:
        """Copy status, warnings and notes to the record of the model, also after `dataclasses.replace`."""
        super().__post_init__()
        record = replace(self.model.record, status=self.status, warnings=self.warnings, notes=self.notes)
        record = replace(
            record,
            supported={name: each.area for name, each in self.support.items()},
            extends_beyond={name: each.extends_beyond for name, each in self.support.items()},
        )
        object.__setattr__(self, "model", replace(self.model, record=record))

    @one_blas_thread
    def uncertainty(self, points: ArrayLike, surface: str | None = None) -> Array:
        """One standard deviation (n,) of the surface along its normal, at the surface points nearest to (n, 3) points.

        It covers the noise of the data, missing data, and too few control points; and where there is no data nearby,
        how well the superquadric is known and how far the refinement moved the surface from it. In the unit of the
        data.

        Raises:
            OptionError: the fit has no covariance (method="paper").
        """
        if self.enriched is None:
            raise OptionError("uncertainty: method='paper' estimates none; use method='tangent'")
        foot = self.model.foot_points(points, surface)
        deviation = self.enriched.deviation(self.model.box, foot.origins, foot.normals)
        extrapolation = self.extrapolations.get(self._named(surface))
        if extrapolation is None:
            return deviation
        in_data = foot.points @ self.enriched.rotation_to(self.model.box)  # in the coordinates of the data
        return np.hypot(deviation, np.sqrt(extrapolation.variances(in_data)))

    @cached_property
    def posterior(self) -> Posterior | None:
        """Samples of the control points with the variances of `uncertainty`; None for the paper's method."""
        if self.enriched is None:
            return None
        return one_blas_thread(posterior_of)(self.model, self.enriched, self.extrapolations)

    def _sd(self, measure: Callable[[DeformableModel], float]) -> float | None:
        """The standard deviation of a measure of the model."""
        return replace(self.model, posterior=self.posterior).deviation_of(measure)

    @property
    def supported(self) -> float | dict[str, float]:
        """Share [0, 1] of the area of the surface that data supports.

        With several surfaces a mapping from their names.
        """
        return unnamed({name: each.area for name, each in self.support.items()})

    @property
    def extends_beyond(self) -> float | dict[str, float]:
        """The largest extent of the surface beyond the data in any direction, in the unit of the points.

        With several surfaces a mapping from their names.
        """
        return unnamed({name: each.extends_beyond for name, each in self.support.items()})

    def volume(self, surface: str | None = None) -> Estimate:
        """The enclosed volume of a surface in cubed units, with the share of it that lies below supported area.

        Its standard deviation is by `posterior`, that of the closed surface with its part without data.

        Args:
            surface: name; None for the first.

        Raises:
            OptionError: unknown name.
        """
        found = self._support_of(surface)
        supported, sd = None if found is None else found.volume, self._sd(lambda m: m.mesh(surface, COARSE).volume())
        return Estimate(self.model.volume(surface), self._power(3), supported, sd)

    def area(self, surface: str | None = None) -> Estimate:
        """The area of a surface in squared units, with the share of it that data supports; deviation as in `volume`.

        Args:
            surface: name; None for the first.

        Raises:
            OptionError: unknown name.
        """
        found = self._support_of(surface)
        supported, sd = None if found is None else found.area, self._sd(lambda m: m.mesh(surface, COARSE).area())
        return Estimate(self.model.area(surface), self._power(2), supported, sd)

    def _support_of(self, surface: str | None) -> Support | None:
        return self.support.get(self._named(surface))

    def _named(self, surface: str | None) -> str:
        return next(iter(self.model.surfaces)) if surface is None else surface

    def _power(self, exponent: int) -> str:
        """The unit of areas or volumes; empty where that of the points is not known."""
        return "" if self.model.unit == "unknown" else f"{self.model.unit}^{exponent}"

    def with_estimates(self) -> Fit:
        """The fit whose model also has volume and area of each surface, with the shares of data, and the posterior."""
        named = {name: "" if name == ALONE else f" {name}" for name in self.model.surfaces}
        estimates = {f"volume{text}": self.volume(name) for name, text in named.items()}
        estimates |= {f"area{text}": self.area(name) for name, text in named.items()}
        record = replace(self.model.record, estimates=estimates)
        return replace(self, model=replace(self.model, record=record, posterior=self.posterior))

    @property
    def iterations(self) -> int:
        """The number of iterations."""
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
        """The number of points that were fitted."""
        return len(flat(self.residuals))

    @property
    def compression_ratio(self) -> float:
        """Coordinates of the points over parameters of the model: 3 n / n_parameters."""
        return 3 * self.n_points / self.model.n_parameters

    def require_ok(self) -> Fit:
        """The fit itself when its status is "ok".

        Raises:
            FitError: there are warnings; the message has them.
        """
        if self.warnings:
            raise FitError("; ".join(self._texts))
        return self

    def require_usable(self) -> Fit:
        """The fit itself unless its status is "unreliable".

        Raises:
            FitError: the status is "unreliable"; the message has the warnings.
        """
        return self.require_ok() if self.status == UNRELIABLE else self


@dataclass(frozen=True)
class Result:
    """A refinement by either method, in the centred, scaled frame.

    Attributes:
        model: refined.
        history: one record a round.
        strength: that was used.
        sigma: standard deviation along the normal; None where none is estimated.
        covariance: of the control points, or None.
        enriched: the same data in a box with more control points, or None.
        inliers: name -> probabilities, or None.
        warnings: about the refinement itself.
        half_space: where no data is expected.
        counted: name -> which points have a weight, or None for all.
        starts: name -> the superquadrics that were fitted, in this frame; none where they were given.
        prior_distance: of a fit with a prior, as `Fit.prior_distance`; else None.
    """

    model: DeformableModel
    history: tuple[Iteration, ...]
    strength: float
    sigma: float | None = None
    covariance: Array | None = None
    enriched: EnrichedBox | None = None
    inliers: dict[str, Array] | None = None
    warnings: Warnings = field(default_factory=dict)
    half_space: HalfSpace | None = None
    counted: dict[str, NDArray[np.bool_]] | None = None
    starts: Mapping[str, SuperquadricFit] = field(default_factory=dict)
    prior_distance: float | None = None


def unnamed(values: dict[str, Value]) -> Value | dict[str, Value]:
    """The value of a single surface without a name of its own, or else the mapping."""
    return values[ALONE] if values.keys() == {ALONE} else values


def flat(residuals: Array | dict[str, Array]) -> Array:
    """Residuals of all surfaces as one array."""
    return np.concatenate(list(residuals.values())) if isinstance(residuals, dict) else residuals


def rms(residuals: Array | dict[str, Array]) -> float:
    """Root of the mean square of all residuals."""
    return float(np.sqrt((flat(residuals) ** 2).mean()))
