"""How far the surfaces of a ventricle reach beyond its base, where they are extrapolated and no volume counts."""

from collections.abc import Sequence

from quadriform.errors import WarningKind
from quadriform.shapes.model import DeformableModel
from quadriform.words import after_number

RESOLUTION = 16
"""Of the meshes by which the reach of surfaces beyond a base is measured."""


def reach_over_base(models: Sequence[DeformableModel]) -> float | None:
    """How far the surfaces of any frame reach beyond its base, in their unit, at least 0; None where there is none."""
    heights = [
        float(model.landmarks.base.heights(model.mesh(name, RESOLUTION).vertices).max())
        for model in models
        if model.landmarks.base is not None
        for name in model.surfaces
    ]
    return max(0.0, *heights) if heights else None


def reach_notes(models: Sequence[DeformableModel]) -> tuple[str, ...]:
    """BASE_NOT_OBSERVED, a note, of frames with a base: how far the surfaces reach beyond it."""
    reach = reach_over_base(models)
    if not reach:
        return ()
    unit = after_number(models[0].unit)
    text = (
        f"beyond the base the surface is not observed; there it reaches up to {reach:.3g}{unit}, which no volume counts"
    )
    return (f"{WarningKind.BASE_NOT_OBSERVED}: {text}",)
