"""Pages without their drawings, which are half of what a small fit takes on the terminal; tests/report draws them."""

from markupsafe import Markup

from quadriform.report import charts, slices


def draw_nothing(patch):
    """Leave out charts and slices of images from pages, while the patch holds."""
    for name in ("histogram", "convergence", "curve", "bullseye"):
        patch.setattr(charts, name, lambda *values: Markup("<svg></svg>"))
    patch.setattr(slices, "slice_pictures", lambda *values: {})
