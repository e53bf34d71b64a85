"""The input files of a model for its record: names and hashes, without the folders of this machine."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from quadriform.files import sha256_of
from quadriform.imaging.file_points import files_of
from quadriform.shapes.record import InputFile


def input_files(found: Mapping[str, Sequence[Path]], frame: int | None = None) -> tuple[InputFile, ...]:
    """Return the input files of a record.

    Args:
        found: surface, or "" for all, -> its files; of several files each is one frame, in their order.
        frame: which frame was taken of one file with several.

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
    """Return the names of input files as a title, the first `most` of them."""
    return ", ".join(map(_name, files[:most])) + (" ..." if len(files) > most else "")


def without_folders(notes: Iterable[str], files: Iterable[Path]) -> tuple[str, ...]:
    """Return notes with the name of a file in place of its path at their beginning; each note once."""
    names = {f"{path}: ": f"{_name(path)}: " for path in files}
    return tuple(dict.fromkeys(_shortened(note, names) for note in notes))


def _shortened(note: str, names: Mapping[str, str]) -> str:
    for long, short in names.items():
        if note.startswith(long):
            return short + note.removeprefix(long)
    return note


def _name(path: Path) -> str:
    return path.name or path.resolve().name
