"""`quadriform track` of hearts: one ejection fraction everywhere, below the base that the input itself has."""

import json
import re

import nibabel
import numpy as np
import pytest

import quadriform as qf
from quadriform.fitting.support import Reach, Support
from quadriform.heart.measure import measure
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.shapes.splines import TimeBasis

pytestmark = pytest.mark.usefixtures("blank_figures")
HEART = SyntheticVentricle()
TIMES = (0.0, 0.5)
CUT = ("--heart", "endo=label:1")


def record_of(result):
    assert result.code == 0, result.err
    return json.loads(result.out)


# --- contours ------------------------------------------------------------------------------------------------------


def written(folder, valve=8, inserts=True):
    """Guide points of two frames: both walls, the mitral ring, and where the right ventricle would meet the left."""
    folder.mkdir()
    for number, time in enumerate(TIMES):
        ways = HEART.positions(HEART.surface("epi").surface(np.eye(3)[:2]), time)
        groups = {
            "SAX_LV_ENDOCARDIAL": HEART.surface_points("endo", time, 200),
            "SAX_LV_EPICARDIAL": HEART.surface_points("epi", time, 200),
            "MITRAL_VALVE": HEART.mitral_points(time)[: 8 if number == 0 else valve],
            "RV_INSERT": ways if inserts else ways[:0],
        }
        rows = [
            f"{x!r}\t{y!r}\t{z!r}\t{kind}\t{n % 6}\t1.0\t{number}"
            for kind, points in groups.items()
            for n, (x, y, z) in enumerate(points.tolist())
        ]
        header = "x\ty\tz\tcontour type\tframeID\tweight\ttime frame"
        (folder / f"GPFile_{number:03d}.txt").write_text("\n".join([header, *rows]))
    return folder


SUPPORT = Support(0.9, 0.9, 0.9, 0.9, 0.2, 1.0, Reach(1.0, 1.0))


@pytest.fixture
def exact(monkeypatch):
    """The models of the ventricle in place of those of a fit."""
    models = HEART.models(TIMES)

    def track(sets, **options):
        boxes = np.stack([model.box.control_points for model in models])
        first = models[0]
        basis = TimeBasis(np.arange(2.0), 2.0)
        moving = qf.MovingModel(first.surfaces, first.box.origin, first.box.edges, basis, boxes)
        residuals = tuple({name: np.ones(len(each.points)) for name, each in frame.items()} for frame in sets)
        every = tuple(moving.at(time) for time in range(2))
        whole = None if options["strategy"] == "alone" else moving
        support = tuple(dict.fromkeys(frame, SUPPORT) for frame in residuals)
        return qf.Track(options["strategy"], np.arange(2.0), every, whole, residuals, 1.0, (1e-5,), support=support)

    monkeypatch.setattr("quadriform.motion.tracking.track", track)
    return models


def shown_on(page):
    """The ejection fraction in the table of a page, and the planes at which its viewer ends the cavity."""
    text = page.read_text(encoding="utf-8")
    planes = json.loads(re.search(r'"planes":(null|\[\[.*?\]\]\])', text)[1])
    return re.search(r"<td[^>]*>ejection fraction</td><td[^>]*>([0-9.]+) %", text)[1], planes


@pytest.mark.parametrize("space", ["LPS", "RAS"])
def test_a_heart_has_one_ejection_fraction(terminal, exact, tmp_path, space):
    """In the table of `track`, in its JSON, on all pages, and in `measure` with and without the contours."""
    frames = written(tmp_path / "frames")
    words = ("track", frames, "--space", space)
    record = record_of(terminal(*words, "-o", "out", "--json"))
    truth = measure(exact, base=[HEART.mitral_points(time) for time in TIMES])["ejection fraction"]
    assert record["ejection_fraction"] == pytest.approx(truth, abs=1e-6)
    assert record["closed_ejection_fraction"] == pytest.approx(measure(exact)["ejection fraction"], abs=1e-6)
    assert "below the plane of each frame's own mitral points" in record["volumes_from"]
    for again in (("measure", "out/model.json"), ("measure", "out/model.json", "--contours", frames)):
        found = {row["quantity"]: row["value"] for row in record_of(terminal(*again, "--json"))["measures"]}
        assert found["ejection fraction"] == pytest.approx(truth, abs=1e-6)
    assert terminal("report", "out/model.json", "-o", "page.html").code == 0
    for page in (tmp_path / "out/report.html", tmp_path / "page.html"):
        number, planes = shown_on(page)
        assert number == f"{truth:.4g}" and len(planes) == 2
    table = terminal(*words, "-o", "again").out
    assert f"{truth:.4g} %" in table and "closed surface" in table
    cavity = [frame["cavity_ml"] for frame in record["frames"]]
    assert 100 * (1 - cavity[1] / cavity[0]) == pytest.approx(truth, abs=1e-6)


def test_the_reach_beyond_the_base_is_stated(terminal, exact, tmp_path):
    """What lies there is neither drawn nor counted, and nobody measured it."""
    record = record_of(terminal("track", written(tmp_path / "frames"), "-o", "out", "--json"))
    moving = qf.load(tmp_path / "out/model.json")
    heights = [
        (moving.at(time).mesh(name, 24).vertices - marks.base.point) @ marks.base.direction
        for time, marks in zip(moving.frame_times, moving.landmarks)
        for name in moving.surfaces
    ]
    assert record["extends_beyond_base"] == pytest.approx(max(each.max() for each in heights), rel=0.05)
    assert any("BASE_NOT_OBSERVED" in text and "which no volume counts" in text for text in record["notes"])
    assert any("BASE_NOT_OBSERVED" in text for text in moving.notes)


def test_insertions_of_the_contours_anchor_the_segments(terminal, exact, tmp_path):
    terminal("track", written(tmp_path / "frames"), "-o", "out")
    assert "UNANCHORED" not in terminal("measure", "out/model.json").err
    terminal("track", written(tmp_path / "without", inserts=False), "-o", "unanchored")
    assert "UNANCHORED" in terminal("measure", "unanchored/model.json").err


def test_frames_alone_have_their_own_base(terminal, exact, tmp_path):
    record = record_of(terminal("track", written(tmp_path / "f"), "--strategy", "alone", "-o", "out", "--json"))
    measured = record_of(terminal("measure", "out/frame_000.json", "out/frame_001.json", "--json"))["measures"]
    found = {row["quantity"]: row["value"] for row in measured}
    assert found["ejection fraction"] == pytest.approx(record["ejection_fraction"], abs=1e-9)


@pytest.mark.parametrize("valve", [0, 2])
def test_without_a_plane_in_every_frame_all_count_as_closed(terminal, exact, tmp_path, valve):
    done = terminal("track", written(tmp_path / "frames", valve=valve), "-o", "out", "--json")
    record = record_of(done)
    assert record["ejection_fraction"] == pytest.approx(measure(exact)["ejection fraction"], abs=1e-6)
    assert "not all frames have a plane of mitral points" in done.err and "closed surface" in record["volumes_from"]


# --- label images --------------------------------------------------------------------------------------------------

SPACING = np.array([2.0, 2.0, 6.0])
SIZES = (np.array([24.0, 22.0, 46.0]), np.array([16.0, 15.0, 38.0]))
TOPS = (21.0, 15.0)
"""Half an ellipsoid and more, whose base comes down; faces of slices."""


def below(semi_axes, height):
    """Volume in ml of an ellipsoid below z = height."""
    a, b, c = semi_axes
    return np.pi * a * b * (height - height**3 / (3 * c**2) + 2 * c / 3) / 1000


@pytest.fixture
def labels(tmp_path):
    """Two frames of a cavity with empty slices beyond its base and apex."""
    shape = np.array([32, 32, 15])
    low = np.array([-31.0, -31.0, -54.0])
    at = low + np.moveaxis(np.indices(shape), 0, -1) * SPACING
    frames = [(((at / size) ** 2).sum(axis=-1) < 1) & (at[..., 2] < top) for size, top in zip(SIZES, TOPS)]
    affine = np.diag([*SPACING, 1.0])
    affine[:3, 3] = low
    image = nibabel.Nifti1Image(np.stack(frames, axis=-1).astype(np.uint8), affine)
    image.header.set_xyzt_units("mm", "msec")
    nibabel.save(image, tmp_path / "labels_4d.nii")
    return "labels_4d.nii"


def test_the_ventricle_of_a_label_image_ends_with_its_labels_in_each_frame(terminal, labels):
    record = record_of(terminal("track", labels, *CUT, "-o", "out", "--json"))
    truth = [below(size, top) for size, top in zip(SIZES, TOPS)]
    assert [frame["cavity_ml"] for frame in record["frames"]] == pytest.approx(truth, rel=0.03)
    assert record["ejection_fraction"] == pytest.approx(100 * (1 - truth[1] / truth[0]), abs=1.5)
    moving = qf.load("out/model.json")
    assert [each.base.point[2] for each in moving.landmarks] == pytest.approx(TOPS)
    found = record_of(terminal("measure", "out/model.json", "--json"))["measures"]
    values = {row["quantity"]: row["value"] for row in found}
    assert values["ejection fraction"] == pytest.approx(record["ejection_fraction"], abs=1e-9)


def test_wrong_options_are_refused_in_one_line(terminal, labels, cloud):
    for words, code, message in (
        ((labels, *CUT, "--surface", "endo=label:1"), 2, "--heart and --surface exclude"),
        ((labels, *CUT, "--columns", "x,y,z"), 2, "--heart and --columns exclude"),
        ((labels, "--heart", "epi=label:1"), 2, "epi without endo"),
        ((labels, "--heart", "endo=label:7"), 4, "no voxel has the label 7"),
        ((cloud, *CUT), 2, "--heart goes with images"),
    ):
        result = terminal("track", *words, "-o", "out")
        assert (result.code, len(result.err.splitlines())) == (code, 1), result.err
        assert message in result.err


def test_bases_that_face_each_other_are_refused(terminal, labels, tmp_path):
    """The labels of one image are wider at the one end, those of the other at the other."""
    image = nibabel.load(labels)
    values = np.asarray(image.dataobj)
    for name, each in (("a.nii", values[..., 0]), ("b.nii", values[:, :, ::-1, 0])):
        nibabel.save(nibabel.Nifti1Image(each, image.affine, image.header), tmp_path / name)
    result = terminal("track", "a.nii", "b.nii", *CUT, "-o", "out")
    assert result.code == 4 and "frames 1: the base was found at the other end" in result.err
