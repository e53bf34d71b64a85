"""The readers that are fuzzed: a sample of each, and for formats without a checksum a reader of another make."""

import csv
import json
import re
import struct
import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import nibabel
import numpy as np
import pydicom
from dicom_made import write_enhanced, write_slice
from priors_made import meshes

import quadriform as qf
from quadriform.errors import FileFormatError, WarningKind
from quadriform.files.guide_points import read_guide_points
from quadriform.files.meshes import read_mesh
from quadriform.files.points import read_points, write_points
from quadriform.files.priors import read_prior
from quadriform.imaging.reading import read_volume
from quadriform.shapes.splines import TimeBasis

POINTS = np.random.default_rng(0).normal(size=(40, 3)) * 30
BOX = qf.ControlBox.around(qf.Superquadric(semi_axes=(30, 20, 15)), (3, 3, 3))
MODEL = qf.DeformableModel({"surface": qf.Superquadric(semi_axes=(30, 20, 15))}, BOX, "LPS", "mm")
MOVING = qf.MovingModel(
    MODEL.surfaces,
    BOX.origin,
    BOX.edges,
    TimeBasis(np.arange(3.0), 4.0),
    np.stack([BOX.control_points] * 3),
    "LPS",
    "mm",
)
SURFACE = ("kind", "semi_axes", "exponents", "rotation", "translation")
BOX_KEYS = ("origin", "edges", "control_points")
VOXELS = np.random.default_rng(1).integers(0, 2000, (5, 6, 7)).astype(np.int16)
AFFINE = np.array([[1.5, 0.1, 0, 3], [0, 2, 0, -4], [0, 0, 2.5, 5], [0, 0, 0, 1.0]])


@dataclass
class Kind:
    """A reader, how its sample is written, and what another reader makes of the same bytes."""

    name: str
    suffix: str
    write: Callable[[Path], object]
    read: Callable[[Path], Any]
    independent: Callable[[Path], Any] | None = None
    whole: bytes = b""

    def sample(self, folder: Path) -> tuple[Path, bytes]:
        """A path to write to, and the bytes of a whole file; what reading that gives is kept."""
        path = folder / self.name / f"sample{self.suffix}"
        path.parent.mkdir()
        self.write(path)
        self.whole = plain(self.read(path))
        return path, path.read_bytes()


def plain(thing: Any) -> bytes:
    """What a reader found, as bytes: arrays with their shapes, numbers and words; warnings and types do not count."""
    if isinstance(thing, np.ndarray):
        return repr(thing.shape).encode() + np.ascontiguousarray(thing, dtype=np.float64).tobytes()
    if is_dataclass(thing):
        return b"".join(plain(getattr(thing, f.name)) for f in fields(thing) if f.name != "warnings")
    if isinstance(thing, dict):
        return b"".join(repr(key).encode() + plain(value) for key, value in thing.items())
    if isinstance(thing, tuple | list):
        return b"".join(map(plain, thing))
    return repr(thing).encode()


def vertices_and_faces(mesh: qf.Mesh) -> tuple[np.ndarray, np.ndarray]:
    return mesh.vertices, mesh.faces


def rows_of_text(path: Path) -> np.ndarray:
    """Three columns, comments and one header row left out, as a spreadsheet would read them."""
    text = path.read_bytes().decode("utf-8-sig")
    rows = [re.sub(r"#.*", "", line) for line in re.split(r"\r\n|\r|\n", text)]
    rows = [row for row in rows if row.strip()]
    cells = list(csv.reader(rows)) if "," in rows[0] else [re.split(r"[\s;]+", row.strip()) for row in rows]
    cells = [[cell.strip() for cell in row] for row in cells]
    columns = [0, 1, 2]
    if not _number(cells[0][0]):
        names = [name.lower() for name in cells.pop(0)]
        columns = [names.index(axis) for axis in "xyz"] if set("xyz") <= set(names) or len(names) != 3 else [0, 1, 2]
    return np.array([[float(row[column]) for column in columns] for row in cells])


def _number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """A binary PLY by its header: vertices, and the faces' corners."""
    head, body = path.read_bytes().split(b"end_header\n", 1)
    letters = {"float": "f", "double": "d", "float32": "f", "float64": "d", "uchar": "B", "uint8": "B", "int": "i"}
    letters |= {"int32": "i", "uint": "I", "uint32": "I", "short": "h", "ushort": "H", "char": "b", "int8": "b"}
    vertices, faces, at = [], [], 0
    for element in re.split(rb"\nelement ", head)[1:]:
        name, count = element.split(None, 2)[:2]
        properties = [
            line.split()[1:] for line in element.decode("latin-1").splitlines() if line.startswith("property")
        ]
        for _ in range(int(count)):
            row = {}
            for words in properties:
                number = 1
                if words[0] == "list":
                    (number,) = struct.unpack_from("<" + letters[words[1]], body, at)
                    at += struct.calcsize(letters[words[1]])
                form = f"<{number}{letters[words[-2]]}"
                row[words[-1]] = struct.unpack_from(form, body, at)
                at += struct.calcsize(form)
            if name == b"vertex":
                vertices.append([row[axis][0] for axis in "xyz"])
            elif name == b"face":
                faces.append(next(iter(row.values())))
    return np.array(vertices), np.array(faces)


def stl(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """A binary STL: equal corners are one vertex, and corners of open edges that differ by rounding."""
    data = path.read_bytes()
    (count,) = struct.unpack_from("<I", data, 80)
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    corners = np.frombuffer(data, record, count, 84)["corners"].astype(np.float64).reshape(-1, 3)
    if len(data) >= 84 + 50 * (count + 1) and any(data[84 + 50 * count :]):
        raise ValueError("bytes that belong to no triangle")
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    edges = {(row[n - 1], row[n]) for row in faces.tolist() for n in range(3)}
    return merged(vertices, faces, sorted({k for a, b in edges if (b, a) not in edges for k in (a, b)}))


def merged(vertices: np.ndarray, faces: np.ndarray, loose: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of loose vertices that are as near as rounding allows, made one, one pair after the other."""
    if not np.isfinite(vertices).all():
        return vertices, faces
    lengths = [np.linalg.norm(vertices[row[n]] - vertices[row[n - 1]]) for row in faces for n in range(3)]
    extent = 2 * np.quantile(np.abs(vertices - np.median(vertices, axis=0)), 0.9, axis=0).max()
    step = np.spacing(np.float32(np.median(np.abs(vertices).max(axis=1))))
    near, name = min(max(1e-6 * extent, 2 * step), 0.1 * np.median(lengths)), np.arange(len(vertices))
    for one, other in combinations(loose, 2):
        if np.linalg.norm(vertices[one] - vertices[other]) <= near:
            name[name == max(name[one], name[other])] = min(name[one], name[other])
    kept = np.unique(name)
    return vertices[kept], np.searchsorted(kept, name)[faces]


def obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Lines `v` and `f` of an OBJ."""
    vertices, faces = [], []
    for line in path.read_bytes().decode().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            vertices.append([float(cell) for cell in rest[:3]])
        elif word == "f":
            corners = [int(cell.split("/")[0]) for cell in rest]
            if 0 in corners:
                raise ValueError("vertices count from 1")
            first, *others = [corner - 1 if corner > 0 else len(vertices) + corner for corner in corners]
            faces += [[first, *pair] for pair in pairwise(others)]
    return in_order((np.array(vertices), np.array(faces)))


def in_order(mesh: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Triangles with their lowest corner first, sorted: polygons may be cut in any order."""
    vertices, faces = mesh
    starts = faces.argmin(axis=1)[:, None] + np.arange(3)
    return vertices, np.array(sorted(np.take_along_axis(faces, starts % 3, axis=1).tolist()))


def vtp(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The arrays of a VTP by their names, base64 after a count of bytes."""
    import base64

    found = {}
    kinds = {"Float64": "<f8", "Int64": "<i8", "Int32": "<i4", "Float32": "<f4"}
    for array in ElementTree.fromstring(path.read_bytes()).iter("DataArray"):
        if array.get("type") in kinds and array.get("format") == "binary":
            raw = base64.b64decode("".join((array.text or "").split()), validate=True)
            if struct.unpack_from("<Q", raw) != (len(raw) - 8,):
                raise ValueError("another size than the array's own")
            found[array.get("Name")] = np.frombuffer(raw[8:], kinds[array.get("type")])
    return found["Points"].reshape(-1, 3), found["connectivity"].reshape(-1, 3)


def json_model(path: Path) -> list:
    """The numbers and words of a model, in the order in which they are compared; of one that moves its times too."""
    document = json.loads(path.read_text(encoding="utf-8"))
    surfaces = {s["name"]: [_array(s[key]) for key in SURFACE] for s in document["surfaces"]}
    box = [_array(document["box"][key]) for key in BOX_KEYS]
    time = [_array(document["time"][key]) for key in ("knots", "period", "frames")] if "time" in document else []
    return [surfaces, box, document["space"], document["unit"], document["input_sha256"], *time]


def _array(value: object) -> object:
    return np.array(value, dtype=float) if isinstance(value, list | float | int) else value


def model_numbers(path: Path) -> list:
    model = qf.load(path)
    surfaces = {name: [_array(getattr(s, key)) for key in SURFACE] for name, s in model.surfaces.items()}
    if isinstance(model, qf.MovingModel):
        box, time = model, [model.basis.knots, _array(model.basis.period), model.frame_times]
    else:
        box, time = model.box, []
    return [surfaces, [getattr(box, key) for key in BOX_KEYS], model.space, model.unit, model.input_sha256, *time]


def voxels_and_world(path: Path) -> tuple[np.ndarray, np.ndarray]:
    volume = read_volume(path)
    return volume.values, volume.world_from_voxel


def series_and_world(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The series that a slice lies in; a slice that is left out because it cannot be read is told, as by an error."""
    volume = read_volume(path.parent)
    if told := volume.warnings.get(WarningKind.UNREADABLE_FILES):
        raise FileFormatError(told)
    return volume.values, volume.world_from_voxel


def by_nibabel(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """NIfTI by nibabel, turned to LPS and millimetres."""
    image = nibabel.load(path)
    metres = {1: 1000.0, 3: 0.001}.get(int(image.header["xyzt_units"]) & 7, 1.0)
    world = np.diag([-metres, -metres, metres, 1]) @ image.affine
    values = np.asarray(image.get_fdata(dtype=np.float64))
    while values.ndim > 3 and values.shape[-1] == 1:  # dimensions that are none
        values = values[..., 0]
    return values, world


def write_simpleitk(path: Path, compressed: bool) -> None:
    import SimpleITK

    image = SimpleITK.GetImageFromArray(VOXELS)
    image.SetSpacing((1.5, 2.0, 2.5))
    SimpleITK.WriteImage(image, str(path), compressed)


def by_simpleitk(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """What SimpleITK says itself; a cut file is refused by length before it is asked."""
    import SimpleITK

    image = SimpleITK.ReadImage(str(path))
    world = np.eye(4)
    world[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    world[:3, 3] = image.GetOrigin()
    return SimpleITK.GetArrayFromImage(image).astype(np.float64).transpose(2, 1, 0), world


TURN = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
"""Columns: along a row, down a column, from slice to slice."""


def write_series(path: Path) -> None:
    """Four slices beside each other, the second of them at the path."""
    for k in range(4):
        file = path if k == 1 else path.with_name(f"slice{k}.dcm")
        place = {"position": TURN[:, 2] * 5.0 * k, "along_row": TURN[:, 0], "along_column": TURN[:, 1]}
        write_slice(file, VOXELS[k], **place, spacing=(1.5, 2.0), InstanceNumber=k + 1)


def write_many_images(path: Path) -> None:
    """The same in one file, scaled."""
    positions = [TURN[:, 2] * 5.0 * k for k in range(4)]
    write_enhanced(path, VOXELS[:4], positions, TURN[:, 0], TURN[:, 1], (1.5, 2.0), [0] * 4, [2, 3, 4, 5])


def by_pydicom(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """All slices beside a path by their positions, from what pydicom says of each file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        slices = [each for file in sorted(path.parent.iterdir()) for each in slices_of(pydicom.dcmread(file))]
    normal = np.cross(*slices[0][1])
    slices.sort(key=lambda one: one[0] @ normal)
    (origin, steps, _), *_, (end, _, _) = slices
    world = np.eye(4)
    world[:3] = np.column_stack([*steps, (end - origin) / (len(slices) - 1), origin])
    return np.stack([values.T for _, _, values in slices], axis=-1), world


def slices_of(data: pydicom.Dataset) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Of each image of a file where it begins, its steps along a row and down a column, and its values."""
    shared = data.get("SharedFunctionalGroupsSequence", [data])[0]
    found = []
    for k, own in enumerate(data.get("PerFrameFunctionalGroupsSequence", [data])):
        place, orientation, measures, scale = (
            inner_of(own, name) or inner_of(shared, name) or data
            for name in ("PlanePosition", "PlaneOrientation", "PixelMeasures", "PixelValueTransformation")
        )
        down, along = (float(value) for value in measures.PixelSpacing)
        cosines = np.array(orientation.ImageOrientationPatient, dtype=float).reshape(2, 3)
        pixels = data.pixel_array.reshape(-1, data.Rows, data.Columns)[k].astype(float)
        slope, intercept = scale.get("RescaleSlope"), scale.get("RescaleIntercept")  # None where they are empty, too
        values = pixels * float(1 if slope is None else slope) + float(0 if intercept is None else intercept)
        steps = cosines * [[along], [down]]
        found.append((np.array(place.ImagePositionPatient, dtype=float), steps, values))
    return found


def inner_of(group: pydicom.Dataset, name: str) -> pydicom.Dataset | None:
    return (group.get(f"{name}Sequence") or [None])[0]


def write_guide_points(path: Path) -> None:
    lines = ["x\ty\tz\tcontour type\tframeID\tweight\ttime frame"]
    kinds = ("SAX_LV_ENDOCARDIAL", "SAX_LV_EPICARDIAL", "MITRAL_VALVE")
    lines += [
        "\t".join([*map(repr, row), kinds[i % 3], str(i // 3), "1.0", "0"]) for i, row in enumerate(POINTS.tolist())
    ]
    path.write_text("\n".join(lines) + "\n")


def guide_points(path: Path) -> dict[str, np.ndarray]:
    """From the contour type to x y z, slice and weight of its points."""
    found = read_guide_points(path)
    return {
        kind: np.column_stack([found.points[kind], found.slices[kind], found.weights[kind]]) for kind in found.points
    }


def guide_rows(path: Path) -> dict[str, np.ndarray]:
    """The same by splitting at tabs."""
    rows: dict[str, list] = {}
    for line in path.read_bytes().decode("utf-8-sig").splitlines()[1:]:
        cells = [cell.strip() for cell in line.split("\t")]
        if any(cells):
            rows.setdefault(cells[3], []).append([float(cells[i]) for i in (0, 1, 2, 4, 5)])
    return {kind: np.array(values) for kind, values in rows.items()}


MESH = MODEL.mesh(resolution=4)


def saved(thing: Any) -> Callable[[Path], object]:
    return lambda path: qf.save(thing, path)


def mesh_kind(suffix: str, independent: Callable[[Path], Any], order: Callable = lambda mesh: mesh) -> Kind:
    return Kind(f"mesh {suffix}", suffix, saved(MESH), lambda p: order(vertices_and_faces(read_mesh(p))), independent)


KINDS = [
    Kind("points .xyz", ".xyz", lambda p: write_points(POINTS, p), read_points, rows_of_text),
    Kind("points .csv", ".csv", lambda p: write_points(POINTS, p), read_points, rows_of_text),
    Kind("points .npy", ".npy", lambda p: write_points(POINTS, p), read_points, lambda p: np.load(p).astype(float)),
    Kind("points .npz", ".npz", lambda p: write_points(POINTS, p), read_points),
    mesh_kind(".ply", ply),
    mesh_kind(".stl", stl),
    mesh_kind(".obj", obj, in_order),
    mesh_kind(".vtp", vtp),
    Kind("model .json", ".json", saved(MODEL), model_numbers, json_model),
    Kind("moving model .json", ".json", saved(MOVING), model_numbers, json_model),
    Kind("model .npz", ".npz", saved(MODEL), model_numbers),
    Kind("prior .npz", ".npz", lambda p: qf.save(qf.learn_prior(meshes(), box=(2, 2, 2)), p), read_prior),
    Kind(
        "image .nii", ".nii", lambda p: nibabel.Nifti1Image(VOXELS, AFFINE).to_filename(p), voxels_and_world, by_nibabel
    ),
    Kind("image .nii.gz", ".nii.gz", lambda p: nibabel.Nifti1Image(VOXELS, AFFINE).to_filename(p), voxels_and_world),
    Kind("image .mha", ".mha", lambda p: write_simpleitk(p, False), voxels_and_world, by_simpleitk),
    Kind("image .mha, compressed", ".mha", lambda p: write_simpleitk(p, True), voxels_and_world, by_simpleitk),
    Kind("image .nrrd, compressed", ".nrrd", lambda p: write_simpleitk(p, True), voxels_and_world, by_simpleitk),
    Kind(
        "image .dcm, a slice of a series",
        ".dcm",
        write_series,
        series_and_world,
        by_pydicom,
    ),
    Kind("image .dcm, many images", ".dcm", write_many_images, voxels_and_world, by_pydicom),
    Kind("guide points", ".txt", write_guide_points, guide_points, guide_rows),
]
