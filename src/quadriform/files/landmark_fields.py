"""The landmarks of a ventricle as a field of the document of its model."""

from typing import Any

import numpy as np

from quadriform.files.strict import Field
from quadriform.shapes.landmarks import NO_POINTS, NONE_KNOWN, BasePlane, Landmarks

PARTS = ("base", "rv_inserts")
BASE = ("point", "direction", "from")
UNIT = 1e-9
"""A direction that is longer or shorter than 1 by more is none."""


def landmarks_document(found: Landmarks) -> dict[str, Any] | None:
    """The field; None where nothing is known."""
    if found.base is None and not len(found.rv_inserts):
        return None
    return {"base": _base_document(found), "rv_inserts": found.rv_inserts.tolist()}


def _base_document(found: Landmarks) -> dict[str, Any] | None:
    if found.base is None:
        return None
    return dict(zip(BASE, (found.base.point.tolist(), found.base.direction.tolist(), found.base_from)))


def read_landmarks(field: Field) -> Landmarks:
    """The landmarks in a document.

    Raises:
        FileFormatError: a field that is missing, unknown or wrong.
    """
    if field.value is None:
        return NONE_KNOWN
    field.only(PARTS)
    inserts, base = field.member("rv_inserts"), field.member("base")
    points = inserts.numbers((None, 3)) if inserts.items() else NO_POINTS
    if base.value is None:
        return Landmarks(rv_inserts=points)
    base.only(BASE)
    direction = base.member("direction").numbers((3,))
    if not abs(np.linalg.norm(direction) - 1) <= UNIT:
        base.member("direction").refuse("a direction of length 1")
    plane = BasePlane(base.member("point").numbers((3,)), direction)
    return base.build(Landmarks, plane, base.member("from").line(), points)
