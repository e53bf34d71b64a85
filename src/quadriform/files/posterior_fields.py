"""The posterior of a moving model as a field of its document: samples in single precision, as text in base 64."""

import base64
import binascii
from typing import Any

import numpy as np

from quadriform.files.strict import Field
from quadriform.shapes.posterior import Posterior

PARTS = ("source", "samples", "float32")
LITTLE = np.dtype("<f4")


def posterior_document(found: Posterior | None) -> dict[str, Any] | None:
    """The field; None where the posterior is not known."""
    if found is None:
        return None
    values = found.deviations.astype(LITTLE).tobytes()
    return dict(zip(PARTS, (found.source, len(found), base64.b64encode(values).decode("ascii"))))


def read_posterior(field: Field, shape: tuple[int, ...]) -> Posterior | None:
    """The posterior in a document.

    Args:
        field: null where it is not known.
        shape: of the control points of the model.

    Raises:
        FileFormatError: a field that is missing, unknown or wrong, or numbers that are not so many or not finite.
    """
    if field.value is None:
        return None
    field.only(PARTS)
    count, text = field.member("samples"), field.member("float32")
    if count.whole() < 1:
        count.refuse("one sample or more")
    try:
        data = base64.b64decode(text.text(), validate=True)
    except (binascii.Error, ValueError):
        text.refuse("numbers in base 64")
    expected = count.whole() * int(np.prod(shape))
    if len(data) != expected * LITTLE.itemsize:
        text.refuse(f"{expected} numbers of 4 bytes, as samples and control points need", f"{len(data)} bytes")
    values = np.frombuffer(data, LITTLE).reshape(count.whole(), *shape)
    return text.build(Posterior, values, field.member("source").line())
