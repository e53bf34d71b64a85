"""`quadriform export`: a model as meshes, as hexahedra, as a film, as labels."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadriform.cli.options import Affine, Force, Json, Space, Strict, check_file_names, check_space, surface_file

if TYPE_CHECKING:
    from quadriform.imaging.volume import Volume
    from quadriform.points import Array
    from quadriform.shapes.model import DeformableModel

    Film = tuple[list[DeformableModel], list[float]]
    Grid = tuple[Volume, Array]

WHOLE = {"vtu": "wall.vtu", "vtkhdf": "surfaces.vtkhdf", "nii": "labels.nii.gz"}
"""Formats that hold all surfaces in one file."""
FORMATS = ("ply", "stl", "obj", "vtp", "vtu", "vtkhdf", "nii")


def export(
    model: Annotated[Path, typer.Argument(help="A model, .json or .npz, or a moving model, .json.")],
    to: Annotated[str, typer.Option(help=f"Formats between commas: {', '.join(FORMATS)}.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the files; made where missing.")],
    resolution: Annotated[int, typer.Option(min=2, max=400, help="Cells along an edge of the surface's grid.")] = 24,
    layers: Annotated[int, typer.Option(min=1, max=100, help="vtu: cells across the wall.")] = 4,
    like: Annotated[Path | None, typer.Option(help="nii: the NIfTI image whose grid is taken.")] = None,
    affine: Affine = None,
    frames: Annotated[int, typer.Option(min=2, max=1000, help="vtkhdf: states of a moving model's cycle.")] = 25,
    at: Annotated[float | None, typer.Option(help="A moving model's time for all formats but vtkhdf.")] = None,
    space: Space = None,
    strict: Strict = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write the surfaces of a model as meshes, its wall as hexahedra, its motion as a film, its inside as labels."""
    from quadriform.cli.screen import emit, emit_json
    from quadriform.cli.verdicts import repeat
    from quadriform.errors import OptionError, choose
    from quadriform.files.atomic import check_folder, write_bytes
    from quadriform.files.result_folder import check_results, replaced_together

    formats = [choose(name.strip().lower(), FORMATS, "--to") for name in to.split(",")]
    if ("nii" in formats) != (like is not None):
        raise OptionError("options --to nii and --like IMAGE go together: labels need a grid")
    if affine is not None and like is None:
        raise OptionError("option --affine goes with --like IMAGE, whose header it is about")
    check_folder(output)
    state, film = _read(model, at, frames, check_space(space))
    told = repeat(state.record, strict, model)
    grid = None if like is None else _grid(like, affine, state)
    kinds = list(dict.fromkeys(formats))
    names = [name for kind in kinds for name in _names(kind, state)]
    check_file_names([output / name for name in names], "two surfaces")
    check_results(output, names, force, [model] if like is None else [model, like])
    files: dict[str, bytes] = {}
    for kind in kinds:
        files |= _encode(kind, state, film, resolution, layers, grid)
    with replaced_together(output, next(iter(files)), force) as folder:
        for name, content in files.items():
            write_bytes(folder / name, content)
    outputs = [str(output / name) for name in files]
    if as_json:
        emit_json({"outputs": outputs} | told)
    else:
        emit("\n".join(outputs))


def _read(path: Path, at: float | None, frames: int, space: str | None) -> "tuple[DeformableModel, Film]":
    """The model, at the asked time and in the asked frame, and its states over the cycle with their times."""
    import numpy as np

    from quadriform.errors import OptionError
    from quadriform.files import load
    from quadriform.files.reading import naming
    from quadriform.shapes.mesh import Mesh
    from quadriform.shapes.model import DeformableModel

    loaded = load(path)
    if isinstance(loaded, Mesh):
        raise OptionError(f"{str(path)!r}: expected a model, found a mesh")
    if space is not None:
        with naming(path):
            loaded = loaded.in_space(space)
    if isinstance(loaded, DeformableModel):
        if at is not None:
            raise OptionError(f"option --at={at:g}: {str(path)!r} does not move")
        return loaded, ([loaded], [0.0])
    start = float(loaded.basis.knots[0])
    times = start + np.linspace(0, loaded.basis.span, frames, endpoint=loaded.basis.period is None)
    return loaded.at(start if at is None else at), ([loaded.at(float(time)) for time in times], times.tolist())


def _names(kind: str, state: "DeformableModel") -> list[str]:
    """The files of one format."""
    return [WHOLE[kind]] if kind in WHOLE else [surface_file(name, f".{kind}") for name in state.surfaces]


def _encode(
    kind: str, state: "DeformableModel", film: "Film", resolution: int, layers: int, grid: "Grid | None"
) -> dict[str, bytes]:
    """The files of one format, by name."""
    from quadriform.files.meshes import encode_mesh
    from quadriform.files.vtkhdf import encode_vtkhdf
    from quadriform.files.vtu import encode_vtu
    from quadriform.shapes.wall import wall_mesh

    if kind == "vtu":
        wall = wall_mesh(state, layers=layers, resolution=resolution)
        return {WHOLE[kind]: encode_vtu(wall, {"SPACE": state.space, "UNIT": state.unit} | state.record.marks)}
    if kind == "vtkhdf":
        return {WHOLE[kind]: encode_vtkhdf(*film, resolution=resolution)}
    if kind == "nii" and grid is not None:
        return {WHOLE[kind]: _labels(state, *grid)}
    meshes = {name: state.mesh(name, resolution) for name in state.surfaces}
    return {
        surface_file(name, f".{kind}"): encode_mesh(mesh, f".{kind}", state.space, state.unit, state.record.marks)
        for name, mesh in meshes.items()
    }


def _grid(like: Path, affine: str | None, state: "DeformableModel") -> "Grid":
    """The image whose grid is taken, of a moving one its first frame, and the way from its voxels to the model."""
    from quadriform.files.label_maps import grid_of_model
    from quadriform.files.reading import naming
    from quadriform.imaging.reading import frame_count, read_volume

    grid = read_volume(like, 0 if frame_count(like) > 1 else None, affine)
    with naming(like):
        return grid, grid_of_model(state, grid.world_from_voxel, grid.space, grid.unit)


def _labels(state: "DeformableModel", grid: "Volume", to_model: "Array") -> bytes:
    """The labels of a model on the grid of an image, as NIfTI."""
    from quadriform.files.label_maps import encode_labels, label_map

    values = label_map(state, grid.values.shape, to_model)
    note = f"quadriform, STATUS={state.status}"
    return encode_labels(values, grid.world_from_voxel, grid.space, grid.unit, note=note)
