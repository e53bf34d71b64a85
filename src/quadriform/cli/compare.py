"""`quadriform compare`: how two models or meshes differ."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from quadriform.cli.options import subcommand
from quadriform.cli.screen import note, show
from quadriform.errors import InputError, OptionError
from quadriform.shapes.record import ModelRecord, together

if TYPE_CHECKING:
    from quadriform.shapes.comparison import ParameterDifference, Surface


@dataclass(frozen=True)
class _Body:
    """A model of one surface or a mesh, with frame and unit of its file, and the record of the fit where it has one."""

    file: Path
    shape: "Surface"
    space: str
    unit: str
    record: ModelRecord | None = None


@subcommand
def compare(a: Path, b: Path, *, surface: str | None = None, strict: str | None = None, as_json: bool = False) -> None:
    """Distances between two surfaces both ways, volumes, overlap, and how the parameters of two models differ.

    Args:
        a: A model, .json or .npz, or a mesh, .ply .stl .obj .vtp .vtk.
        b: Another, in the same unit; it is brought to the frame of A, LPS or RAS.
        surface: Which surface, where a model has several.
    """
    from quadriform.cli.status import repeat_warnings
    from quadriform.files.reading import named_in_errors

    # the frame of A is kept, because results are compared with A as the reference
    one = _read(a, surface)
    two = _in_space(_read(b, surface), one.space)
    if surface is not None and all(surface not in getattr(body.shape, "surfaces", ()) for body in (one, two)):
        raise OptionError(f"option --surface={surface!r}: neither {str(a)!r} nor {str(b)!r} has a surface of that name")
    record: dict[str, Any] = {"a": str(a), "b": str(b)}
    record |= {what: _common(one, two, what) for what in ("space", "unit")}
    fits = {which: body.record for which, body in (("A", one), ("B", two)) if body.record is not None}
    status = repeat_warnings(together(fits), strict, a, b) if fits else {}
    with named_in_errors(a, b):
        record |= _record(one.shape, two.shape)
    for which in ("a", "b"):
        if record[f"volume_{which}"] is None:
            note(f"{record[which]}: the surface is open: no volume, no overlap")
    record |= status
    show(record, as_json, _rows(record), f"{a} (A) and {b} (B)", header=("quantity", "value", "unit"))


def _in_space(body: _Body, space: str) -> _Body:
    """The same in a frame of the world, where both are known; with a note where it was rotated."""
    from quadriform.shapes.mesh import Mesh
    from quadriform.shapes.spaces import rotation_between

    if space == body.space or "unknown" in (space, body.space):
        return body
    note(f"{body.file}: brought from {body.space} to {space}")
    shape = body.shape
    if isinstance(shape, Mesh):
        return replace(
            body, shape=Mesh(shape.vertices @ rotation_between(body.space, space).T, shape.faces), space=space
        )
    return replace(body, shape=shape.in_space(space), space=space)


def _common(one: _Body, two: _Body, what: str) -> str:
    """The space or the unit that both have; unknown goes with everything, with a note."""
    # equal values have one key: two entries mean that they differ or that one is unknown
    found = {str(getattr(body, what)): body.file for body in (one, two)}
    known = [value for value in found if value != "unknown"]
    if len(known) == 2:
        raise InputError(
            f"{str(two.file)!r}: expected the {what} {known[0]!r} of {str(one.file)!r}, found {known[1]!r}; bring both "
            "to the same first"
        )
    if len(found) == 2:
        note(f"{found['unknown']}: its {what} is unknown, taken as {known[0]}")
    return known[0] if known else "unknown"


def _read(file: Path, surface: str | None) -> _Body:
    from quadriform.files import load
    from quadriform.files.meshes import read_record, read_space_and_unit
    from quadriform.shapes.comparison import alone
    from quadriform.shapes.mesh import Mesh
    from quadriform.shapes.moving_model import MovingModel
    from quadriform.shapes.prior import ShapePrior

    shape = load(file)
    if isinstance(shape, Mesh):
        return _Body(file, shape, *read_space_and_unit(file), read_record(file))
    if isinstance(shape, MovingModel):
        raise InputError(
            f"{str(file)!r}: expected a model or a mesh, found a moving model; take a state out of it first, "
            "quadriform export --to ply --at TIME"
        )
    if isinstance(shape, ShapePrior):
        raise InputError(f"{str(file)!r}: expected a model or a mesh, found a prior; save its mean_model() first")
    try:
        return _Body(file, alone(shape, surface), shape.space, shape.unit, shape.record)
    except OptionError as error:
        raise OptionError(f"{str(file)!r}: {error}; --surface NAME chooses one") from error


def _record(a: "Surface", b: "Surface") -> dict[str, Any]:
    from quadriform.shapes.comparison import dice, enclosed_volume, parameter_difference, surface_distances
    from quadriform.shapes.mesh import Mesh

    a_to_b, b_to_a = surface_distances(a, b)
    volumes = enclosed_volume(a), enclosed_volume(b)
    difference = None if isinstance(a, Mesh) or isinstance(b, Mesh) else parameter_difference(a, b)
    return {
        "a_to_b": asdict(a_to_b),
        "b_to_a": asdict(b_to_a),
        "hausdorff": max(a_to_b.largest, b_to_a.largest),
        "volume_a": volumes[0],
        "volume_b": volumes[1],
        "volume_below_base_a": _below_base(a),
        "volume_below_base_b": _below_base(b),
        "dice": None if None in volumes else dice(a, b),
        "parameters": None if difference is None else _parameters(difference),
    }


def _below_base(body: "Surface") -> float | None:
    """The volume of a ventricle below the base that its model was stored with, in cubed units; else None."""
    from quadriform.heart.volumes import volume
    from quadriform.shapes.mesh import Mesh

    if isinstance(body, Mesh) or body.landmarks.base is None:
        return None
    return volume(body, next(iter(body.surfaces)), body.landmarks.base)


def _parameters(difference: "ParameterDifference") -> dict[str, Any]:
    return {
        "control_points_rms": difference.control_points,
        "semi_axes": difference.semi_axes.tolist(),
        "exponents": difference.exponents.tolist(),
        "translation": difference.translation.tolist(),
        "rotation_radians": difference.rotation,
    }


def _rows(record: dict[str, Any]) -> list[tuple[str, str, str]]:
    """The table: quantity, value, unit."""
    unit = "" if record["unit"] == "unknown" else record["unit"]
    rows = [
        (f"distance {direction}, {name}", _words(record[key][field]), unit)
        for direction, key in (("A to B", "a_to_b"), ("B to A", "b_to_a"))
        for name, field in (("mean", "mean"), ("RMS", "rms"), ("95 %", "percentile_95"), ("largest", "largest"))
    ]
    rows.append(("Hausdorff distance", _words(record["hausdorff"]), unit))
    cubed = unit and f"{unit}^3"
    rows += [(f"volume {which.upper()}", _words(record[f"volume_{which}"]), cubed) for which in "ab"]
    below = [(f"volume {which.upper()} below its base", record[f"volume_below_base_{which}"]) for which in "ab"]
    rows += [(name, _words(value), cubed) for name, value in below if value is not None]
    rows.append(("Dice overlap", _words(record["dice"]), ""))
    if "status" in record:
        rows.append(("status of the fits", record["status"], ", ".join(record["warnings"])))
    units = {"exponents": "", "rotation_radians": "rad"}
    for name, value in (record["parameters"] or {}).items():
        words = name.replace("_rms", ", RMS").replace("_radians", "").replace("_", " ")
        rows.append((f"{words}, B - A" if isinstance(value, list) else words, _words(value), units.get(name, unit)))
    return rows


def _words(value: Any) -> str:
    if value is None:
        return "none"
    return ", ".join(map(_words, value)) if isinstance(value, list) else f"{value:.4g}"
