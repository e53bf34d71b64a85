"""All-or-nothing writes: a reader sees the old file or the new one, whole."""

import contextlib
import os
import secrets
import stat
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from quadriform.errors import OutputError
from quadriform.files.reading import PathLike

FAILED = "writing failed, nothing was changed"


def check_writable(path: PathLike, force: bool = False, inputs: Sequence[PathLike] = ()) -> None:
    """Refuse a target that could not be written; call it before a long computation.

    Args:
        path: the file to be written.
        force: allow an existing file to be replaced.
        inputs: files that are being read; one of them as target needs `force` too.

    Raises:
        OutputError: folder missing or read-only, target exists, is no regular file, or is an input.
    """
    target = Path(path)
    with _refused(target, "cannot be written"):
        _check_target(target, force, inputs)
        with tempfile.TemporaryFile(dir=target.parent):  # permissions alone say too little: ask by doing
            pass


def _check_target(target: Path, force: bool, inputs: Sequence[PathLike]) -> None:
    where = repr(str(target))
    if not target.parent.is_dir():
        raise OutputError(f"{where}: the folder {str(target.parent)!r} does not exist; make it first")
    try:
        status = target.stat()
    except FileNotFoundError:
        return
    if not stat.S_ISREG(status.st_mode):
        raise OutputError(f"{where}: expected the name of a regular file, found a folder or a device")
    if force:
        return
    if any(Path(source).exists() and target.samefile(source) for source in inputs):
        raise OutputError(f"{where}: is the input itself; give another name, or force it to be replaced")
    raise OutputError(f"{where}: exists already; give another name, or force it to be replaced")


def check_folder(folder: PathLike, names: Sequence[str] = ()) -> None:
    """Refuse a folder that can neither be written to nor be made; nothing is made yet.

    Args:
        folder: that is to hold the files.
        names: of the files.

    Raises:
        OutputError: the folder, or its nearest existing parent, is no folder or is read-only, or a name is too long.
    """
    existing = Path(folder).absolute()
    with _refused(folder, "cannot be used as a folder for results"):
        missing = [*names]
        while not existing.exists() and existing != existing.parent:
            missing.append(existing.name)
            existing = existing.parent
        for name in missing:
            with contextlib.suppress(FileNotFoundError):
                os.stat(existing / name)  # refuses names that the disk cannot have
        with tempfile.TemporaryFile(dir=existing):
            pass


def make_folder(folder: PathLike) -> Path:
    """The path of `folder`, made with its parents where missing.

    Raises:
        OutputError: it cannot be made.
    """
    with _refused(folder, "cannot be made"):
        Path(folder).mkdir(parents=True, exist_ok=True)
    return Path(folder)


def write_bytes(path: PathLike, data: bytes, force: bool = False) -> None:
    """Write `data` to `path`, all or nothing.

    Raises:
        OutputError: the target is refused by `check_writable`, or the disk fails; the old file is intact.
    """
    check_writable(path, force)
    target = Path(path)
    with _refused(target, FAILED), _written_beside(target, data) as temporary:
        os.replace(temporary, target)


def create_bytes(path: PathLike, data: bytes) -> bool:
    """Whether this process wrote `data` to a new file, all or nothing; of several that try at once one does.

    A file that exists already is left as it is.

    Raises:
        OutputError: it cannot be written.
    """
    target = Path(path)
    with _refused(target, FAILED), _written_beside(target, data) as temporary:
        try:
            os.link(temporary, target)  # unlike a rename, refuses to replace
        except FileExistsError:
            return False
    return True


@contextlib.contextmanager
def _written_beside(target: Path, data: bytes) -> Iterator[Path]:
    """A new file with all of the data and the target's permissions; on leaving it is removed, unless it was renamed."""
    # The name is known before there is a file: an interrupt can fall between the making of one and its return.
    temporary = target.parent / f".quadriform-{secrets.token_hex(8)}.tmp"
    try:
        # Other users may not read it meanwhile.
        with open(temporary, "xb", opener=lambda path, flags: os.open(path, flags, 0o600)) as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, _mode(target))
        yield temporary
    finally:  # of an interrupt too
        with contextlib.suppress(OSError):
            os.unlink(temporary)
    sync_folder(target.parent)


def _mode(target: Path) -> int:
    """Permissions of the file that is replaced, else what a plain `open` would have given."""
    if target.exists():
        return target.stat().st_mode & 0o777
    # The umask can only be read by setting it.
    umask = os.umask(0)
    os.umask(umask)
    return 0o666 & ~umask


def sync_folder(folder: Path) -> None:
    """Make the new name durable, where the system lets a folder be opened (Windows does not)."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextlib.contextmanager
def _refused(path: PathLike, fault: str) -> Iterator[None]:
    """Turn errors of the system, and names that it cannot have, into an OutputError with the path and the fault."""
    try:
        yield
    except OutputError:  # is an OSError itself
        raise
    except (OSError, ValueError) as error:
        raise OutputError(f"{str(path)!r}: {fault}: {reason(error)}") from error


def reason(error: Exception) -> str:
    """The explanation of an error by the system."""
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error)
