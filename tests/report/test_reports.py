"""Whole reports: what stands in them, that it is what Python says, and how they look in a browser."""

import base64
import io
import json
import re
from dataclasses import replace
from functools import partial
from html import unescape

import nibabel
import numpy as np
import pytest
from heart_made import beating
from PIL import Image

import quadriform as qf
from quadriform.cli.main import main
from quadriform.errors import OptionError
from quadriform.fitting.fit import fit
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.motion.track import Track
from quadriform.report import notebook
from quadriform.report.fields import uncertainty_field
from quadriform.report.reports import fit_report, model_report, track_report
from quadriform.report.slices import slices_png
from quadriform.report.viewer import FIELD_CELLS

MOST_BYTES = 5_000_000
BRIEF = ["--box", "3,3,3", "--method", "paper", "--iterations", "1"]
"""Where the surface does not matter."""


@pytest.fixture(scope="session")
def egg():
    """A fit of 300 noisy points of an ellipsoid, and the points."""
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(300, 3))
    points = directions / np.linalg.norm(directions, axis=1, keepdims=True) * (30, 20, 12) + rng.normal(
        scale=0.3, size=(300, 3)
    )
    return qf.fit(points, box=(3, 3, 3)), points


@pytest.fixture(scope="session")
def demo(tmp_path_factory):
    """The folder of `quadriform demo`; of fewer control points than the real one."""
    folder = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("quadriform.fitting.fit.fit", partial(fit, box=(3, 3, 3)))
        assert main(["demo", "-o", str(folder / "out")]) == 0
    assert qf.load(folder / "out" / "model.json").box.control_points.shape == (3, 3, 3, 3)
    return folder / "out"


def test_the_page_of_the_demo_says_what_the_model_says(browser, demo):
    model = qf.load(demo / "model.json")
    path = demo / "report.html"
    browser.open(path)
    assert path.stat().st_size < MOST_BYTES
    assert browser.number("volume-surface") == float(f"{model.volume() / 1000:.4g}")
    error = re.search(r"lies ([\d.]+) mm \(RMS\) from 18047", path.read_text(encoding="utf-8"))
    assert browser.number("error") == float(error[1])
    assert browser.colours() > 20
    assert browser.run("return document.querySelectorAll('img').length") == 9


def test_a_report_begins_with_the_summary_and_holds_the_fit(egg):
    fit, points = egg
    text = fit_report(fit, {"surface": points}, title="an egg", record={"options": {"box": [3, 3, 3]}}).decode()
    titles = re.findall(r"<h2[^>]*>(.*?)</h2>", text)
    assert titles[:3] == ["Summary", "Model", "Errors"]
    assert titles[-2:] == ["Description of the method", "Configuration and record"]
    assert f"<strong>{fit.status}</strong>" in text
    for number in (fit.rms, fit.superquadric_rms, float(np.abs(fit.residuals).max())):
        assert f"{number:.4g}" in text
    assert f"{fit.compression_ratio:.1f}" in text and str(fit.model.n_parameters) in text
    assert "Bardinet" in text and f"quadriform {qf.__version__}" in text


def test_the_uncertainty_shown_is_that_of_the_fit(egg):
    fit, _ = egg
    (shown,) = uncertainty_field(fit).values["surface"]
    points = fit.model.box.deform(fit.model.superquadric().grid(FIELD_CELLS)[0])
    assert shown.min() > 0 and np.array_equal(shown, fit.uncertainty(points))


def test_warnings_are_shown_first(egg):
    fit, points = egg
    cut = np.concatenate([points[points[:, 2] < 10], [[90.0, 0, 0], [0, 95, 0]]])
    warned = qf.fit(cut, box=(3, 3, 3))
    text = fit_report(warned, {"surface": cut}, title="an egg", record={}).decode()
    assert warned.warnings and warned.notes and fit.status == "ok"
    assert all(note in unescape(text) for note in warned.notes)
    for kind, sentence in warned.warnings.items():
        assert str(kind) in text and sentence in unescape(text)
        assert text.index(str(kind)) < text.index("<canvas")


def test_titles_and_records_are_escaped(egg):
    fit, points = egg
    bad = "<img src=x onerror=alert(1)>"
    text = fit_report(fit, {"surface": points}, title=bad, record={"input": bad}).decode()
    assert bad not in text and text.count("&lt;img src=x") >= 3


def test_the_same_fit_gives_the_same_page(egg):
    fit, points = egg
    one, two = (fit_report(fit, {"surface": points}, title="egg", record={"seconds": s}) for s in (1.0, 2.0))
    assert one == two


def test_a_page_without_points_and_with_many(browser, egg, tmp_path):
    fit, points = egg
    many = np.tile(points, (450, 1))
    repeated = replace(fit, residuals=np.tile(fit.residuals, 450))
    page = fit_report(repeated, {"surface": many}, title="many", record={})
    assert len(page) < MOST_BYTES
    (tmp_path / "many.html").write_bytes(page)
    browser.open(tmp_path / "many.html")
    (tmp_path / "model.html").write_bytes(model_report(fit.model, title="alone", record={}))
    browser.open(tmp_path / "model.html")
    assert browser.run("return document.getElementById('show-points').disabled")


@pytest.fixture(scope="session")
def cycle():
    """The synthetic ventricle as if it had been tracked, its points, and its measures."""
    moving, ventricle = beating(), SyntheticVentricle()
    times = moving.frame_times
    clouds = [
        {name: ventricle.surface_points(name, t, 400, 0.4, seed=k) for name in ("epi", "endo")}
        for k, t in enumerate(times)
    ]
    models = tuple(moving.at(t) for t in times)
    residuals = tuple({n: m.distance(c, n) for n, c in frame.items()} for m, frame in zip(models, clouds))
    found = Track("cycle", times, models, moving, residuals, 0.4, (1e-6, 1e-3))
    return found, clouds, qf.measure(models, times)


@pytest.fixture(scope="session")
def page_of_a_heart(cycle, tmp_path_factory):
    found, clouds, measures = cycle
    path = tmp_path_factory.mktemp("heart") / "heart.html"
    path.write_bytes(track_report(found, clouds, title="a heart", record={}, measures=measures))
    return path


def test_the_page_of_a_ventricle_says_what_python_says(browser, cycle, page_of_a_heart):
    found, _, measures = cycle
    page = page_of_a_heart.read_bytes()
    assert len(page) < MOST_BYTES
    browser.open(page_of_a_heart)
    assert browser.number("ejection") == float(f"{measures['ejection fraction']:.4g}")
    assert browser.number("volume-endo") == float(f"{measures['end-diastolic volume']:.4g}")
    assert browser.number("error") == float(f"{found.frame_rms[0]:.4g}")
    assert browser.colours() > 20
    text = page.decode()
    for row in measures.rows:
        if "segment" not in row.quantity:
            assert f"{row.value:.4g}" in text
    assert "Suinesiaputra" in text and "twist angle (not observed)" in text
    assert text.count("Bullseye of wall thickness") == 2


def test_frames_that_were_tracked_alone_show_the_first(cycle):
    found, clouds, _ = cycle
    alone = Track("alone", found.times, found.models, None, found.residuals, 0.4, (1e-6,))
    assert b'"time":null' in track_report(alone, clouds, title="a heart", record={})
    with pytest.raises(OptionError, match="no moving model"):
        notebook.as_html(alone)


def test_models_show_themselves_in_a_frame_of_their_own(egg, cycle):
    fit, _ = egg
    for thing in (fit, fit.model, cycle[0], cycle[0].moving):
        html = notebook.as_html(thing)
        assert html.startswith("<iframe sandbox") and html.count("<iframe") == 1
        inside = unescape(re.search(r'srcdoc="([^"]*)"', html)[1])
        assert inside.startswith("<!doctype html>") and inside.endswith("</html>")
    with pytest.raises(OptionError, match="found int"):
        notebook.show(3)


def test_show_opens_a_file(egg, monkeypatch):
    opened = []
    monkeypatch.setattr(notebook.webbrowser, "open", opened.append)
    path = qf.show(egg[0])
    assert opened == [path.as_uri()] and path.read_bytes().startswith(b"<!doctype html>")
    path.unlink()


@pytest.fixture(scope="session")
def page_of_a_model(cycle, tmp_path_factory):
    """What the terminal writes of a model, and the words for it."""
    folder = tmp_path_factory.mktemp("page")
    qf.save(cycle[0].moving, folder / "model.json")
    words = ["report", str(folder / "model.json"), "-o", str(folder / "page.html"), "--base", "0.9"]
    assert main(words) == 0
    return folder, words


def test_the_terminal_writes_the_page_of_a_model(browser, cycle, page_of_a_model):
    browser.open(page_of_a_model[0] / "page.html")
    measured = qf.measure(cycle[0].models, cycle[0].times, base=0.9)
    assert browser.number("ejection") == float(f"{measured['ejection fraction']:.4g}")


def test_the_terminal_writes_no_page_over_another_nor_of_nothing(page_of_a_model, blank_figures, tmp_path, capsys):
    folder, words = page_of_a_model
    assert main(words) == 5  # exists already
    assert main([*words, "--force"]) == 0
    assert main(["report", str(tmp_path / "none.json"), "-o", str(tmp_path / "other.html")]) == 4
    assert main(["report", str(folder / "model.json"), "-o", str(tmp_path / "page.pdf")]) == 4
    both = [str(folder / "model.json"), "-o", str(tmp_path / "other.html"), "--base", "0.9", "--contours", "x"]
    assert main(["report", *both]) == 2
    assert list(tmp_path.iterdir()) == []


def test_the_image_is_shown_in_the_frame_that_was_asked_for(tmp_path, capsys):
    at = np.moveaxis(np.indices((24, 24, 24)), 0, -1) - 11.5
    values = ((at / (9, 7, 6)) ** 2).sum(axis=-1) < 1
    nibabel.save(nibabel.Nifti1Image(values.astype(np.uint8), np.diag([2.0, 2.0, 2.0, 1.0])), tmp_path / "egg.nii")
    for space in ("LPS", "RAS"):
        words = ["fit", str(tmp_path / "egg.nii"), "-o", str(tmp_path / space), "--space", space, *BRIEF]
        assert main(words) == 0
    pages = [(tmp_path / space / "report.html").read_text(encoding="utf-8") for space in ("LPS", "RAS")]
    pictures = [re.findall(r"data:image/png;base64,([^\"]+)", page) for page in pages]
    seen = [
        [np.asarray(Image.open(io.BytesIO(base64.b64decode(text))).convert("L"), float) for text in page]
        for page in pictures
    ]
    assert len(seen[0]) == 9
    for one, other in zip(*seen):  # the same slices with the same contours
        assert np.abs(one - other).mean() < 0.1
    shown = [json.loads(re.search(r'id="model">(.*?)</script>', page)[1])["axes"] for page in pages]
    assert shown == [["L", "P", "S"], ["R", "A", "S"]]


def test_slices_of_small_labels_and_of_even_images_are_drawn():
    """A label below a hundredth of the voxels made the window empty: a Python warning, and black pictures."""
    ball = {"ball": qf.Superquadric(semi_axes=(3, 3, 3), translation=(10, 10, 6)).mesh(6)}
    label = np.zeros((20, 20, 12))
    even = slices_png(label, np.eye(4), ball, "title", 3)
    label[9:11, 9:11, 5:8] = 1
    one, other = (
        np.asarray(Image.open(io.BytesIO(data)).convert("L"), float)
        for data in (slices_png(label, np.eye(4), ball, "title", 3), even)
    )
    assert (one - other).max() > 200


def test_the_configuration_in_effect_is_on_the_page(egg, tmp_path, capsys):
    np.savetxt(tmp_path / "egg.xyz", egg[1])
    words = ["fit", str(tmp_path / "egg.xyz"), "-o", str(tmp_path / "out"), "--box", "3,3,3", "--json"]
    assert main(words) == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    record = json.loads(unescape(page[page.rindex("<pre>") + 5 : page.rindex("</pre>")]))
    assert record["options"]["box"] == [3, 3, 3] and record["options"]["regularity"] == "bending"
    assert record["options"]["method"] == "tangent" and record["error"]["rms"] == pytest.approx(egg[0].rms, rel=1e-6)
    assert str(tmp_path) not in page


def test_a_hostile_file_name_runs_nothing(browser, egg, tmp_path, capsys):
    name = "<img src=x onerror=document.title=1><script>document.title=2<script>.xyz"
    np.savetxt(tmp_path / name, egg[1])
    assert main(["fit", str(tmp_path / name), "-o", str(tmp_path / "out"), *BRIEF]) == 0
    browser.open(tmp_path / "out" / "report.html")
    assert browser.driver.title == f"ready: {name}"
    assert browser.run("return [document.images.length, document.scripts.length]") == [0, 2]


def test_the_pages_can_be_read_on_a_phone(browser, page_of_a_heart, demo):
    with browser.phone():
        for page in (page_of_a_heart, demo / "report.html"):
            browser.open(page)
            assert browser.run("return document.documentElement.scrollWidth") == 390
            assert browser.faults_of_layout() == []
            # a column of sentences beside three others would be a few words wide
            widths = "return [...document.querySelectorAll('td')].filter(e => e.textContent.length > 60)"
            assert all(width > 300 for width in browser.run(f"{widths}.map(e => e.clientWidth)"))
