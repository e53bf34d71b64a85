"""Which columns of a table are x, y, z and the normals, by their names; nothing is taken from their order alone."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from unicodedata import normalize

from quadriform.errors import ColumnsError, OptionError
from quadriform.words import first_of

Chosen = str | Sequence[str | int] | None
"""Names between commas, or a sequence of names or of positions from 0; None leaves it to the table."""

AXES = "xyz"
MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1e3, "km": 1e6, "um": 1e-3, "nm": 1e-6, "inch": 25.4, "ft": 304.8}
"""Units of length that headers may have, in millimetres."""
SPELLINGS = {
    "mm": "mm millimeter millimeters millimetre millimetres",
    "cm": "cm centimeter centimeters centimetre centimetres",
    "m": "m meter meters metre metres",
    "km": "km kilometer kilometers kilometre kilometres",
    "um": "um \u03bcm micron microns micrometer micrometers micrometre micrometres",
    "nm": "nm nanometer nanometers nanometre nanometres",
    "inch": "in inch inches",
    "ft": "ft foot feet",
}
UNITS = {word: unit for unit, words in SPELLINGS.items() for word in words.split()}
NO_LENGTHS = ("px", "pixel", "pixels", "voxel", "voxels", "vx", "index", "1", "-", "a.u.")

BRACKETS = re.compile(r"(.*?)[\s_]*(?:\[([^\]]*)\]|\(([^)]*)\)|/\s*(\w+))")
SUFFIX = re.compile(r"(.*?)(?:\s+in)?[\s_.:-]+(\w+)")
WORD = (
    "(?:pos|position|coord|coords|coordinate|coordinates|point|points|loc|location|center|centre|centroid|vertex|world)"
)
POINT = re.compile(rf"(?:{WORD}_?)?([xyz])(?:_?{WORD})?")
POINT_BY_NUMBER = re.compile(r"(?:points|point|xyz|pos|positions?|coords|coordinates|vertex|vertices)_([012])")
NORMAL = re.compile(r"(?:n|norm|normals?)_?([xyz])|([xyz])_?normal")
NORMAL_BY_NUMBER = re.compile(r"(?:normals?|n)_([012])")


@dataclass(frozen=True)
class Columns:
    """Where coordinates stand in a table.

    Attributes:
        points: positions of x, y and z, from 0.
        normals: positions of the components of the normals, or None.
        unit: of the lengths: a key of `MILLIMETRES`, or "unknown".
        note: what was assumed, one sentence, or empty.
    """

    points: tuple[int, int, int]
    normals: tuple[int, int, int] | None = None
    unit: str = "unknown"
    note: str = ""


@dataclass(frozen=True)
class _Name:
    """A column's name taken apart: what it stands for, such as "x", "nx" or "axis 0", how plainly, and its unit."""

    role: str
    is_plain: bool
    unit: str | None


def columns_of(names: Sequence[str], what: str) -> Columns:
    """The columns of a table whose columns have names.

    A column is x when it is called x, X, x_mm, "x [mm]", pos_x, "Position X", Points:0 and the like; plain letters come
    first. napari's axis-0, axis-1, axis-2 count the axes of an image as NumPy does: z, y, x.

    Args:
        names: of all columns, from left to right.
        what: how the message names the table.

    Raises:
        ColumnsError: no x, y and z, or two columns for one of them, or lengths in several units.
    """
    try:
        return _columns(names, what)
    except LookupError:
        raise ColumnsError(
            f"{what}: expected columns named x, y and z, found {_listed(names)}; say which of them are x, y and z, in "
            "this order: --columns NAME,NAME,NAME (columns= in Python)"
        ) from None


def _columns(names: Sequence[str], what: str) -> Columns:
    """The same; LookupError where there is no x, y and z."""
    parsed = [_parsed(name) for name in names]
    points, note = _three(list(AXES), parsed, names, what), ""
    if points is None:
        # napari orders axes as NumPy does, slowest first.
        points = _three(["axis 2", "axis 1", "axis 0"], parsed, names, what)
        note = "axis-0, axis-1, axis-2 are taken as z, y, x, as napari counts them; --columns chooses otherwise"
    if points is None or any(name.role == "axis 3" for name in parsed):
        raise LookupError
    normals = _three([f"n{axis}" for axis in AXES], parsed, names, what)
    return Columns(points, normals, _unit([parsed[position] for position in points], what), note)


def chosen_columns(chosen: str | Sequence[str | int], names: Sequence[str] | None, width: int, what: str) -> Columns:
    """The columns that the caller chose.

    Where the table names its columns, three of the names, for x, y and z, or six with the normals; where it does not,
    the names of the columns from left to right (those left out at the right are ignored), or three or six positions.

    Args:
        chosen: names between commas, or a sequence.
        names: of the table's columns, or None.
        width: how many columns there are.
        what: how the message names the table.

    Raises:
        OptionError: other names than the table's, too few or too many, or names without x, y and z.
        ColumnsError: two columns for one of them, or lengths in several units.
    """
    requested = [word.strip() for word in chosen.split(",")] if isinstance(chosen, str) else list(chosen)
    if names is None and all(isinstance(each, str) for each in requested):
        if len(requested) > width:
            raise OptionError(f"{what}: option columns names {len(requested)} columns, found {width}")
        try:
            return _columns([str(each) for each in requested], f"{what}: option columns")
        except LookupError:
            raise OptionError(
                f"{what}: option columns={chosen!r}: the columns of the table have no names; expected names for them "
                "from left to right, x, y and z among them, such as x,y,z,intensity"
            ) from None
    if len(requested) not in (3, 6):
        raise OptionError(
            f"{what}: option columns: expected three columns, or six with the normals, found {len(requested)}"
        )
    positions = [_position(each, names, width, what) for each in requested]
    if len(set(positions)) < len(positions):
        raise OptionError(f"{what}: option columns={chosen!r} takes a column twice")
    units = [] if names is None else [_parsed(names[position]) for position in positions[:3]]
    normals = (positions[3], positions[4], positions[5]) if len(positions) == 6 else None
    return Columns((positions[0], positions[1], positions[2]), normals, _unit(units, what))


def names_axes(names: Sequence[str]) -> bool:
    """Whether x, y and z, or the three axes of napari, are among the names of columns."""
    roles = {_parsed(name).role for name in names}
    return roles >= set(AXES) or roles >= {"axis 0", "axis 1", "axis 2"}


def unit_of(text: str) -> str | None:
    """The unit that a word means, a key of `MILLIMETRES`; "unknown" for pixels and such; None for other words."""
    word = normalize("NFKC", text).strip().lower()
    return "unknown" if word in NO_LENGTHS else UNITS.get(word)


def _position(each: str | int, names: Sequence[str] | None, width: int, what: str) -> int:
    """The position of a column by its name or number."""
    if isinstance(each, int) and not isinstance(each, bool) and -width <= each < width:
        return each % width
    found = [] if names is None else [position for position, name in enumerate(names) if name == each]
    if names is not None and not found:
        found = [position for position, name in enumerate(names) if name.strip().lower() == str(each).strip().lower()]
    if len(found) != 1:
        listed = "columns without names" if names is None else _listed(names)
        how = "twice" if found else "not there"
        raise OptionError(f"{what}: option columns: {each!r} is {how}; found {width} columns: {listed}")
    return found[0]


def _parsed(name: str) -> _Name:
    """The role of a column by its name, and its unit; the role is empty where the name has none."""
    text = normalize("NFKC", name).strip().strip("\"'").strip().lower()
    unit: str | None = None
    if found := BRACKETS.fullmatch(text):
        word = next(group for group in found.groups()[1:] if group is not None)
        text, unit = found[1], unit_of(word) or "unknown"
    elif (found := SUFFIX.fullmatch(text)) and found[2] not in ("in", "ft", "1") and found[2] in UNITS:
        text, unit = found[1], UNITS[found[2]]
    text = re.sub(r"[\s_.:-]+", "_", text).strip("_")
    return _Name(_role(text), len(text) == 1, unit)


def _role(text: str) -> str:
    if found := POINT.fullmatch(text):
        return found[1]
    if found := POINT_BY_NUMBER.fullmatch(text):
        return AXES[int(found[1])]
    if found := NORMAL.fullmatch(text):
        return f"n{found[1] or found[2]}"
    if found := NORMAL_BY_NUMBER.fullmatch(text):
        return f"n{AXES[int(found[1])]}"
    return text.replace("_", " ") if re.fullmatch(r"axis_\d", text) else ""


def _three(roles: list[str], parsed: list[_Name], names: Sequence[str], what: str) -> tuple[int, int, int] | None:
    """Positions of three roles, those by a plain letter before others; None where one is missing."""
    found = [[position for position, name in enumerate(parsed) if name.role == role] for role in roles]
    # A column that is just a letter is preferred to longer names with the same meaning.
    plain = [[position for position in positions if parsed[position].is_plain] for positions in found]
    chosen = plain if all(plain) else found
    if not all(chosen):
        return None
    for role, positions in zip(roles, chosen):
        if len(positions) > 1:
            both = " and ".join(repr(names[position]) for position in positions[:2])
            same = names[positions[0]] == names[positions[1]]
            how = "give them different names" if same else "choose by --columns (columns= in Python)"
            raise ColumnsError(f"{what}: two columns, {both}, could be {role}; {how}")
    (one,), (two,), (three,) = chosen
    return one, two, three


def _unit(coordinates: list[_Name], what: str) -> str:
    """The unit of all three coordinates."""
    units = {name.unit for name in coordinates}
    if len(units) > 1:
        listed = ", ".join(f"{name.role or '?'} in {name.unit or 'no unit'}" for name in coordinates)
        raise ColumnsError(f"{what}: expected one unit for x, y and z, found {listed}; bring them into one first")
    return next(iter(units), None) or "unknown"


def _listed(names: Sequence[str]) -> str:
    return first_of([repr(name[:40]) for name in names], 12)
