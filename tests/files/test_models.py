"""The model's document: exact, small, the same twice, and strict."""

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from quadriform.errors import FileFormatError, OptionError
from quadriform.files.models import is_model_file, read_model, write_model
from quadriform.files.records import FIELDS
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

KINDS = [
    Superquadric(),
    Superquadric("toroid", hole_radius=2.5),
    Superquadric("hyperboloid1", height=1.1),
    Superquadric("hyperboloid2", height=3.3),
]


def assert_same(a: DeformableModel, b: DeformableModel) -> None:
    assert (a.space, a.unit, a.input_sha256) == (b.space, b.unit, b.input_sha256)
    assert list(a.surfaces) == list(b.surfaces)
    for one, other in zip(a.surfaces.values(), b.surfaces.values(), strict=True):
        assert (one.kind, one.hole_radius, one.height) == (other.kind, other.hole_radius, other.height)
        for name in ("semi_axes", "exponents", "rotation", "translation"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    for name in ("origin", "edges", "control_points"):
        assert getattr(a.box, name).tobytes() == getattr(b.box, name).tobytes()


@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_round_trip_to_the_last_bit(tmp_path, model, suffix):
    first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    write_model(model, first)
    back = read_model(first)
    assert_same(back, model)
    assert back.mesh(resolution=5).vertices.tobytes() == model.mesh(resolution=5).vertices.tobytes()
    write_model(back, second)
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_awkward_numbers_survive(tmp_path, model, suffix):
    moved = model.box.control_points.copy()
    moved[0, 0] = [[-0.0, 5e-324, 9.999999999999999e29]] + [[0.1 + 0.2, 1 / 3, 1e22]] * 4
    model = replace(model, box=model.box.with_control_points(moved))
    write_model(model, tmp_path / f"m{suffix}")
    assert_same(read_model(tmp_path / f"m{suffix}"), model)


@pytest.mark.parametrize("suffix", [".json", ".npz"])
@pytest.mark.parametrize("superquadric", KINDS, ids=lambda s: s.kind)
def test_every_kind_and_several_surfaces_in_their_order(tmp_path, model, superquadric, suffix):
    names = {'epi [outer]\n"': superquadric, "endo.é": model.superquadric(), "": superquadric}
    both = replace(model, surfaces=names)
    write_model(both, tmp_path / f"m{suffix}")
    assert_same(read_model(tmp_path / f"m{suffix}"), both)


def test_json_is_small_and_says_what_it_is(tmp_path, model):
    path = tmp_path / "m.json"
    write_model(model, path)
    assert model.n_parameters == 386
    assert path.stat().st_size < 12_000
    document = json.loads(path.read_text(encoding="utf-8"))
    expected = {"format": "quadriform-model", "version": 3, "space": "LPS", "unit": "mm", "input_sha256": "0f" * 32}
    assert {key: document[key] for key in expected} == expected


def test_npz_carries_no_time(tmp_path, model):
    write_model(model, tmp_path / "m.npz")
    with zipfile.ZipFile(tmp_path / "m.npz") as archive:
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def change(path, value):
    """An edit of the document: `value` at `path`, or the removal of the field for `...`."""

    def edit(document):
        *way, last = path
        for step in way:
            document = document[step]
        if value is ...:
            del document[last]
        else:
            document[last] = value

    return edit


TWIN = {
    "name": "a",
    "kind": "ellipsoid",
    "semi_axes": [1.0, 1.0, 1.0],
    "exponents": [1.0, 1.0],
    "rotation": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    "translation": [0.0, 0.0, 0.0],
}
BAD = [
    (("format",), "other", "field format: expected one of 'quadriform-model'"),
    (("format",), ..., "field format: expected a value, found none"),
    (("version",), 4, "field version: expected version 1 to 3; a later one needs a newer quadriform"),
    (("version",), True, "field version: expected a whole number, found True"),
    (("version",), 1.0, "field version: expected a whole number"),
    (("comment",), "hi", "field comment: expected only the fields"),
    (("space",), "XYZ", "field space: expected one of 'LPS', 'RAS'"),
    (("space",), ["LPS"], "field space: expected one of"),
    (("unit",), None, "field unit"),
    (("input_sha256",), "abc", "field input_sha256: expected 64 hexadecimal"),
    (("surfaces",), {}, "field surfaces: expected a list"),
    (("surfaces",), [], "field surfaces: expected at least one"),
    (("surfaces", 0), 3, r"field surfaces\[0\]: expected an object"),
    (("surfaces", 0, "name"), 3, r"field surfaces\[0\].name: expected a text"),
    (("surfaces", 0, "kind"), "cube", r"field surfaces\[0\].kind: expected one of 'ellipsoid'"),
    (("surfaces", 0, "kind"), "toroid", r"field surfaces\[0\].hole_radius: expected a value"),
    (("surfaces", 0, "height"), 1.0, r"field surfaces\[0\].height: expected only"),
    (("surfaces", 0, "rotation"), ..., r"field surfaces\[0\].rotation: expected a value"),
    (("surfaces", 0, "rotation", 1, 1), 7.0, r"field surfaces\[0\]: rotation: expected an orthogonal"),
    (("surfaces", 0, "semi_axes", 2), "1", r"field surfaces\[0\].semi_axes\[2\]: expected a finite number"),
    (("surfaces", 0, "semi_axes", 2), True, r"field surfaces\[0\].semi_axes\[2\]: expected a finite number"),
    (("surfaces", 0, "semi_axes", 2), 10**400, r"field surfaces\[0\].semi_axes\[2\]: expected a finite number"),
    (("surfaces", 0, "semi_axes", 2), -1.0, r"field surfaces\[0\]: semi_axes: expected lengths above 0"),
    (("surfaces", 0, "semi_axes"), [1.0, 2.0], r"field surfaces\[0\].semi_axes: expected 3 items, found 2"),
    (("surfaces", 0, "exponents"), [1.0, 9.0], r"field surfaces\[0\]: exponents"),
    (("surfaces",), [TWIN, TWIN], r"field surfaces\[1\].name: expected a name of its own"),
    (("box",), [], "field box: expected an object"),
    (("box", "degrees"), [4, 4, 4], "field box.degrees: expected only"),
    (("box", "edges", 2), [3.0, 4.0, 5.0], "field box: edges: expected three edges at right angles, found two at"),
    (("box", "edges", 2), [0.0, 0.0, 0.0], "field box: edges: expected three edges that are not zero"),
    (("box", "control_points", 1), ..., "ok"),
    (("box", "control_points", 1, 0), ..., "field box.control_points: expected rows of one shape"),
    (("box", "control_points"), [], "field box.control_points"),
    (("box", "control_points", 4, 3, 2), [0.0, 1.0], r"field box.control_points\[4\]\[3\]\[2\]: expected 3 items"),
    (("box", "control_points", 4, 3, 2, 1), None, r"field box.control_points\[4\]\[3\]\[2\]\[1\]: expected a finite"),
]


@pytest.mark.parametrize(
    ("path", "value", "message"), BAD, ids=[f"{'.'.join(map(str, p))}={str(v)[:9]}" for p, v, _ in BAD]
)
def test_a_wrong_field_is_refused_by_its_path(tmp_path, model, path, value, message):
    target = tmp_path / "m.json"
    write_model(model, target)
    document = json.loads(target.read_text(encoding="utf-8"))
    change(path, value)(document)
    target.write_text(json.dumps(document))
    if message == "ok":  # four layers of control points are a model too: the strictness has an end
        assert read_model(target).box.degrees == (3, 4, 4)
        return
    with pytest.raises(FileFormatError, match=message):
        read_model(target)


@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_are_not_finite_are_refused(tmp_path, model, word):
    target = tmp_path / "m.json"
    write_model(model, target)
    target.write_text(target.read_text(encoding="utf-8").replace('"exponents": [0.7,', f'"exponents": [{word},'))
    with pytest.raises(FileFormatError, match=r"field surfaces\[0\].exponents\[0\]: expected a finite number"):
        read_model(target)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[" * 1_000_000, "nested too deeply"),
        (b'{"a":' * 200_000, "nested too deeply"),
        (b'{"format": 1, "format": 1}', "twice"),
        (b"{} {}", "Extra data"),
        (b"\xff\xfe", "expected a model in JSON"),
        (b"[]", "expected an object"),
        (b"null", "expected an object"),
        (b"hello", "found text"),
        (b"1" * 5000, "expected a model in JSON"),
    ],
    ids=["lists", "objects", "twice", "two", "utf16", "list", "null", "text", "digits"],
)
def test_what_is_no_document_is_refused(tmp_path, content, message):
    target = tmp_path / "m.json"
    target.write_bytes(content)
    with pytest.raises(FileFormatError, match=message):
        read_model(target)


@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_a_file_cut_anywhere_is_refused(tmp_path, model, suffix):
    target = tmp_path / f"m{suffix}"
    write_model(model, target)
    whole = target.read_bytes().rstrip()
    for length in range(1, len(whole), 97):
        target.write_bytes(whole[:length])
        with pytest.raises(FileFormatError):
            read_model(target)


def as_at_first(model, path, **changes):
    """The first layout of a .npz: every leaf an array of its own."""
    write_model(model, path.with_suffix(".json"))
    document = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    document = {name: value for name, value in document.items() if name not in (*FIELDS, "landmarks")} | {"version": 1}
    arrays = {name: np.array(value) for name, value in document.items() if name not in ("surfaces", "box")}
    for i, surface in enumerate(document["surfaces"]):
        arrays |= {f"surfaces[{i}].{name}": np.array(value) for name, value in surface.items()}
    arrays |= {f"box.{name}": np.array(value) for name, value in document["box"].items()} | changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


def test_the_first_layout_of_an_archive_is_still_read(tmp_path, model):
    as_at_first(model, tmp_path / "m.npz")
    assert is_model_file(tmp_path / "m.npz")
    assert_same(read_model(tmp_path / "m.npz"), model)


def test_an_archive_is_smaller_than_four_thousand_bytes(tmp_path, model):
    write_model(model, tmp_path / "m.npz")
    assert (tmp_path / "m.npz").stat().st_size <= 4000
    assert is_model_file(tmp_path / "m.npz")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text, numbers: (text, numbers[:-1]), "expected at least 404 values, found 403"),
        (lambda text, numbers: (text, np.append(numbers, 1.0)), "expected 404 values by the shapes .* found 405"),
        (lambda text, numbers: (text, numbers.astype(np.float32)), "one row of float64"),
        (lambda text, numbers: (text.replace("[5,5,5,3]", "[5,5,-5,3]"), numbers), "a list of lengths"),
        (lambda text, numbers: (text.replace("[5,5,5,3]", "7"), numbers), "expected 29 values by the shapes"),
        (lambda text, numbers: (text.replace("[5,5,5,3]", "[true]"), numbers), "a list of lengths"),
        (lambda text, numbers: (text.replace("[5,5,5,3]", "[375]"), numbers), "field box.control_points"),
        (lambda text, numbers: (text[:-1], numbers), "expected a model in JSON"),
        (lambda text, numbers: (text, np.where(numbers == numbers[-1], np.nan, numbers)), "a finite number"),
        (lambda text, numbers: ("[1]", numbers[:0]), "expected"),
    ],
)
def test_text_and_numbers_that_do_not_go_together_are_refused(tmp_path, model, change, message):
    write_model(model, tmp_path / "m.npz")
    with np.load(tmp_path / "m.npz") as archive:
        text, numbers = change(archive["document"].tobytes().decode(), archive["numbers"])
    np.savez(tmp_path / "m.npz", document=np.frombuffer(text.encode(), np.uint8), numbers=numbers)
    with pytest.raises(FileFormatError, match=message):
        read_model(tmp_path / "m.npz")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"box.edges": None}, "field box.edges: expected a value"),
        ({"surfaces[0].kind": np.array(3)}, r"field surfaces\[0\].kind: expected one of"),
        ({"surfaces[2].kind": np.array("ellipsoid")}, r"field surfaces\[2\]: expected only"),
        ({"surfaces": np.zeros(2)}, "surfaces"),
        ({"box": np.zeros(2)}, "box"),
        ({"box.origin": np.array([0, np.nan, 0])}, r"field box.origin\[1\]: expected a finite number"),
        ({"box.origin": np.array([1, 2, 3j])}, r"field box.origin\[0\]: expected a finite number"),
        ({"version": np.array(9)}, "field version"),
        ({"extra": np.array(9)}, "field extra: expected only"),
    ],
)
def test_a_wrong_array_is_refused_by_its_path(tmp_path, model, changes, message):
    target = tmp_path / "m.npz"
    as_at_first(model, target, **changes)
    with pytest.raises(FileFormatError, match=message):
        read_model(target)


def test_an_unknown_frame_is_not_written(tmp_path, model):
    with pytest.raises(OptionError, match="space"):
        write_model(replace(model, space="up"), tmp_path / "m.json")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("value", [1e300, -1e300, 1e160, 1e31, 1e29, -1e25, 1e-300])
@pytest.mark.parametrize(
    "path",
    [
        ("surfaces", 0, "semi_axes", 0),
        ("surfaces", 0, "translation", 2),
        ("surfaces", 0, "rotation", 1),
        ("box", "origin", 0),
        ("box", "edges", 1),
        ("box", "control_points", 0, 0, 0),
    ],
    ids=str,
)
def test_extreme_numbers_are_refused_or_harmless(tmp_path, model, path, value):
    """Whatever is read has finite surfaces, without a warning of NumPy."""
    write_model(model, tmp_path / "m.json")
    document = json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))
    place = document
    for key in path[:-1]:
        place = place[key]
    old = place[path[-1]]
    place[path[-1]] = [value, *old[1:]] if isinstance(old, list) else value
    (tmp_path / "m.json").write_text(json.dumps(document), encoding="utf-8")
    try:
        found = read_model(tmp_path / "m.json")
    except FileFormatError:
        return
    assert np.isfinite(found.mesh(resolution=6).vertices).all() and np.isfinite(found.volume())
