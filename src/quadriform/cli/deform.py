"""`quadriform deform`: points or meshes through the volumetric map of a model."""

from pathlib import Path
from typing import TYPE_CHECKING

from quadriform.cli.options import Common, check_space, subcommand
from quadriform.cli.screen import show

if TYPE_CHECKING:
    from quadriform.points import Array
    from quadriform.shapes.mesh import Mesh
    from quadriform.shapes.model import DeformableModel


@subcommand
def deform(
    model: Path,
    points: Path,
    *,
    output: Path,
    inverse: bool = False,
    columns: str | None = None,
    space: str | None = None,
    common: Common,
) -> None:
    """Move points or a mesh by the deformation of a model, or by its inverse with --inverse.

    Points without a named frame and unit are taken to be in those of the model, and the result is in these.

    Args:
        model: A model, .json or .npz.
        points: Points or a mesh to be moved.
        output: Points, or a mesh when POINTS is one.
        inverse: From the deformed space back.
    """
    from quadriform.cli.status import repeat_warnings
    from quadriform.files import read_model
    from quadriform.files.atomic import check_writable
    from quadriform.files.meshes import WRITE_SUFFIXES
    from quadriform.files.points import POINT_SUFFIXES
    from quadriform.files.reading import named_in_errors, suffix_of
    from quadriform.imaging.file_points import space_to_write

    as_mesh = suffix_of(output, (*POINT_SUFFIXES, *WRITE_SUFFIXES), "points or a mesh") in WRITE_SUFFIXES
    check_writable(output, common.force, inputs=[model, points])
    carrier, asked = read_model(model), check_space(space)
    status = repeat_warnings(carrier.record, common.strict, model)
    with named_in_errors(model):
        target = space_to_write(asked, carrier.space)
    moved, mesh = _moved(carrier, points, as_mesh, inverse, columns)
    _write(moved, mesh, output, carrier, target, common.force)
    record = {"points": len(moved), "inverse": inverse, "output": str(output)} | status
    show(record, common.as_json, f"{len(moved)} points {'carried back' if inverse else 'deformed'}: {output}")


def _moved(
    carrier: "DeformableModel", file: Path, as_mesh: bool, inverse: bool, columns: str | None
) -> "tuple[Array, Mesh | None]":
    """The deformed points (n, 3) of a file in the frame of the model, and the mesh whose vertices they were."""
    from quadriform.cli.inputs import rotation_to_model
    from quadriform.files import read_mesh
    from quadriform.files.points import read_point_set
    from quadriform.files.reading import named_in_errors
    from quadriform.imaging.file_points import space_and_unit_of

    mesh = read_mesh(file) if as_mesh else None
    with named_in_errors(file):
        rotation = rotation_to_model(file, space_and_unit_of(file, columns), (carrier.space, carrier.unit))
        given = read_point_set(file, columns).in_metric_unit().points if mesh is None else mesh.vertices
        # into the frame of the model, in which its map is defined
        return (carrier.undeform if inverse else carrier.deform)(given @ rotation.T), mesh


def _write(
    moved: "Array", mesh: "Mesh | None", output: Path, carrier: "DeformableModel", target: str, force: bool
) -> None:
    """Write points, or the mesh with these vertices, in the frame `target`."""
    from quadriform.files import write_mesh
    from quadriform.files.points import write_points
    from quadriform.shapes.mesh import Mesh
    from quadriform.shapes.spaces import rotation_between

    # rows are points: a rotation acts from the right, transposed
    moved = moved @ rotation_between(carrier.space, target).T
    if mesh is None:
        write_points(moved, output, force)
    else:
        write_mesh(Mesh(moved, mesh.faces), output, target, carrier.unit, force)
