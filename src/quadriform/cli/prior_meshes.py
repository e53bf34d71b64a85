"""Members of a population as files of meshes whose vertices correspond by their numbers."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from quadriform.errors import InputError
from quadriform.files.meshes import READ_SUFFIXES, read_mesh, read_space_and_unit
from quadriform.files.reading import quoted, visible_files
from quadriform.point_sets import ALONE
from quadriform.shapes.mesh import Mesh

Files = dict[str, Path]
"""The files of a member by the names of their surfaces."""


def mesh_files(folder: Path) -> list[Files]:
    """Return the files of each member: those in a folder, or in folders of it where members have several surfaces.

    In these the name of a file is that of its surface: endo.ply, or surface-endo.ply as `fit` writes it.
    """
    found = [{ALONE: file} for file in _meshes(folder)]
    inside = sorted(each for each in folder.iterdir() if each.is_dir() and not each.name.startswith("."))
    return found + [files for files in map(_by_surface, inside) if files]


def _meshes(folder: Path) -> list[Path]:
    return [file for file in visible_files(folder) if file.suffix.lower() in READ_SUFFIXES]


def _by_surface(folder: Path) -> Files:
    """The meshes of one member.

    Raises:
        InputError: two files of one surface.
    """
    found = Files()
    for file in _meshes(folder):
        name = file.stem if file.stem == ALONE else file.stem.removeprefix(f"{ALONE}-")
        if name in found:
            raise InputError(f"{quoted(file)}: expected one file for {name!r}; {quoted(found[name])} is another")
        found[name] = file
    return found


def read_members(members: Sequence[Files]) -> list[dict[str, Mesh]]:
    """Return the meshes of each member by name.

    Raises:
        InputError: other surfaces, numbers of vertices or triangles than those of the first member.
        FileFormatError, FileLimitError: a file that is damaged or too large.
    """
    first = {name: read_mesh(file) for name, file in members[0].items()}
    return [first, *(_like_the_first(files, members[0], first) for files in members[1:])]


def _like_the_first(files: Files, files_of_first: Files, first: dict[str, Mesh]) -> dict[str, Mesh]:
    if files.keys() != first.keys():
        raise InputError(
            f"{quoted(next(iter(files.values())).parent)}: expected the surfaces {', '.join(first)} as in "
            f"{quoted(next(iter(files_of_first.values())).parent)}, found {', '.join(files)}"
        )
    found = {}
    for name, mesh in first.items():
        found[name] = read_mesh(files[name])
        one, other = (f"{len(each.vertices)} vertices, {len(each.faces)} triangles" for each in (mesh, found[name]))
        if one != other or not np.array_equal(mesh.faces, found[name].faces):
            raise InputError(
                f"{quoted(files[name])}: expected {one} as in {quoted(files_of_first[name])}, and the same vertices in "
                f"each triangle; found {other}. If vertices do not correspond, fit a model to each mesh"
            )
    return found


def space_and_unit(members: Sequence[Files]) -> dict[str, str]:
    """Return the frame and the unit that all files state, as options of `learn_prior`.

    Raises:
        InputError: files that state different ones.
    """
    stated = {file: read_space_and_unit(file) for files in members for file in files.values()}
    (first, expected), *others = stated.items()
    for file, found in others:
        if found != expected:
            one, other = (", ".join(each) for each in (expected, found))
            raise InputError(f"{quoted(file)}: frame and unit {other}; expected {one} as in {quoted(first)}")
    return {"space": expected[0], "unit": expected[1]}
