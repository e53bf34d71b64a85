"""What words on a command line or in a table mean: numbers between commas, ranges; and text that is safe to show."""

from unicodedata import category

from quadriform.errors import OptionError


def numbers(text: str, count: int, option: str) -> tuple[int, ...]:
    """Whole numbers between commas.

    Raises:
        OptionError: not `count` of them.
    """
    parts = text.split(",")
    try:
        values = tuple(int(part) for part in parts)
    except ValueError:
        values = ()
    if len(values) != count:
        raise OptionError(f"option {option}={text!r}: expected {count} whole numbers between commas")
    return values


def ranges(text: str, option: str) -> tuple[tuple[int, int], ...]:
    """Three voxel ranges i0:i1,j0:j1,k0:k1.

    Raises:
        OptionError: something else.
    """
    try:
        found = tuple((int(low), int(high)) for low, high in (part.split(":") for part in text.split(",")))
    except ValueError:
        found = ()
    if len(found) != 3 or any(not 0 <= low < high for low, high in found):
        raise OptionError(f"option {option}={text!r}: expected i0:i1,j0:j1,k0:k1 with 0 <= i0 < i1 and so on")
    return found


def plain(text: str) -> str:
    """The text on one line that every file and terminal can hold: control characters and lone surrogates as escapes."""
    return "".join(_escaped(letter) if category(letter) in ("Cc", "Cs", "Zl", "Zp") else letter for letter in text)


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape").decode("ascii")
