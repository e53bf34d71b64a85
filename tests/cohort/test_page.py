"""The page of a cohort: what it says of each subject, how it sorts, and modes of shape that move the model."""

import re
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from html import unescape

import numpy as np
import pytest
from cohort_made import TINY, listed, needs

from quadriform.cli.cohort_run import _record, _rows
from quadriform.cohort import executors
from quadriform.cohort.layout import read_layout
from quadriform.cohort.modes import write_modes
from quadriform.cohort.overview import SubjectSummary, overview
from quadriform.cohort.page import write_page
from quadriform.cohort.run import Choices, run
from quadriform.files import load

pytestmark = needs("zarr", "pyarrow", "sklearn")


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Five subjects, one of them broken, one warned: half of its points are no surface."""
    folder = tmp_path_factory.mktemp("page")
    cohort = listed(folder, 5, broken=(2,))
    spoilt = folder / "clouds" / "person04" / "0.npy"
    points = np.load(spoilt)
    points[::2] = points.mean(axis=0) + 1.6 * (points[::2] - points.mean(axis=0))
    np.save(spoilt, points)
    summary = run(cohort, folder / "out", partial(executors.from_executor, ThreadPoolExecutor(1), 1), Choices(TINY))
    return folder / "out", summary


@pytest.fixture(scope="module")
def results(ran):
    return ran[0]


def words(page):
    return re.sub(
        r"\s+", " ", re.sub(r"<(script|style).*?</\1>|<[^>]*>", " ", page.read_text(encoding="utf-8"), flags=re.S)
    )


def test_the_page_lists_every_subject(results):
    text = words(results / "cohort.html")
    assert "4 of 5 subjects have a model, 1 failed" in text
    assert all(f"person{number:02d}" in text for number in range(5))
    assert "PointsError" in text and str(results.parent) not in text


def test_the_warnings_of_each_model_are_on_the_page_and_in_the_table(results):
    parquet = pytest.importorskip("pyarrow.parquet")
    text = unescape((results / "cohort.html").read_text(encoding="utf-8"))
    table = parquet.read_table(results / "metrics").to_pylist()
    models = {path.parent.name: load(path) for path in sorted((results / "subjects").glob("*/model.json"))}
    assert any(model.warnings for model in models.values())
    for name, model in models.items():
        told = {row["quantity"].removeprefix("warning "): row["text"] for row in table if row["subject"] == name}
        assert model.record.title == name and [source.name for source in model.record.sources] == ["0.npy", "1.npy"]
        for kind, sentence in model.warnings.items():
            assert f"<strong>{kind}</strong>: {sentence}" in text
            assert told[kind] == sentence
    assert '<div class="summary warned">' in text


def test_the_terminal_counts_them(ran):
    results, summary = ran
    models = [load(path) for path in (results / "subjects").glob("*/model.json")]
    assert summary.warned == sum(model.status == "warned" for model in models) == 1
    assert summary.kinds == Counter(str(kind) for model in models for kind in model.warnings)
    record = _record(results, summary)
    assert (record["warned"], record["warnings"]) == (1, dict(summary.kinds))
    assert ("with warnings", "\n".join(["1", *(f"{kind}: 1" for kind in summary.kinds)])) in _rows(record)


@pytest.mark.parametrize(
    ("kinds", "status"),
    [([], "ok"), (["PARTIAL_COVERAGE"], "warned"), (["POOR_FIT", "FOLDING"], "unreliable"), (["OF_LATER"], "warned")],
)
def test_a_subject_has_the_status_of_its_warnings(kinds, status):
    subject = SubjectSummary(len(kinds), 0.1, "a", dict.fromkeys(kinds, "text"), (), {}, {}, 1)
    assert subject.status == status


def test_its_links_lead_to_the_models(results):
    links = re.findall(r'<a href="(subjects/[^"]+)"', (results / "cohort.html").read_text(encoding="utf-8"))
    assert len(links) == 4
    for link in links:
        assert load(results / link).frame_times.size == 2


def test_the_worst_come_first_and_any_number_has_room(results):
    every = overview(results, 100)
    assert len(every.worst) == len(every.rms) == 4
    assert [(v.n_warnings, v.rms) for v in every.worst] == sorted(
        ((v.n_warnings, v.rms) for v in every.worst), reverse=True
    )
    assert [verdict.id for verdict in overview(results, 2).worst] == [verdict.id for verdict in every.worst[:2]]


def test_the_mean_and_its_modes_are_written(results):
    parquet = pytest.importorskip("pyarrow.parquet")
    mean = load(results / "modes" / "mean.json")
    with np.load(results / "modes" / "modes.npz") as arrays:
        assert np.array_equal(arrays["mean"], mean.box.control_points)
        assert arrays["displacements"].shape == (3, 2, 2, 2, 3) and (np.diff(arrays["deviations"]) <= 0).all()
    scores = parquet.read_table(results / "modes" / "scores.parquet").to_pylist()
    assert len(scores) == 4 * 3 and {row["mode"] for row in scores} == {1, 2, 3}
    first = [row["score"] for row in scores if row["mode"] == 1]
    assert np.mean(first) == pytest.approx(0, abs=1e-9) and np.std(first, ddof=1) == pytest.approx(1)


def test_ids_cannot_break_the_page(results, tmp_path):
    """Ids are letters, digits and three signs; errors are anything, and escaped."""
    page = results / "cohort.html"
    before = page.read_bytes()
    table = results / "failures.csv"
    rows = table.read_bytes()
    table.write_bytes(rows + b"x,<script>alert(1)</script>,InputError\n")
    try:
        write_page(results, read_layout(results), None)
        assert "<script>alert" not in page.read_text(encoding="utf-8")
    finally:
        table.write_bytes(rows)
        page.write_bytes(before)


def test_columns_sort_both_ways_and_rows_are_chosen(browser, results):
    browser.open(results / "cohort.html")
    column = """return [...document.querySelectorAll('#subjects tbody tr')].filter((r) => !r.hidden)
        .map((r) => arguments[0] ? Number(r.cells[arguments[0]].dataset.value) : r.cells[0].textContent)"""
    click = "document.querySelectorAll('#subjects thead button')[arguments[0]].click()"
    browser.run(click, 4)
    up = browser.run(column, 4)
    assert up == sorted(up) and len(set(up)) == 4
    browser.run(click, 4)
    assert browser.run(column, 4) == up[::-1]
    browser.run(click, 0)
    assert browser.run(column, 0) == [f"person{number:02d}" for number in (0, 1, 3, 4)]
    browser.run("const s = document.getElementById('search'); s.value = '04'; s.dispatchEvent(new Event('input'))")
    assert browser.run(column, 0) == ["person04"]
    browser.check()


def test_the_page_can_be_read_and_sorted_on_a_phone(browser, results):
    with browser.phone():
        browser.open(results / "cohort.html")
        assert browser.run("return document.documentElement.scrollWidth") == 390
        assert browser.faults_of_layout() == []
        assert browser.run("return [...document.querySelectorAll('button.sort')].every(e => e.offsetWidth > 0)")


def test_a_slider_moves_the_mean_as_python_says(every_browser, results):
    every_browser.open(results / "cohort.html")
    modes = write_modes(results, read_layout(results))
    mean = modes.found.mean
    before = every_browser.picture()
    assert every_browser.run("return quadriform.volume('surface')") == pytest.approx(mean.volume(), rel=1e-5)
    slide = (
        "const s = document.getElementById(arguments[0]); s.value = arguments[1]; s.dispatchEvent(new Event('input'))"
    )
    every_browser.run(slide, "mode-1", 2)
    every_browser.run(slide, "mode-3", -1.5)
    moved = 2 * modes.displacements[0] - 1.5 * modes.displacements[2]
    box = mean.box.with_control_points(mean.box.control_points + moved)
    there = box.deform(mean.superquadric().grid(6)[0])
    seen = np.reshape(every_browser.run("return quadriform.vertices('surface', 6)"), (-1, 3))
    assert np.abs(seen - there).max() < 1e-5 * np.ptp(there)
    assert every_browser.text("sigma-1") == "2" and every_browser.picture() != before
    every_browser.run("document.getElementById('to-mean').click()")
    assert every_browser.run("return quadriform.volume('surface')") == pytest.approx(mean.volume(), rel=1e-5)
    every_browser.check()
