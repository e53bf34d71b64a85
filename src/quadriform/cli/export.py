"""`quadriform export`: a model as meshes, hexahedra, a time series, or labels."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from quadriform.cli.options import Common, check_file_names, check_space, subcommand, surface_file
from quadriform.cli.screen import show
from quadriform.errors import OptionError, choose

if TYPE_CHECKING:
    from quadriform.imaging.volume import Volume
    from quadriform.points import Array
    from quadriform.shapes.model import DeformableModel

    States = tuple[list[DeformableModel], list[float]]
    Grid = tuple[Volume, Array]

WHOLE = {"vtu": "wall.vtu", "vtkhdf": "surfaces.vtkhdf", "nii": "labels.nii.gz"}
"""Formats that hold all surfaces in one file."""
FORMATS = ("ply", "stl", "obj", "vtp", "vtu", "vtkhdf", "nii")


@dataclass(frozen=True)
class Details:
    """How fine the files are, and which grid and times they have.

    Attributes:
        resolution: Cells along an edge of the surface's grid.
        layers: vtu: cells across the wall.
        like: nii: the NIfTI image whose grid is taken.
        frames: vtkhdf: states of a moving model's cycle.
        at: A moving model's time for all formats but vtkhdf.
    """

    resolution: Annotated[int, {"min": 2, "max": 400}] = 24
    layers: Annotated[int, {"min": 1, "max": 100}] = 4
    like: Path | None = None
    affine: str | None = None
    frames: Annotated[int, {"min": 2, "max": 1000}] = 25
    at: float | None = None


@subcommand
def export(model: Path, *, to: str, output: Path, details: Details, space: str | None = None, common: Common) -> None:
    """Write the surfaces of a model as meshes, its wall as hexahedra, its motion, or the voxels inside as labels.

    Args:
        model: A model, .json or .npz, or a moving model, .json.
        to: Formats between commas: ply, stl, obj, vtp, vtu, vtkhdf, nii.
        output: Folder for the files; made where missing.
    """
    from quadriform.cli.status import repeat_warnings
    from quadriform.files.atomic import check_folder, write_bytes
    from quadriform.files.result_folder import check_results, replaced_together

    formats = _formats(to, details)
    check_folder(output)
    state, states = _read(model, details, check_space(space))
    status = repeat_warnings(state.record, common.strict, model)
    like = details.like
    grid = None if like is None else _grid(like, details.affine, state)
    names = [name for kind in formats for name in _names(kind, state)]
    check_file_names([output / name for name in names], "two surfaces")
    # before the work, and before the first of the files is written
    check_results(output, names, common.force, [model] if like is None else [model, like])
    files: dict[str, bytes] = {}
    for kind in formats:
        files |= _encode(kind, state, states, details, grid)
    with replaced_together(output, next(iter(files)), common.force) as folder:
        for name, content in files.items():
            write_bytes(folder / name, content)
    outputs = [str(output / name) for name in files]
    show({"outputs": outputs} | status, common.as_json, "\n".join(outputs))


def _formats(to: str, details: Details) -> list[str]:
    formats = list(dict.fromkeys(choose(name.strip().lower(), FORMATS, "--to") for name in to.split(",")))
    # an image without nii would silently have no effect
    if ("nii" in formats) != (details.like is not None):
        raise OptionError("options --to nii and --like IMAGE go together: labels need a grid")
    if details.affine is not None and details.like is None:
        raise OptionError("option --affine needs --like IMAGE, whose header it chooses from")
    return formats


def _read(path: Path, details: Details, space: str | None) -> "tuple[DeformableModel, States]":
    """The model at the given time and in the given frame, and its states over the cycle with their times."""
    import numpy as np

    from quadriform.files import load
    from quadriform.files.reading import named_in_errors
    from quadriform.shapes.mesh import Mesh
    from quadriform.shapes.model import DeformableModel
    from quadriform.shapes.prior import ShapePrior

    loaded = load(path)
    if isinstance(loaded, Mesh | ShapePrior):
        raise OptionError(f"{str(path)!r}: expected a model, found a {'mesh' if isinstance(loaded, Mesh) else 'prior'}")
    if space is not None:
        with named_in_errors(path):
            loaded = loaded.in_space(space)
    at = details.at
    if isinstance(loaded, DeformableModel):
        if at is not None:
            raise OptionError(f"option --at={at:g}: {str(path)!r} does not move")
        return loaded, ([loaded], [0.0])
    start = float(loaded.basis.knots[0])
    # the end of a period is its start and would be drawn twice
    times = start + np.linspace(0, loaded.basis.span, details.frames, endpoint=loaded.basis.period is None)
    return loaded.at(start if at is None else at), ([loaded.at(float(time)) for time in times], times.tolist())


def _names(kind: str, state: "DeformableModel") -> list[str]:
    """The files of one format."""
    return [WHOLE[kind]] if kind in WHOLE else [surface_file(name, f".{kind}") for name in state.surfaces]


def _encode(
    kind: str, state: "DeformableModel", states: "States", details: Details, grid: "Grid | None"
) -> dict[str, bytes]:
    """The files of one format, by name."""
    from quadriform.files.meshes import encode_mesh
    from quadriform.files.vtk_xml import encode_vtu
    from quadriform.files.vtkhdf import encode_vtkhdf
    from quadriform.shapes.wall import wall_mesh

    if kind == "vtu":
        wall = wall_mesh(state, layers=details.layers, resolution=details.resolution)
        return {WHOLE[kind]: encode_vtu(wall, {"SPACE": state.space, "UNIT": state.unit} | state.record.metadata)}
    if kind == "vtkhdf":
        return {WHOLE[kind]: encode_vtkhdf(*states, resolution=details.resolution)}
    if kind == "nii" and grid is not None:
        return {WHOLE[kind]: _labels(state, *grid)}
    meshes = {name: state.mesh(name, details.resolution) for name in state.surfaces}
    return {
        surface_file(name, f".{kind}"): encode_mesh(mesh, f".{kind}", state.space, state.unit, state.record.metadata)
        for name, mesh in meshes.items()
    }


def _grid(like: Path, affine: str | None, state: "DeformableModel") -> "Grid":
    """The image whose grid is taken, of a 4-D one its first frame, and the transform from its voxels to the model."""
    from quadriform.files.label_maps import grid_of_model
    from quadriform.files.reading import named_in_errors
    from quadriform.imaging.reading import frame_count, read_volume

    grid = read_volume(like, 0 if frame_count(like) > 1 else None, affine)
    with named_in_errors(like):
        return grid, grid_of_model(state, grid.world_from_voxel, grid.space, grid.unit)


def _labels(state: "DeformableModel", grid: "Volume", to_model: "Array") -> bytes:
    """The labels of a model on the grid of an image, as NIfTI."""
    from quadriform.files.label_maps import encode_labels, label_map

    values = label_map(state, grid.values.shape, to_model)
    note = f"quadriform, STATUS={state.status}"
    return encode_labels(values, grid.world_from_voxel, grid.space, grid.unit, note=note)
