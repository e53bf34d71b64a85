"""The files that a model was made from, as its record names them: hashes, and no folders of this machine."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from quadriform.files import sha256_of
from quadriform.imaging.file_points import files_of
from quadriform.shapes.record import InputFile


def input_files(found: Mapping[str, Sequence[Path]], frame: int | None = None) -> tuple[InputFile, ...]:
    """The input files of a record.

    Args:
        found: surface, or "" for all, -> its files; of several files each is one frame, in their order.
        frame: which frame of one file with several was taken.

    Raises:
        InputError, FileFormatError: a file cannot be read.
    """
    every = dict.fromkeys(path for files in found.values() for path in files)
    hashes = {path: sha256_of(*files_of(path)) for path in every}
    return tuple(
        InputFile(_name(path), hashes[path], surface, number if len(files) > 1 else frame)
        for surface, files in found.items()
        for number, path in enumerate(files)
    )


def title_of(files: Sequence[Path], most: int = 3) -> str:
    """The names of input files as a title, the first few of many."""
    return ", ".join(map(_name, files[:most])) + (" ..." if len(files) > most else "")


def without_folders(notes: Iterable[str], files: Iterable[Path]) -> tuple[str, ...]:
    """Notes that begin with the path of one of the files, with its name in its place; each note once."""
    names = {f"{path}: ": f"{_name(path)}: " for path in files}
    return tuple(dict.fromkeys(_shortened(note, names) for note in notes))


def _shortened(note: str, names: Mapping[str, str]) -> str:
    for long, short in names.items():
        if note.startswith(long):
            return short + note.removeprefix(long)
    return note


def _name(path: Path) -> str:
    return path.name or path.resolve().name
