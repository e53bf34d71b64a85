"""`quadriform export`: the surfaces of a model as meshes."""

from pathlib import Path
from typing import Annotated

import typer

from quadriform.cli.options import Force, Json, surface_file


def export(
    model: Annotated[Path, typer.Argument(help="A model, .json or .npz.")],
    to: Annotated[str, typer.Option(help="Formats between commas: ply, stl, obj, vtp.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the meshes; made where missing.")],
    resolution: Annotated[int, typer.Option(min=2, max=400, help="Cells along an edge of the surface's grid.")] = 24,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write every surface of a model in one or several mesh formats."""
    from quadriform.cli.screen import emit, emit_json
    from quadriform.errors import choose
    from quadriform.files import read_model, write_mesh
    from quadriform.files.atomic import check_folder, check_writable, make_folder
    from quadriform.files.meshes import MESH_SUFFIXES

    known = tuple(suffix[1:] for suffix in MESH_SUFFIXES)
    formats = [choose(name.strip().lower(), known, "--to") for name in to.split(",")]
    source = read_model(model)
    check_folder(output)
    targets = {output / surface_file(name, f".{kind}"): name for name in source.surfaces for kind in formats}
    if output.exists():
        for path in targets:
            check_writable(path, force)
    meshes = {name: source.mesh(name, resolution) for name in source.surfaces}
    make_folder(output)
    for path, name in targets.items():
        write_mesh(meshes[name], path, source.space, source.unit, force)
    if as_json:
        emit_json(
            {"outputs": [str(path) for path in targets], "triangles": {n: len(m.faces) for n, m in meshes.items()}}
        )
    else:
        emit("\n".join(str(path) for path in targets))
