"""`quadriform track`: frames from files become one moving model, a table of the frames, and a record."""

import csv
import json
import re

import nibabel
import numpy as np
import pytest

import quadriform as qf
from quadriform.fitting.support import Reach, Support
from quadriform.imaging.image_points import CAP
from quadriform.motion.slice_move import SliceMove
from quadriform.shapes.splines import TimeBasis

pytestmark = pytest.mark.usefixtures("blank_figures")

SUPPORT = Support(0.9, 0.9, 0.9, 0.9, 0.2, 1.0, Reach(1.0, 1.0))


def frames_written(folder, ellipsoid, count=4):
    """Each third of the points, smaller in each frame."""
    paths = []
    for frame in range(count):
        shrink = 1 - 0.1 * np.sin(np.pi * frame / count)
        paths.append(folder / f"frame{frame}.csv")
        np.savetxt(paths[-1], ellipsoid[::3] * shrink, delimiter=",", header="x,y,z", comments="")
    return paths


def test_files_become_a_moving_model(terminal, ellipsoid, tmp_path):
    files = frames_written(tmp_path, ellipsoid)
    done = terminal("track", *files, "-o", "out", "--box", "3,3,3", "--json")
    assert done.code == 0, done.err
    record = json.loads(done.out)
    model = qf.load(tmp_path / "out" / "model.json")
    assert isinstance(model, qf.MovingModel) and model.basis.period == 4.0
    rows = list(csv.DictReader((tmp_path / "out" / "frames.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["frame"] for row in rows] == ["0", "1", "2", "3"]
    assert {row["rows"] for row in rows} == {"4"}
    assert float(rows[2]["volume_surface"]) < float(rows[0]["volume_surface"])
    assert record["rms"] < 0.2 and record["min_jacobian"] > 0
    assert all(float(row["supported"]) > 0.95 for row in rows)
    assert record["frames"][1]["volume_surface"] == float(rows[1]["volume_surface"])


def test_a_folder_is_its_files_in_order_and_times_are_taken(terminal, ellipsoid, tmp_path):
    (tmp_path / "cine").mkdir()
    frames_written(tmp_path / "cine", ellipsoid)
    done = terminal("track", "cine", "-o", "out", "--box", "3,3,3", "--times", "0,10,20,35", "--period", "none")
    assert done.code == 0, done.err
    assert qf.load(tmp_path / "out" / "model.json").basis.period is None
    told = json.loads(terminal("info", "out/model.json", "--json").out)
    assert told["kind"] == "moving model" and told["knots"] == 4 and told["period"] == "none"
    assert "frames" in done.out and "strategy" in done.out
    assert re.search(r"supported by data\W+\d+ % of the area or more, least in frame \d", done.out)


def test_nothing_is_written_when_it_fails(terminal, ellipsoid, tmp_path):
    files = frames_written(tmp_path, ellipsoid, 2)
    for words, message in (
        ((files[0],), "a single one is for fit"),
        ((*files, "--times", "1,1"), "does not come after"),
        ((*files, "--times", "a,b"), "numbers between commas"),
        ((*files, "--period", "soon"), "--period"),
        ((*files, "--shift-slices"), "slice numbers"),
        ((*files, "--space", "LSA"), "--space"),
    ):
        done = terminal("track", *words, "-o", "out")
        assert done.code == 2 and message in done.err, done.err
        assert not (tmp_path / "out").exists()


def test_what_stands_there_is_kept(terminal, ellipsoid, tmp_path):
    files = frames_written(tmp_path, ellipsoid, 2)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "model.json").write_text("mine")
    done = terminal("track", *files, "-o", "out")
    assert done.code == 5 and (tmp_path / "out" / "model.json").read_text(encoding="utf-8") == "mine"


@pytest.fixture
def contours(tmp_path, ellipsoid):
    """Guide points of two frames."""
    paths = [tmp_path / f"GPFile_{frame:03d}.txt" for frame in range(2)]
    for path in paths:
        rows = ["x\ty\tz\tcontour type\tframeID\tweight\ttime frame"]
        for kind in ("SAX_LV_ENDOCARDIAL", "SAX_LV_EPICARDIAL"):
            rows += [f"{x}\t{y}\t{z}\t{kind}\t{n % 5}\t1.0\t0" for n, (x, y, z) in enumerate(ellipsoid.tolist())]
        path.write_text("\n".join(rows))
    return paths


@pytest.fixture
def known(monkeypatch):
    """In place of the work a result that is known; what it was asked for is kept."""
    asked = {}

    def track(sets, **options):
        clouds = [{name: each.points for name, each in frame.items()} for frame in sets]
        known = [{name: each.noise for name, each in frame.items()} for frame in sets]
        asked.update(options, clouds=clouds, noise=known, stated=options.get("noise"))
        surface = qf.Superquadric(semi_axes=(14, 12, 21), translation=(10, 40, -20))
        box, times = qf.ControlBox.around(surface, (3, 3, 3)), np.arange(len(clouds)) * 1.0
        boxes = np.stack([box.control_points * (1 - 0.1 * time) for time in times])
        basis = TimeBasis(times, float(len(times)))
        moving = qf.MovingModel(dict.fromkeys(clouds[0], surface), box.origin, box.edges, basis, boxes)
        models = tuple(moving.at(time) for time in times)
        residuals = tuple({name: np.ones(len(cloud)) for name, cloud in frame.items()} for frame in clouds)
        moved = SliceMove(np.array([0.1, 0.2, 0.3]), np.zeros(3), np.array([1.0, 2, 3]), np.eye(3), np.ones(6))
        moves = {2: moved} if options.get("slices") else {}
        support = tuple(dict.fromkeys(frame, SUPPORT) for frame in clouds)
        return qf.Track("cycle", times, models, moving, residuals, 1.0, (1e-5, 1e-5), moves, support=support)

    monkeypatch.setattr("quadriform.motion.tracking.track", track)
    return asked


def test_in_ras_models_and_shifts_have_x_and_y_negated(terminal, contours, known, ellipsoid, tmp_path):
    for out, words, signs in (("lps", (), [1, 1, 1]), ("ras", ("--space", "RAS"), [-1, -1, 1])):
        done = terminal("track", *contours, "-o", out, "--shift-slices", "--json", *words)
        record, model = json.loads(done.out), qf.load(tmp_path / out / "model.json")
        assert record["space"] == model.space == out.upper()
        assert record["shifts"]["2"] == record["moves"]["2"]["shift"] == [signs[0] * 1.0, signs[1] * 2.0, 3.0]
        found = np.radians(record["moves"]["2"]["rotation_degrees"])
        np.testing.assert_allclose(found, np.multiply([0.1, 0.2, 0.3], signs), rtol=1e-12)
        np.testing.assert_allclose(record["moves"]["2"]["axes"], np.diag(signs))
        assert np.array_equal(model.surfaces["endo"].translation, np.multiply([10, 40, -20], signs))
        np.testing.assert_allclose(model.control_points[0, 1, 1, 1], np.multiply([10, 40, -20], signs), atol=1e-12)
        assert np.array_equal(known["clouds"][1]["epi"], ellipsoid)  # the fit is in LPS, whatever is written


def test_slices_of_images_are_numbered_and_points_between_them_left_out(terminal, nifti, body, known, tmp_path):
    path = nifti("cine.nii", np.stack([body == 1] * 2, axis=-1).astype(np.uint8))
    words = ("--surface", "endo=label:1", "--surface", "epi=label:1")
    assert terminal("track", path, "-o", "plain", *words).code == 0
    every, plain = known["clouds"][1]["epi"], known["slices"]
    done = terminal("track", path, "-o", "shifted", *words, "--shift-slices")
    assert done.code == 0 and plain is None
    kept, numbers = known["clouds"][1]["epi"], known["slices"][1]["epi"]
    outlines = [k for k in range(body.shape[2]) if (body[:, :, k] == 1).any()]
    assert sorted(set(numbers)) == [CAP, *outlines] and len(kept) == len(numbers)
    left = 4 * (len(every) - len(kept))  # two frames, two surfaces
    assert f"slices are taken along k, 3 apart; {left} of {4 * len(every)} points" in done.err
    # what labels tell of the noise goes with the points that are kept
    assert all(
        each[name].shape == (len(frame[name]), 3, 3)
        for each, frame in zip(known["noise"], known["clouds"])
        for name in frame
    )


def test_frames_must_have_the_same_slices(terminal, nifti, body, known, contours, tmp_path):
    mask = (body == 1).astype(np.uint8)
    files = [nifti(f"{n}.nii", mask) for n in range(2)]
    assert terminal("track", *files, "-o", "same", "--shift-slices").code == 0
    moved = nibabel.load(files[1])
    moved.affine[2, 3] += 3
    nibabel.save(nibabel.Nifti1Image(mask, moved.affine, moved.header), tmp_path / "moved.nii")
    refused = terminal("track", files[0], "moved.nii", "-o", "other", "--shift-slices")
    assert refused.code == 2 and "the slices of frame 1 are not those of frame 0" in refused.err
    refused = terminal("track", files[0], contours[0], "-o", "other")
    assert refused.code == 4 and "holds contours" in refused.err
    assert not (tmp_path / "other").exists()


def test_frames_are_taken_in_the_order_of_their_numbers(terminal, known, ellipsoid, tmp_path):
    """As a shell gives them and from a folder; where one is missing its time is left out."""
    (tmp_path / "cine").mkdir()
    for frame in range(8, 12):
        np.savetxt(tmp_path / "cine" / f"frame_{frame}.xyz", ellipsoid * frame)
    for out, inputs in (("folder", ["cine"]), ("shell", sorted((tmp_path / "cine").iterdir()))):
        done = terminal("track", *inputs, "-o", out)
        assert done.code == 0 and "numbers in their names: frame_8.xyz, frame_9.xyz, frame_10.xyz" in done.err
        sizes = [np.linalg.norm(cloud["surface"][0]) for cloud in known["clouds"]]
        np.testing.assert_allclose(np.divide(sizes, sizes[0]), np.arange(8, 12) / 8)
    (tmp_path / "cine" / "frame_10.xyz").unlink()
    done = terminal("track", "cine", "-o", "gap")
    assert known["times"].tolist() == [8, 9, 11] and known["period"] == 4
    assert "no frames with the numbers 10" in done.err
    np.savetxt(tmp_path / "cine" / "frame_09.xyz", ellipsoid)
    refused = terminal("track", "cine", "-o", "twice")
    assert refused.code == 4 and "two files for one frame" in refused.err and not (tmp_path / "twice").exists()


def test_unpadded_frames(terminal, shared, tmp_path):
    """Twelve meshes of one ellipsoid at twelve sizes, whose volumes are known, in the order of their numbers."""
    folder = shared / "cases" / "frames_unpadded"
    done = terminal("track", *sorted(folder.iterdir()), "-o", "out", "--box", "2,2,2", "--json")
    volumes = np.array([frame["volume_surface"] for frame in json.loads(done.out)["frames"]])
    known = np.array([117.8, 113.9, 103.7, 90.7, 78.7, 70.7, 67.9])
    np.testing.assert_allclose(volumes[:7] / volumes[0], known / known[0], rtol=2e-3)


def test_each_alone_gives_a_model_a_frame(terminal, ellipsoid, tmp_path):
    files = frames_written(tmp_path, ellipsoid, 2)
    done = terminal("track", *files, "-o", "out", "--strategy", "alone", "--box", "3,3,3")
    assert done.code == 0, done.err
    assert isinstance(qf.load(tmp_path / "out" / "frame_001.json"), qf.DeformableModel)
    assert not (tmp_path / "out" / "model.json").exists()
    assert terminal("track", *files, "-o", "out", "--box", "3,3,3").code == 5
    assert terminal("track", *files, "-o", "out", "--box", "3,3,3", "--force").code == 0
    written = ["frames.csv", "model.json", "report.html"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == written
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "frame_001.json").write_bytes(b"mine")
    refused = terminal("track", *files, "-o", "new", "--strategy", "alone")
    assert refused.code == 5 and "frame_001.json': exists already" in refused.err


def test_the_noise_that_is_stated_is_used_and_shown(terminal, contours, nifti, body, known):
    record = json.loads(terminal("track", *contours, "-o", "out", "--noise", "1.5", "--json").out)
    assert known["stated"] == 1.5 and record["known_noise"] == "1.5 mm, by --noise"
    assert "nothing" in terminal("track", *contours, "-o", "without").out and known["stated"] is None
    path = nifti("cine.nii", np.stack([body == 1] * 2, axis=-1).astype(np.uint8))
    shown = terminal("track", path, "-o", "mask", "--surface", "endo=label:1")
    assert "0.866 mm along the edges of voxels" in " ".join(shown.out.replace("\u2502", " ").split())
    for text in ("-1", "0", "inf", "nan", "much"):
        refused = terminal("track", *contours, "-o", "no", f"--noise={text}")
        assert refused.code == 2 and f"option --noise={text!r}: expected a standard deviation above 0" in refused.err
