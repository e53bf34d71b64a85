"""What every reader does first: is there a regular file, within the budget, and what does it begin with."""

import contextlib
import hashlib
import io
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from quadriform.errors import FileFormatError, FileLimitError, InputError, OptionError, QuadriformError

PathLike = str | os.PathLike[str]

MAX_BYTES = 2 * 1024**3
"""Files, and the sizes in their headers, may not be larger."""

SIGNATURES = {
    b"\x1f\x8b": "gzip",
    b"PK": "zip",
    b"\x93NUMPY": "npy",
    b"ply": "PLY",
    b"solid": "ASCII STL",
    b"\x89HDF": "HDF5",
    b"\x89PNG": "PNG",
    b"%PDF": "PDF",
    b"{": "JSON",
    b"<": "XML",
    b"\xff\xfe": "text in UTF-16",
    b"\xfe\xff": "text in UTF-16",
}


def read_bytes(path: PathLike) -> bytes:
    """Return the content of a regular, not empty file.

    Raises:
        InputError: missing, a folder, a device or a pipe, or not readable.
        FileFormatError: empty.
        FileLimitError: above `MAX_BYTES`.
    """
    check_budget(check_readable(path), quoted(path))
    with _open_bytes(path) as stream:
        return stream.read()


def check_readable(path: PathLike) -> int:
    """Return the size in bytes of a regular, not empty file.

    Raises:
        InputError: missing, a folder, a device or a pipe.
        FileFormatError: empty.
    """
    try:
        status = Path(path).stat()
    except FileNotFoundError as error:
        raise InputError(f"{quoted(path)}: there is no such file") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{quoted(path)}: cannot be read: {error}") from error
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or a pipe"
        raise InputError(f"{quoted(path)}: expected a regular file, found {kind}")
    if status.st_size == 0:
        raise FileFormatError(f"{quoted(path)}: the file is empty")
    return status.st_size


def first_bytes(path: PathLike, count: int) -> bytes:
    """Return the first bytes of a regular file; none where it cannot be read."""
    try:
        if not Path(path).is_file():  # a pipe would wait for its writer
            return b""
        with open(path, "rb") as stream:
            return stream.read(count)
    except OSError:
        return b""


def check_budget(size: int, where: str) -> None:
    """Refuse a size, found or declared by a header, that is beyond the budget.

    Raises:
        FileLimitError: above `MAX_BYTES`.
    """
    if size > MAX_BYTES:
        raise FileLimitError(f"{where}: {size} bytes are beyond the budget of {MAX_BYTES}; split the file")


def sha256_of(path: PathLike, *more: PathLike) -> str:
    """SHA-256, in hexadecimal, of a file's bytes, or of several files one after the other.

    Raises:
        InputError: a file is missing or cannot be read.
        FileFormatError: a file is empty.
    """
    digest = hashlib.sha256()
    for each in (path, *more):
        check_readable(each)
        with _open_bytes(each) as stream:
            hashlib.file_digest(stream, lambda: digest)  # adds to the one digest of all files
    return digest.hexdigest()


@contextlib.contextmanager
def _open_bytes(path: PathLike) -> Iterator[io.BufferedReader]:
    """The bytes of a file; errors of the system name it."""
    try:
        with open(path, "rb") as stream:
            yield stream
    except OSError as error:
        raise InputError(f"{quoted(path)}: cannot be read: {error.strerror}") from error


def visible_files(folder: Path) -> list[Path]:
    """Return the files of a folder in the order of their names, without hidden ones and folders."""
    return sorted(file for file in folder.iterdir() if file.is_file() and not file.name.startswith("."))


def quoted(path: PathLike) -> str:
    """The path as an error message shows it: quoted, line ends escaped."""
    return repr(os.fspath(path))


@contextlib.contextmanager
def named_in_errors(*files: Path) -> Iterator[None]:
    """Put the names of the files before errors that do not name one; wrong options are not the files' fault."""
    try:
        yield
    except OptionError:
        raise
    except QuadriformError as error:
        if not files or any(quoted(file) in str(error) for file in files):
            raise
        raise type(error)(f"{', '.join(map(quoted, files))}: {error}") from error


def suffix_of(path: PathLike, known: tuple[str, ...], what: str) -> str:
    """Lower-case suffix of `path`, when it is one of `known`.

    Raises:
        FileFormatError: naming the suffixes that `what` can have.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in known:
        raise FileFormatError(f"{quoted(path)}: {what} cannot have the suffix {suffix!r}; expected {' '.join(known)}")
    return suffix


def suffix_to_read(path: PathLike, known: tuple[str, ...], what: str) -> str:
    """Lower-case suffix of a file that is there, when it is one of `known`.

    Raises:
        InputError: missing, a folder, a device or a pipe.
        FileFormatError: empty, or another suffix; names those that `what` can have.
    """
    check_readable(path)  # first, so that of a missing file its suffix is not refused
    return suffix_of(path, known, what)


def utf8_text(data: bytes, where: str, what: str = "text") -> str:
    """The text of a file in UTF-8, with or without a byte order mark; messages say that `what` was expected.

    Raises:
        FileFormatError: bytes that are no such text.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        found = f"{signature(data)} (byte {error.start})"
        raise FileFormatError(f"{where}: expected {what} in UTF-8, found {found}") from error


def signature(data: bytes) -> str:
    """In words, what the first bytes of a file look like."""
    for start, name in SIGNATURES.items():
        if data.startswith(start):
            return name
    return "binary data" if b"\0" in data[:512] else "text"
