"""A folder of results is replaced as a whole: either all its files are the new ones, or all are the old ones.

The new files are written to a folder of their own first, so that a full disk is noticed before anything is changed, and
then moved in. The first of them, the model, is taken away before the other old files and comes in after the other new
ones: a folder with a model has the files that belong to it. Files that are no results stay as they are.
"""

import contextlib
import json
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from quadriform.errors import OutputError
from quadriform.files.atomic import FAILED, check_folder, check_writable, make_folder, reason, sync_folder, write_bytes

OLD, NAMES = "old", "names"
"""Within the folder of the new files: the old ones that were moved out, and what is to be moved."""

Moves = list[tuple[Path, Path]]


def check_results(folder: Path, names: Sequence[str], force: bool, inputs: Iterable[Path] = ()) -> None:
    """Refuse a folder in which the results could not be written; call it before a long computation.

    What an earlier run left that was stopped while it moved its files is put in order first.

    Args:
        folder: of the results; it need not exist.
        names: of the files.
        force: allow existing files to be replaced.
        inputs: files that are being read.

    Raises:
        OutputError: the folder or one of the files cannot be written, or exists already.
    """
    check_folder(folder, names)
    if not folder.exists():
        return
    restore(folder)
    for name in names:
        check_writable(folder / name, force, inputs=list(inputs))


@contextlib.contextmanager
def replaced_together(folder: Path, first: str, force: bool, old: Sequence[str] = ()) -> Iterator[Path]:
    """An empty folder to write results in; on leaving they are moved to `folder`, all of them or none.

    Args:
        folder: of the results; made where it is missing.
        first: the name of the file without which the others are not taken for results.
        force: allow existing files to be replaced.
        old: names of earlier results, removed where they are not replaced.

    Raises:
        OutputError: the results cannot be written or moved; the folder is as it was.
    """
    made = [path for path in (folder, *folder.absolute().parents) if not path.exists()]
    fresh = folder in made
    staging = (folder.absolute().parent if fresh else folder) / f".quadriform-{secrets.token_hex(8)}.tmp"
    try:
        make_folder(staging)
        yield staging
        if fresh:
            os.rename(staging, folder)
            sync_folder(folder.absolute().parent)
        else:
            for path in staging.iterdir() if not force else ():
                check_writable(folder / path.name)
            _exchange(staging, folder, first, old)
    except BaseException as error:
        shutil.rmtree(staging, ignore_errors=True)
        for path in made:
            with contextlib.suppress(OSError):
                path.rmdir()
        if isinstance(error, OutputError):
            raise OutputError(str(error).replace(str(staging), str(folder))) from error
        if isinstance(error, OSError):
            raise OutputError(f"{str(folder)!r}: {FAILED}: {reason(error)}") from error
        raise
    shutil.rmtree(staging, ignore_errors=True)


def restore(folder: Path) -> None:
    """Put the old files back where a process was killed between its moves; otherwise nothing is done.

    Raises:
        OutputError: they cannot be moved.
    """
    for staging in sorted(folder.glob(".quadriform-*.tmp")):
        try:
            first, new, old = json.loads((staging / NAMES).read_text(encoding="utf-8"))
            if not (folder / first).exists():
                _undo(_moves(staging, folder, new, old))
            shutil.rmtree(staging)
        except (TypeError, ValueError, FileNotFoundError, NotADirectoryError):
            continue  # nothing of it was moved
        except OSError as error:
            raise OutputError(f"{str(folder)!r}: the earlier results cannot be put back: {reason(error)}") from error


def _exchange(staging: Path, folder: Path, first: str, old: Sequence[str]) -> None:
    """Move the old files out and the new ones in; whatever goes wrong, back again."""
    new = sorted((path.name for path in staging.iterdir()), key=lambda name: (name == first, name))
    present = [name for name in {*new, *old} if (folder / name).exists()]
    present.sort(key=lambda name: (name != first, name))
    # A file that is replaced keeps its permissions.
    for name in set(new) & set(present):
        os.chmod(staging / name, (folder / name).stat().st_mode & 0o777)
    (staging / OLD).mkdir()
    write_bytes(staging / NAMES, json.dumps([first, new, present]).encode())
    moves = _moves(staging, folder, new, present)
    try:
        for source, target in moves:
            os.replace(source, target)
    except BaseException:
        _undo(moves)
        raise
    sync_folder(folder)


def _moves(staging: Path, folder: Path, new: Sequence[str], old: Sequence[str]) -> Moves:
    return [(folder / name, staging / OLD / name) for name in old] + [(staging / name, folder / name) for name in new]


def _undo(moves: Moves) -> None:
    """The last move first; moves that were not made are left out."""
    for source, target in reversed(moves):
        if target.exists() and not source.exists():
            os.replace(target, source)
