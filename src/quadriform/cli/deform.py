"""`quadriform deform`: push anything through the volumetric map of a model."""

from pathlib import Path
from typing import Annotated

import typer

from quadriform.cli.options import Columns, Force, Json, Space, Strict, check_space


def deform(
    model: Annotated[Path, typer.Argument(help="A model, .json or .npz.")],
    points: Annotated[Path, typer.Argument(help="Points or a mesh to carry along.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Points, or a mesh when POINTS is one.")],
    inverse: Annotated[bool, typer.Option("--inverse", help="From the deformed space back.")] = False,
    columns: Columns = None,
    space: Space = None,
    strict: Strict = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Carry points or a mesh through a model's control box, or back with --inverse.

    Points without a mark are taken to be in the model's frame of the world and unit, and what comes out is in these.
    """
    from quadriform.cli.inputs import turn_to_model
    from quadriform.cli.screen import emit, emit_json
    from quadriform.cli.verdicts import repeat
    from quadriform.files import read_mesh, read_model, write_mesh
    from quadriform.files.atomic import check_writable
    from quadriform.files.meshes import MESH_SUFFIXES
    from quadriform.files.points import POINT_SUFFIXES, read_point_set, write_points
    from quadriform.files.reading import naming, suffix_of
    from quadriform.imaging.file_points import space_and_unit_of, space_to_write
    from quadriform.shapes.mesh import Mesh
    from quadriform.shapes.spaces import turn_between

    as_mesh = suffix_of(output, (*POINT_SUFFIXES, *MESH_SUFFIXES), "points or a mesh") in MESH_SUFFIXES
    check_writable(output, force, inputs=[model, points])
    carrier, asked = read_model(model), check_space(space)
    told = repeat(carrier.record, strict, model)
    with naming(model):
        wanted = space_to_write(asked, carrier.space)
    carry = carrier.undeform if inverse else carrier.deform
    mesh = read_mesh(points) if as_mesh else None
    with naming(points):
        turn = turn_to_model(points, space_and_unit_of(points, columns), (carrier.space, carrier.unit))
        given = read_point_set(points, columns).in_metric_unit().points if mesh is None else mesh.vertices
        moved = carry(given @ turn.T)
    moved = moved @ turn_between(carrier.space, wanted).T
    if mesh is not None:
        write_mesh(Mesh(moved, mesh.faces), output, wanted, carrier.unit, force)
    else:
        write_points(moved, output, force)
    if as_json:
        emit_json({"points": len(moved), "inverse": inverse, "output": str(output)} | told)
    else:
        emit(f"{len(moved)} points {'carried back' if inverse else 'deformed'}: {output}")
