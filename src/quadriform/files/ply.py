"""What a PLY's header promises, held against its bytes: trimesh fills up what is not there, or leaves it out."""

import re
from itertools import pairwise

import numpy as np

from quadriform.errors import FileFormatError
from quadriform.files.reading import check_budget, signature

ELEMENT = re.compile(rb"^element\s+(\S+)\s+(\d+)\s*$", re.MULTILINE)
SIZES = {"char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2, "int": 4}
SIZES |= {"uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4, "double": 8, "float64": 8}
END = re.compile(rb"end_header\r?\n")


def ply_claims(data: bytes, where: str) -> dict[str, int]:
    """Element counts of the header, held against the bytes that follow before anything is allocated.

    Raises:
        FileFormatError: no PLY, or other rows, bytes or corners than promised.
        FileLimitError: beyond the budget.
    """
    header, end, body = data.partition(b"end_header")
    if not data.startswith(b"ply") or not end:
        raise FileFormatError(f"{where}: expected a PLY header, found {signature(data)}")
    claims = {name.decode("latin-1"): int(count) for name, count in ELEMENT.findall(header)}
    total = sum(claims.values())
    check_budget(total, where)
    found = len(body)
    if b"format ascii" in header:
        found = sum(1 for line in body.splitlines() if line.strip())
        if found != total:
            raise FileFormatError(f"{where}: the header promises {total} rows, found {found}")
    if found < total:
        raise FileFormatError(f"{where}: the header promises {total} elements, found only {found} bytes")
    if b"format binary" in header:
        _check_bytes(data, where)
    return claims


def _check_bytes(data: bytes, where: str) -> None:
    """The bytes of a binary file are those of its elements, no more and no fewer."""
    end = END.search(data)
    if end is None:
        raise FileFormatError(f"{where}: the PLY header does not end with a line of its own")
    body, at = np.frombuffer(data, np.uint8, offset=end.end()), 0
    order = ">" if b"format binary_big_endian" in data[: end.start()] else "<"
    for count, properties in _elements(data[: end.start()].decode("latin-1")):
        if not all(map(_known, properties)):
            raise FileFormatError(f"{where}: a property of a type that PLY does not have")
        at = _after(body, at, count, properties, order)
    if at != len(body):
        raise FileFormatError(f"{where}: the header promises {at} bytes after it, found {len(body)}")


def _known(words: list[str]) -> bool:
    types = words[1:3] if words[0] == "list" else words[:1]
    return len(words) == (4 if words[0] == "list" else 2) and set(types) <= SIZES.keys()


def _elements(header: str) -> list[tuple[int, list[list[str]]]]:
    """Number and properties of each element: words of `type name` or `list type type name`."""
    lines = [line.split() for line in header.splitlines()]
    starts = [i for i, words in enumerate(lines) if words[:1] == ["element"] and len(words) == 3 and words[2].isdigit()]
    spans = pairwise([*starts, len(lines)])
    return [
        (int(lines[a][2]), [words[1:] for words in lines[a:b] if words[:1] == ["property"] and words[1:]])
        for a, b in spans
    ]


def _after(body: np.ndarray, at: int, count: int, properties: list[list[str]], order: str) -> int:
    """Where an element ends that begins at a byte; beyond the end where it is cut."""
    if all(words[0] != "list" for words in properties):
        return at + count * sum(SIZES[words[0]] for words in properties)
    (kind, *types), *more = properties
    if kind == "list" and not more and SIZES[types[0]] == 1 and at < len(body):  # all of one length, as a rule
        record = 1 + SIZES[types[1]] * int(body[at])
        if len(lengths := body[at : at + count * record : record]) == count and (lengths == body[at]).all():
            return at + count * record
    for _ in range(count):
        for words in properties:
            size = SIZES[words[-2]]
            if words[0] == "list":
                width = SIZES[words[1]]
                size *= int.from_bytes(body[at : at + width].tobytes(), "little" if order == "<" else "big")
                at += width
            at += size
        if at > len(body):
            break
    return at
