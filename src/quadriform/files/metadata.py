"""The frame and the unit that every file of ours is marked with."""

import re
from collections.abc import Mapping

from quadriform.errors import WarningKind, choose
from quadriform.shapes import spaces
from quadriform.shapes.record import ModelRecord

SPACES = (*spaces.SPACES, "unknown")
UNITS = ("mm", "m", "unknown")

SPACE = re.compile(rb"\bSPACE=(LPS|RAS)\b")
UNIT = re.compile(rb"\bUNIT=(mm|m)\b")
STATUS = re.compile(rb"\bSTATUS=(ok|warned|unreliable|unknown)\b")
WARNINGS = re.compile(rb"\bWARNINGS=([A-Z_,]+)")
OF_A_MESH = "the mesh is the surface of a model whose fit was warned of; the file of the model says more"
VTP_TEXT = re.compile(rb'<DataArray type="String" Name="(SPACE|UNIT|STATUS|WARNINGS)"[^>]*format="ascii">([\d\s]*)<')


def check_space_and_unit(space: str, unit: str) -> None:
    """Refuse marks that no file can carry.

    Raises:
        OptionError: naming the mark and what is allowed.
    """
    choose(space, SPACES, "space")
    choose(unit, UNITS, "unit")


def as_comment(metadata: Mapping[str, str]) -> str:
    """The metadata as one line for a comment or a header, such as "SPACE=LPS UNIT=mm"."""
    return " ".join(f"{name}={value}" for name, value in metadata.items())


def parse_space_and_unit(data: bytes) -> tuple[str, str]:
    """Frame and unit that the head of a mesh file is marked with; "unknown" where it is not.

    Args:
        data: the first bytes of the file. `SPACE=LPS` in a comment or header is what other programs write too; in
            .vtp it is field data, whose text VTK spells in character codes.
    """
    space, unit = (pattern.search(_with_field_data(data)) for pattern in (SPACE, UNIT))
    return (space[1].decode() if space else "unknown", unit[1].decode() if unit else "unknown")


def parse_record(data: bytes) -> ModelRecord | None:
    """Status and kinds of warnings of the fit that the head of a mesh file is marked with; None where it is not."""
    text = _with_field_data(data)
    status, kinds = STATUS.search(text), WARNINGS.search(text)
    if status is None:
        return None
    known = [kind for kind in (kinds[1].decode().split(",") if kinds else ()) if kind in tuple(WarningKind)]
    # A status that contradicts the warnings was edited by hand; nothing is known then.
    is_good = status[1] in (b"ok", b"unknown")
    if is_good == bool(known):  # one contradicts the other
        return ModelRecord()
    return ModelRecord(status[1].decode(), {WarningKind(kind): OF_A_MESH for kind in known})


def _with_field_data(data: bytes) -> bytes:
    for codes in VTP_TEXT.findall(data):
        data += b" " + codes[0] + b"=" + bytes(int(code) for code in codes[1].split() if 0 < int(code) < 128)
    return data
