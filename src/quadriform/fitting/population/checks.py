"""Checks of a prior beside points and options."""

from collections.abc import Mapping

import numpy as np

from quadriform.errors import InputError, OptionError
from quadriform.fitting.options import PaperOptions, TangentOptions
from quadriform.points import Array, Frame
from quadriform.shapes.prior import ShapePrior

LARGEST_RATIO = 10.0
"""Of the sizes of points and mean shape: beyond it one of them is in another unit."""
OF_PRIOR = ("box", "regularity", "strength", "max_error")
"""Options that a prior takes the place of."""


def check_no_others(**given: object) -> None:
    """Refuse options beside a prior that are not None, or another kind of superquadric than the usual one.

    Raises:
        OptionError: naming the option.
    """
    for name, value in given.items():
        if value is not None and (name, value) != ("kind", "ellipsoid"):
            raise OptionError(f"option {name}: not with prior=, which has its own superquadrics and their box")


def check_prior(
    prior: object, options: PaperOptions | TangentOptions, clouds: Mapping[str, Array], unit: str, space: str
) -> tuple[ShapePrior, TangentOptions]:
    """The prior and the options, if they can be used for points.

    Args:
        prior: as given.
        options: of the fit.
        clouds: name -> (n, 3) points.
        unit: of these, or "unknown".
        space: of these, or "unknown".

    Raises:
        OptionError: no prior, or options that it takes the place of.
        InputError: a prior of other surfaces, in another unit or frame, or of another size by an order of magnitude.
    """
    if not isinstance(prior, ShapePrior):
        raise OptionError(f"option prior: expected a prior, as of learn_prior or load, found {type(prior).__name__}")
    if isinstance(options, PaperOptions):
        raise OptionError("option prior is not one of method='paper'; use method='tangent'")
    for name in OF_PRIOR:
        if getattr(options, name) != getattr(TangentOptions(), name):
            raise OptionError(f"option {name}: not with prior=, which has its own box and weights")
    if prior.surfaces.keys() != clouds.keys():
        expected, found = ", ".join(prior.surfaces), ", ".join(clouds)
        raise InputError(f"points: the prior is of the surfaces {expected}, the points are of {found}; name them alike")
    check_world(prior, unit, space)
    _check_size(prior, clouds)
    return prior, options


def check_world(prior: ShapePrior, unit: str, space: str) -> None:
    """Refuse a prior in another unit or frame than points, where both are known.

    Raises:
        InputError: naming both.
    """
    for what, own, other in (("unit", prior.unit, unit), ("space", prior.space, space)):
        if "unknown" not in (own, other) and own != other:
            raise InputError(f"points: in the {what} {other}, the prior is in {own}; convert the points")


def _check_size(prior: ShapePrior, clouds: Mapping[str, Array]) -> None:
    size = Frame.of(np.concatenate(list(clouds.values()))).scale
    model = prior.mean_model()
    expected = Frame.of(np.concatenate([model.mesh(name, 8).vertices for name in model.surfaces])).scale
    if not 1 / LARGEST_RATIO < size / expected < LARGEST_RATIO:
        raise InputError(
            f"points: their RMS radius is {size:.3g}, that of the prior's mean shape {expected:.3g}; expected the same "
            "unit"
        )
