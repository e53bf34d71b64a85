"""The surface of a model as an object of another library."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from quadriform.errors import OptionError
from quadriform.report.drawable import Drawable, surfaces_of

if TYPE_CHECKING:
    from trimesh import Trimesh


def to_trimesh(
    model: Drawable, surface: str | None = None, *, time: float | None = None, resolution: int = 24
) -> Trimesh:
    """The same vertices and triangles as a `trimesh.Trimesh`, with `units` where they are known.

    Args:
        model: a model, a fit, a moving model at a `time`, or a mesh.
        surface: which one, where there are several.
        time: of a moving model, in the unit of its knots.
        resolution: 1 to 512, as in `DeformableModel.mesh`.

    Returns:
        Float64, nothing merged or reordered; `metadata["space"]` is "LPS", "RAS" or "unknown",
        `metadata["status"]` that of the model's fit.

    Raises:
        OptionError: nothing that has a surface, an unknown surface or none of several, a time too many or too few.
    """
    from trimesh import Trimesh

    found = surfaces_of(model, surface, time, resolution)
    mesh = found.only
    # processing would merge vertices, so that they no longer correspond to those of the model
    shell = Trimesh(
        mesh.vertices.copy(), mesh.faces.copy(), process=False, metadata={"space": found.space, "status": found.status}
    )
    if found.unit != "unknown":
        shell.units = found.unit
    return shell


def to_pyvista(model: Drawable, surface: str | None = None, *, time: float | None = None, resolution: int = 24) -> Any:
    """The same vertices and triangles as a `pyvista.PolyData`; needs `pip install 'quadriform[viz]'`.

    Args:
        model: as for `to_trimesh`, and so the other three.
        surface: which one, where there are several.
        time: of a moving model.
        resolution: 1 to 512.

    Returns:
        Float64 points; the field data `SPACE`, `UNIT` and `STATUS` are those that our .vtp files carry.

    Raises:
        OptionError: as `to_trimesh`, or pyvista is not installed.
    """
    found = surfaces_of(model, surface, time, resolution)
    mesh = found.only
    try:
        import pyvista
    except ImportError as error:
        raise OptionError("to_pyvista needs pyvista; pip install 'quadriform[viz]'") from error
    shell = pyvista.PolyData.from_regular_faces(mesh.vertices.copy(), mesh.faces.copy())
    # PyVista has no notion of frame and unit; field data is written into .vtp files
    shell.field_data["SPACE"] = [found.space]
    shell.field_data["UNIT"] = [found.unit]
    shell.field_data["STATUS"] = [found.status]
    return shell
