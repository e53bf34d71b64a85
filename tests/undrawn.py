"""Pages without their drawings, which are half of what a small fit takes on the terminal; tests/report draws them."""

import numpy as np
from markupsafe import Markup

from quadriform.report import charts, reports, slices
from quadriform.report.viewer import ScalarField


def draw_nothing(patch):
    """Leave out charts, slices of images and the uncertainty of surfaces from pages, while the patch holds."""
    for name in ("histogram", "convergence", "curve", "bullseye"):
        patch.setattr(charts, name, lambda *values: Markup("<svg></svg>"))
    patch.setattr(slices, "slice_pictures", lambda *values: {})
    patch.setattr(reports, "uncertainty_field", _of_nothing)


def _of_nothing(fit):
    """No value is known: one for each of the points at which the page would show it."""
    return ScalarField("uncertainty", "mm", {name: [np.full(866, np.nan)] for name in fit.model.surfaces})
