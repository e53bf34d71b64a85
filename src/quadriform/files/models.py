"""Models, still or moving, as small versioned documents: JSON to read and to compare, or packed in a .npz.

Numbers are written with the fewest digits that give back the very same float64. Reading is strict: what the format
does not know is refused with the path of the field. The document of a moving model has the same fields, with knots in
time and one box of control points a knot.
"""

import json
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import FileFormatError, OptionError
from quadriform.files.arrays import parse_npz
from quadriform.files.atomic import write_bytes
from quadriform.files.landmark_fields import landmarks_document, read_landmarks
from quadriform.files.metadata import SPACES, UNITS, check_space_and_unit
from quadriform.files.packed import TEXT, VALUES, Unpacking, packed
from quadriform.files.posterior_fields import posterior_document, read_posterior
from quadriform.files.reading import PathLike, quoted, read_bytes, signature, suffix_of, suffix_to_read
from quadriform.files.records import FIELDS, read_record, record_document
from quadriform.files.strict import Field
from quadriform.points import LARGEST
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.kinds import KINDS
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.record import SHA256, ModelRecord
from quadriform.shapes.splines import TimeBasis
from quadriform.shapes.superquadric import SHAPES, Superquadric

MODEL_SUFFIXES = (".json", ".npz")
FORMAT, MOVING = "quadriform-model", "quadriform-moving-model"
VERSION = 3
"""Since 2 the file holds the record of the fit; models of version 1 have the status "unknown". Since 3 it may have
landmarks."""
MOVING_VERSION = 5
"""Since 2 the file has the times of its frames; before, they are those of the knots. Since 3 it has the record, since 4
it may have landmarks, since 5 a posterior."""
LANDMARKS, POSTERIOR = "landmarks", "posterior"
BODY = ("format", "version", "space", "unit", "input_sha256", "surfaces", "box")
BOX = {"origin": (3,), "edges": (3, 3)}


def write_model(model: DeformableModel, path: PathLike, force: bool = False) -> None:
    """Write a model as .json (under 12 kB for 386 parameters) or .npz (under 4 kB), all or nothing.

    Args:
        model: the model, with its frame, unit and the hash of its input.
        path: where to; its suffix chooses the format.
        force: replace an existing file.

    Raises:
        FileFormatError: another suffix.
        OptionError: a frame or unit that the format does not know.
        OutputError: the target cannot be written.
    """
    encode = {".json": encode_json, ".npz": packed}[suffix_of(path, MODEL_SUFFIXES, "a model")]
    landmarks = {LANDMARKS: landmarks_document(model.landmarks)}
    write_bytes(path, encode(_document(FORMAT, VERSION, model) | landmarks | box_document(model.box)), force)


def write_moving_model(model: MovingModel, path: PathLike, force: bool = False) -> None:
    """Write a moving model as .json, all or nothing; with a posterior half a megabyte to one.

    Raises:
        FileFormatError: another suffix.
        OptionError: a frame or unit that the format does not know.
        OutputError: the target cannot be written.
    """
    suffix_of(path, (".json",), "a moving model")
    knots, frames = model.basis.knots.tolist(), model.frame_times.tolist()
    time = {"time": {"knots": knots, "period": model.basis.period, "frames": frames}}
    landmarks = {LANDMARKS: [landmarks_document(each) for each in model.landmarks] or None}
    posterior = {POSTERIOR: posterior_document(model.posterior)}
    document = _document(MOVING, MOVING_VERSION, model) | landmarks | time | box_document(model) | posterior
    write_bytes(path, encode_json(document), force)


def read_model(path: PathLike) -> DeformableModel:
    """The model of a file; its parameters are exactly those that were written.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: no model, damaged, of a later version, or a field that is missing, unknown or wrong; the
            message has the path of the field.
        FileLimitError: beyond the budget.
    """
    suffix = suffix_to_read(path, MODEL_SUFFIXES, "a model")
    data, where = read_bytes(path), quoted(path)
    root = Field(parse_json(data, where) if suffix == ".json" else _parse_arrays(data, where), "", where)
    fields = _fields(root, FORMAT, BODY, VERSION, record_since=2, landmarks_since=3)
    box = root.member("box")
    landmarks = read_landmarks(root.optional(LANDMARKS))
    model = root.build(
        DeformableModel, box=box.build(ControlBox, **box_fields(box, axes=3)), landmarks=landmarks, **fields
    )
    check_extent(model, where)
    return model


def read_moving_model(path: PathLike) -> MovingModel:
    """The moving model of a file; its parameters are exactly those that were written.

    Raises:
        InputError: the file is missing or cannot be read.
        FileFormatError: no moving model, damaged, of a later version, or a field that is missing, unknown or wrong.
        FileLimitError: beyond the budget.
    """
    suffix_to_read(path, (".json",), "a moving model")
    where = quoted(path)
    root = Field(parse_json(read_bytes(path), where), "", where)
    version = read_version(root, MOVING, MOVING_VERSION)
    body = (*BODY, "time", *([POSTERIOR] if version >= 5 else ()))
    fields = _fields(root, MOVING, body, MOVING_VERSION, record_since=3, landmarks_since=4)
    times = _times(root.member("time"), version)
    every = root.optional(LANDMARKS)
    landmarks = () if every.value is None else tuple(map(read_landmarks, every.items()))
    box = box_fields(root.member("box"), axes=4)
    posterior = read_posterior(root.optional(POSTERIOR), box["control_points"].shape)
    model = root.build(MovingModel, **fields, **times, **box, landmarks=landmarks, posterior=posterior)
    # Between knots the splines stay near these states.
    for knot in model.basis.knots:
        check_extent(root.build(model.at, float(knot)), where)
    return model


def is_model_file(path: PathLike) -> bool:
    """Whether a file is read as a model: any .json, and a .npz, which may contain points, with the fields of a model.

    A .json is not opened, a damaged .npz is an error.

    Raises:
        InputError, FileFormatError, FileLimitError: as for `read_model`.
    """
    if suffix_of(path, MODEL_SUFFIXES, "a model") == ".json":
        return True
    return bool({"format", TEXT} & parse_npz(read_bytes(path), quoted(path)).keys())


def read_any_model(path: PathLike) -> DeformableModel | MovingModel:
    """The model of a file, still or, of a .json that has the fields of one, moving.

    Raises:
        InputError, FileFormatError, FileLimitError: as for `read_model`.
    """
    if suffix_to_read(path, MODEL_SUFFIXES, "a model") == ".json":
        document = parse_json(read_bytes(path), quoted(path))
        if isinstance(document, dict) and document.get("format") == MOVING:
            return read_moving_model(path)
    return read_model(path)


# --- model -> document -------------------------------------------------------------------------------------------


def _document(name: str, version: int, model: DeformableModel | MovingModel) -> dict[str, Any]:
    """The fields that both kinds of models have; refuses a frame, a unit or a name that no file can hold."""
    check_space_and_unit(model.space, model.unit)
    return {
        "format": name,
        "version": version,
        "space": model.space,
        "unit": model.unit,
        "input_sha256": model.input_sha256,
        **record_document(model.record, model.surfaces),
        "surfaces": [surface_document(each, surface) for each, surface in model.surfaces.items()],
    }


def surface_document(name: str, surface: Superquadric) -> dict[str, Any]:
    """The fields of a named superquadric.

    Raises:
        OptionError: a name that UTF-8 cannot hold.
    """
    if not name.isascii() and name.encode("utf-8", "replace").decode() != name:
        raise OptionError(f"surface {name!r}: expected a name without halves of surrogate pairs")
    fields: dict[str, Any] = {"name": name, "kind": surface.kind}
    fields |= {key: getattr(surface, key).tolist() for key in SHAPES}
    if extra := KINDS[surface.kind].extra:
        fields[extra] = float(getattr(surface, extra))
    return fields


def box_document(box: ControlBox | MovingModel) -> dict[str, Any]:
    """The field with the arrays of a control box."""
    return {"box": {name: getattr(box, name).tolist() for name in (*BOX, "control_points")}}


# --- document -> model -------------------------------------------------------------------------------------------


def _fields(
    root: Field, name: str, body: tuple[str, ...], latest: int, record_since: int, landmarks_since: int
) -> dict[str, Any]:
    """What both kinds of models have, as arguments; some fields since a version of the format."""
    version = read_version(root, name, latest)
    record = FIELDS if version >= record_since else ()
    root.only((*body, *record, *([LANDMARKS] if version >= landmarks_since else ())))
    surfaces = read_surfaces(root.member("surfaces"))
    return {
        "surfaces": surfaces,
        "input_sha256": root.member("input_sha256").matching(SHA256, "64 hexadecimal digits, or nothing"),
        "space": root.member("space").choice(SPACES),
        "unit": root.member("unit").choice(UNITS),
        "record": read_record(root, surfaces) if record else ModelRecord(),
    }


def read_version(root: Field, name: str, latest: int) -> int:
    """The version of a document, which has the name of its format; one up to the latest."""
    root.member("format").choice((name,))
    version = root.member("version").whole()
    if not 1 <= version <= latest:
        root.member("version").refuse(f"version 1 to {latest}; a later one needs a newer quadriform")
    return version


def read_surfaces(field: Field) -> dict[str, Superquadric]:
    """Superquadrics by name; at least one."""
    surfaces: dict[str, Superquadric] = {}
    for item in field.items():
        name = item.member("name").text()
        if name in surfaces:
            item.member("name").refuse("a name of its own")
        surfaces[name] = _surface(item)
    if not surfaces:
        field.refuse("at least one surface")
    return surfaces


def _surface(field: Field) -> Superquadric:
    kind = field.member("kind").choice(tuple(KINDS))
    extra = tuple(filter(None, [KINDS[kind].extra]))
    field.only(("name", "kind", *SHAPES, *extra))
    values: dict[str, Any] = {key: field.member(key).numbers(shape) for key, shape in SHAPES.items()}
    values |= {key: field.member(key).number() for key in extra}
    return field.build(Superquadric, kind, **values)


def box_fields(field: Field, axes: int) -> dict[str, Any]:
    """The arrays of a control box; its control points have three axes, those of a moving one a first for the knots."""
    shapes: dict[str, tuple[int | None, ...]] = BOX | {"control_points": (*[None] * axes, 3)}
    field.only(tuple(shapes))
    return {name: field.member(name).numbers(shape) for name, shape in shapes.items()}


def _times(field: Field, version: int) -> dict[str, Any]:
    """The splines and the times of the frames; a file of version 1 has none of these."""
    field.only(("knots", "period") if version == 1 else ("knots", "period", "frames"))
    knots, period = field.member("knots").numbers((None,)), field.member("period")
    times = {"basis": field.build(TimeBasis, knots, None if period.value is None else period.number())}
    if version == 1:
        return times
    frames = field.member("frames")
    if not frames.items():
        frames.refuse("one or more times")
    return times | {"frame_times": frames.numbers((None,))}


def check_extent(model: DeformableModel, where: str) -> None:
    """Refuse a model whose surfaces do not belong to its box: far outside, its polynomials have no finite values."""
    for name in model.surfaces:
        with np.errstate(all="ignore"):
            # Vertices of a coarse grid: overflow anywhere shows in them.
            vertices = model.mesh(name, resolution=4).vertices
        if not (np.abs(vertices) <= LARGEST).all():
            raise FileFormatError(
                f"{where}: expected surfaces in the control box or near it, found surface {name!r} deformed beyond "
                f"{LARGEST:g}"
            )


# --- document <-> bytes ------------------------------------------------------------------------------------------


def encode_json(document: dict[str, Any]) -> bytes:
    """A document as text, one point a line."""
    text = json.dumps(document, indent=1, allow_nan=False)
    # One point a line: small, and two models can be compared line by line. A line end stands in no JSON string.
    text = re.sub(r"\[\n\s*([^\[\]{}]*?)\n\s*\]", lambda found: "[" + re.sub(r",\n\s*", ",", found[1]) + "]", text)
    return (text + "\n").encode()


def parse_json(data: bytes, where: str) -> Any:
    """The document of a text.

    Raises:
        FileFormatError: it is no JSON, or has a field twice.
    """

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        """The fields of one object as a dictionary."""
        if len(dict(pairs)) != len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise FileFormatError(f"{where}: the field {twice[:60]!r} occurs twice")
        return dict(pairs)

    try:
        return json.loads(data.decode("utf-8"), object_pairs_hook=unique)  # NaN is refused with its field
    except FileFormatError:
        raise
    except RecursionError as error:
        raise FileFormatError(f"{where}: nested too deeply for a model") from error
    except ValueError as error:
        raise FileFormatError(f"{where}: expected a model in JSON, found {signature(data)} ({error})") from error


def _parse_arrays(data: bytes, where: str) -> dict[str, Any]:
    """The document of two arrays; or as it was written at first, its leaves being arrays: `box.edges`."""
    arrays, document = parse_npz(data, where), dict[str, Any]()
    if arrays.keys() == {TEXT, VALUES}:
        return Unpacking(arrays[VALUES], where).document(parse_json(arrays[TEXT].tobytes(), where))
    for name, array in arrays.items():
        group, _, key = name.rpartition(".")
        target = document.setdefault(group, {}) if group else document
        if not isinstance(target, dict):
            raise FileFormatError(f"{where}, field {group}: expected a group of arrays, found one array")
        target[key] = _plain(array, name, where)
    surfaces: list[Any] = []
    # The first files stored each surface as a group of arrays with its number in their names.
    while f"surfaces[{len(surfaces)}]" in document:
        surfaces.append(document.pop(f"surfaces[{len(surfaces)}]"))
    return {"surfaces": surfaces} | document


def _plain(array: NDArray[Any], name: str, where: str) -> Any:
    try:
        return array.tolist()
    except ValueError as error:  # characters that are none
        raise FileFormatError(f"{where}, field {name}: damaged ({error})") from error
