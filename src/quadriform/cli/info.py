"""`quadriform info`: what a file holds."""

from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from quadriform.cli.options import subcommand
from quadriform.cli.screen import print_remarks, show, texts
from quadriform.errors import FileFormatError, WarningKind, join_warnings, status_of
from quadriform.shapes.record import Estimate, ModelRecord, remarks, worst

if TYPE_CHECKING:
    from quadriform.points import Array
    from quadriform.shapes.model import DeformableModel
    from quadriform.shapes.moving_model import MovingModel
    from quadriform.shapes.prior import ShapePrior


SHOWN = ("title", "status", "warnings", "notes", "sources", "coverage", "supported", "extends_beyond", "estimates")
"""Fields of a record."""


@subcommand
def info(
    file: Path,
    *,
    frame: int | None = None,
    affine: str | None = None,
    columns: str | None = None,
    strict: str | None = None,
    as_json: bool = False,
) -> None:
    """Show what a file holds: counts, extents, frame, unit and hash.

    Args:
        file: Points, a mesh, an image or a model.
    """
    from quadriform.cli.status import check_strict
    from quadriform.files import sha256_of
    from quadriform.files.reading import named_in_errors
    from quadriform.imaging.file_points import files_of, kind_of

    with named_in_errors(file):
        kind = kind_of(file)
        describe = {"model": _model, "mesh": _mesh, "image": _image}.get(kind or "")
        record = _points(file, columns) if describe is None else describe(file, frame, affine)
        record["sha256"] = sha256_of(*files_of(file))
    print_remarks(
        remarks(record.get("warnings", {}), record.get("notes", ()), "from the fit" if kind == "model" else "")
    )
    show(record, as_json, [(name.replace("_", " "), _words(value)) for name, value in record.items()], str(file))
    warnings = {WarningKind(kind): text for kind, text in record.get("warnings", {}).items()}
    check_strict(strict, worst(record.get("status", "ok"), status_of(warnings)), warnings, file)


def _words(value: Any) -> str:
    if isinstance(value, dict) and value.keys() == {each.name for each in fields(Estimate)}:
        return str(Estimate(**value))
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        known = {name: item for name, item in value.items() if item not in ("", None)}
        return "\n".join(f"{name}: {_words(item)}" for name, item in known.items()) or "none"
    if isinstance(value, list):
        return ("\n" if value and not isinstance(value[0], float | int) else ", ").join(map(_words, value)) or "none"
    return "none" if value is None else str(value)


def _extent(points: "Array") -> dict[str, list[float]]:
    low, high = points.min(axis=0), points.max(axis=0)
    return {"lowest": low.tolist(), "highest": high.tolist(), "size": (high - low).tolist()}


def _points(file: Path, columns: str | None) -> dict[str, Any]:
    from quadriform.files.points import read_point_set
    from quadriform.point_sets import precision_loss

    found = read_point_set(file, columns)
    return {
        "kind": "points",
        "points": len(found.points),
        "normals": "none" if found.normals is None else len(found.normals),
        "extent": _extent(found.points),
        "space": "unknown",
        "unit": found.unit,
        "warnings": texts(precision_loss(found.number_type, found.points)),
        "notes": list(found.notes),
    }


def _mesh(file: Path, frame: int | None, affine: str | None) -> dict[str, Any]:
    from quadriform.files import read_mesh, read_points
    from quadriform.files.meshes import read_record, read_space_and_unit
    from quadriform.point_sets import precision_loss

    space, unit = read_space_and_unit(file)
    try:
        mesh = read_mesh(file)
    except FileFormatError:
        points = read_points(file)  # a cloud in a mesh format; a damaged file fails here again
        cloud = {"kind": "points", "points": len(points), "extent": _extent(points), "space": space, "unit": unit}
        return cloud | {"warnings": texts(precision_loss(None, points))}
    record = read_record(file) or ModelRecord()
    return {
        "kind": "mesh",
        "vertices": len(mesh.vertices),
        "triangles": len(mesh.faces),
        "area": mesh.area(),
        "extent": _extent(mesh.vertices),
        "space": space,
        "unit": unit,
        "status": record.status,
        "warnings": texts(join_warnings(record.warnings, precision_loss(None, mesh.vertices))),
    }


def _image(file: Path, frame: int | None, affine: str | None) -> dict[str, Any]:
    import numpy as np

    from quadriform.imaging.reading import read_volume

    volume = read_volume(file, frame, affine)
    # an oblique image reaches its extent at one of its eight corners
    corners = np.array(list(np.ndindex(2, 2, 2))) * (np.array(volume.values.shape) - 1)
    return {
        "kind": "image",
        "voxels": list(volume.values.shape),
        "spacing": volume.spacing.tolist(),
        "type": str(volume.values.dtype),
        **({"segments": {one.name: one.number for one in volume.segments}} if volume.segments else {}),
        "values": {"lowest": float(volume.values.min()), "highest": float(volume.values.max())},
        "extent": _extent(volume.points_world(corners)),
        "space": volume.space,
        "unit": volume.unit,
        "warnings": texts(volume.warnings),
    }


def _model(file: Path, frame: int | None, affine: str | None) -> dict[str, Any]:
    from quadriform.files import load
    from quadriform.shapes.model import DeformableModel
    from quadriform.shapes.prior import ShapePrior

    model: Any = load(file)
    if isinstance(model, ShapePrior):
        return _prior(model)
    if not isinstance(model, DeformableModel):
        return _moving(model)
    return {
        "kind": "model",
        **_surfaces(model, model.box.control_points.shape[:3]),
        "parameters": model.n_parameters,
        "extent": {name: _extent(model.mesh(name).vertices) for name in model.surfaces},
        **_record(model),
    }


def _prior(prior: "ShapePrior") -> dict[str, Any]:
    return {
        "kind": "prior",
        **_surfaces(prior, prior.box.control_points.shape[:3]),
        "models": prior.n_models,
        "modes": len(prior.modes),
        "standard deviations": prior.deviations.tolist(),
        **asdict(prior.report),
        "space": prior.space,
        "unit": prior.unit,
    }


def _surfaces(model: "DeformableModel | MovingModel | ShapePrior", control_points: tuple[int, ...]) -> dict[str, Any]:
    kinds = {name: surface.kind for name, surface in model.surfaces.items()}
    return {"surfaces": kinds, "control_points": list(control_points)}


def _moving(model: "MovingModel") -> dict[str, Any]:
    first = model.at(float(model.basis.knots[0]))
    return {
        "kind": "moving model",
        **_surfaces(model, model.control_points.shape[1:4]),
        "frames": len(model.frame_times),
        "knots": len(model.basis.knots),
        "period": "none" if model.basis.period is None else model.basis.period,
        "parameters": model.n_parameters,
        "extent at the first knot": {name: _extent(first.mesh(name).vertices) for name in model.surfaces},
        **_record(model),
    }


def _record(model: "DeformableModel | MovingModel") -> dict[str, Any]:
    """Frame and unit of a model, and the record of its fit and its input."""
    from quadriform.cli.status import status_fields
    from quadriform.files.records import record_document

    found = record_document(model.record, model.surfaces)
    every = model.landmarks if isinstance(model.landmarks, tuple) else (model.landmarks,)
    bases = ", ".join(dict.fromkeys(each.base_from for each in every if each.base is not None))
    found = {name: found[name] for name in SHOWN}
    metadata = {"space": model.space, "unit": model.unit, "input_sha256": model.input_sha256 or "unknown"}
    return metadata | {"base": bases or "none"} | found | status_fields(model.record)
