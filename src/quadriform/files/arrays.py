"""NumPy arrays from .npy and .npz: headers are compared with the bytes that follow before anything is allocated."""

import io
import struct
import tokenize
import warnings
import zipfile
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError, QuadriformError
from quadriform.files.reading import check_budget, signature

MAX_EXPANSION = 200
"""An archive may not state more than this many times its own size (above `SMALL`)."""
SMALL = 64 * 1024**2

DAMAGED = (ValueError, TypeError, KeyError, SyntaxError, RecursionError, tokenize.TokenError, struct.error)


def parse_npy(data: bytes, where: str) -> NDArray[Any]:
    """Return the array of a .npy file; numbers and text only, never pickled objects.

    Raises:
        FileFormatError: not .npy, damaged, too short or too long for its header, or of a type with objects or nested
            fields.
        FileLimitError: the header declares more than the budget.
    """
    stream = io.BytesIO(data)
    shape, fortran_order, dtype = _npy_header(stream, data, where)
    if not all(kind.kind in "biufcSU" for kind in _kinds(dtype)):
        raise FileFormatError(f"{where}: expected an array of plain numbers, found type {dtype}")
    if any(length < 0 for length in shape):
        raise FileFormatError(f"{where}: the header has a negative length in shape {shape}")
    declared = dtype.itemsize
    for length in shape:  # Python integers: NumPy's would overflow silently
        declared *= length
    check_budget(declared, where)
    found = len(data) - stream.tell()
    if declared != found:
        raise FileFormatError(f"{where}: the header declares {declared} bytes of shape {shape}, found {found}")
    # A view of the bytes: no copy, and nothing is executed.
    values = np.frombuffer(data, dtype=dtype, offset=stream.tell()) if found else np.zeros(0, dtype)
    return values.reshape(shape, order="F" if fortran_order else "C")


def _kinds(dtype: np.dtype[Any]) -> list[np.dtype[Any]]:
    """The types of an array's numbers: its own, or those of its fields, which may be rows of numbers themselves."""
    return [dtype] if dtype.names is None else [dtype[name].base for name in dtype.names]


def _npy_header(stream: io.BytesIO, data: bytes, where: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    try:
        version = np.lib.format.read_magic(stream)
        readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that Python 2 wrote its lengths with an L is no fault
            return readers[version](stream)
    except DAMAGED as error:
        raise FileFormatError(f"{where}: expected a .npy array, found {signature(data)} ({_first(error)})") from error


def parse_npz(data: bytes, where: str) -> dict[str, NDArray[Any]]:
    """Return the arrays of a .npz archive by name; every checksum is verified.

    Raises:
        FileFormatError: no zip, damaged, encrypted, doubled or outside names, or a member that is no .npy.
        FileLimitError: the members state more than the budget.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            _check_members(archive.infolist(), len(data), where)
            members = {info.filename.removesuffix(".npy"): archive.read(info) for info in archive.infolist()}
    except QuadriformError:
        raise
    except Exception as error:  # zipfile passes on the errors of whatever packer a member names
        raise FileFormatError(
            f"{where}: expected a .npz archive, found {signature(data)} that cannot be unpacked ({_first(error)})"
        ) from error
    return {name: parse_npy(content, f"{where}, array {name!r}") for name, content in members.items()}


def _check_members(members: list[zipfile.ZipInfo], size: int, where: str) -> None:
    names = [info.filename for info in members]
    if len(set(names)) != len(names):
        raise FileFormatError(f"{where}: the archive has two members of one name")
    for info in members:
        path = PurePosixPath(info.filename.replace("\\", "/"))
        if path.is_absolute() or ".." in path.parts or info.flag_bits & 1 or not info.filename.endswith(".npy"):
            raise FileFormatError(f"{where}: the archive has a member {info.filename!r} that is no plain .npy array")
    declared = sum(info.file_size for info in members)
    check_budget(declared, where)
    if declared > max(SMALL, MAX_EXPANSION * size):
        limit = f"at most {MAX_EXPANSION} times {size} bytes"
        raise FileFormatError(f"{where}: expected to unpack to {limit}, found {declared}")


def _first(error: Exception) -> str:
    """First line of an error's text, cut to the length of a line on a terminal."""
    return (str(error).splitlines() or [type(error).__name__])[0][:120]
