"""The page that makes the paper again: every figure, its source, its numbers; made from one small cloud."""

import re
from dataclasses import replace

import numpy as np
import pytest

from quadriform.errors import InputError
from quadriform.fitting.fit import fit
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.volume import Volume
from quadriform.report.paper import clouds, drawing, image_figures, shape_figures, subjects, whole
from quadriform.report.paper.regularity_figures import _at_equal_error
from quadriform.report.paper.remake import beside, mm
from quadriform.report.paper.results import Results, count
from quadriform.report.paper.robustness import Robustness
from quadriform.report.paper.subjects import NEEDED, Reduced, Scan, Subject, check_hearts
from quadriform.report.paper.trade_off import TradeOff
from quadriform.report.paper.whole import FIGURES, drawn, paper_page
from quadriform.shapes.superquadric import Superquadric

SOURCE = "a test's own <ball> & nobody's"
LIMIT = 5_000_000


@pytest.fixture(scope="module")
def results():
    """An egg in a small image stands for every set of data; few iterations, and two fits that differ."""
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in (18, 16, 14)), indexing="ij"), axis=-1)
    inside = (((grid - [9, 8, 7]) / [6.5, 5.2, 4.4]) ** 2).sum(axis=-1) < 1
    volume = Volume(inside * 100.0, np.diag([5.0, 5.0, 5.0, 1.0]))
    mesh = points_from_image(volume, select=50.0).mesh
    rough, fine = (fit(mesh.vertices, method="paper", iterations=n, strength=1e-6) for n in (1, 5))
    egg = Subject("egg", SOURCE, {"surface": mesh.vertices}, rough, fine)
    caps = np.arange(len(mesh.vertices)) < 20
    scan = Scan(egg, volume, {"isosurface": mesh}, {"surface": len(mesh.vertices)}, "by hand", caps)
    trade = TradeOff((90.0, 40.0), (1e-6, 1e-2), (fine, rough), (fine, rough), (fine, rough), fine)
    robust = Robustness((0.0, 0.5), (1.0, 4.0), (1.0, 1.5), mesh.vertices)
    return Results(egg, Reduced(egg, egg, egg), trade, robust, scan, scan, scan, two_walls(scan))


def two_walls(scan):
    """The egg with a smaller one in it, in one box."""
    outer = scan.outlines["isosurface"]
    middle = outer.vertices.mean(axis=0)
    inner = replace(outer, vertices=middle + 0.6 * (outer.vertices - middle))
    meshes = {"epi": outer, "endo": inner}
    points = {name: mesh.vertices for name, mesh in meshes.items()}
    both = fit(points, method="paper", iterations=2)
    subject = Subject("shell", SOURCE, points, both, both, "endo", "A note.")
    return Scan(subject, scan.volume, meshes, {name: len(cloud) for name, cloud in points.items()}, "by hand")


@pytest.fixture(scope="module")
def text(results):
    done = []
    with pytest.MonkeyPatch.context() as patch:  # coarse meshes, and fewer of them: the same page in less time
        patch.setattr(drawing, "RESOLUTION", 4)
        patch.setattr(shape_figures, "GALLERY", (0.5, 2.0))
        page = drawn(results, lambda: done.append(1))
    assert len(done) == len(FIGURES)
    assert len(page) < LIMIT
    return page.decode()


def sections(text):
    """From the name of a figure to its part of the page."""
    parts = re.findall(r"<section .*?<h2[^>]*>(.*?)</h2>(.*?)</section>", text, re.DOTALL)
    return {title.split(":")[0]: body for title, body in parts}


def test_every_figure_is_there_in_the_papers_order(text):
    names = [name for name in sections(text) if name.startswith("Fig. ")]
    assert names == [f"Fig. {k}" for k in range(1, 23)]
    assert "No figure" in sections(text)


def test_every_figure_has_a_picture_and_every_picture_a_source(text):
    for name, body in sections(text).items():
        pictures = re.findall(r"<figure.*?</figure>", body, re.DOTALL)
        assert bool(pictures) == (name != "What the paper says in numbers"), name
        for picture in pictures:
            assert re.search(r"<figcaption>.*Source: \S.*</figcaption>", picture, re.DOTALL), name
            assert "<svg" in picture or 'src="data:image/png;base64,' in picture, name


def test_every_figure_says_what_the_paper_shows_and_how_ours_differs(text):
    for name, body in sections(text).items():
        if name != "What the paper says in numbers":
            assert re.search(r"The paper</strong> \(p\. \d\d\): \w", body), name
            assert 'class="verdict"' in body, name


def test_the_page_needs_nothing_beside_it(text):
    assert not re.search(r"""(?:src|href)=["'](?!#|data:)""", text)
    assert "a test&#39;s own &lt;ball&gt; &amp; nobody&#39;s" in text
    assert SOURCE not in text


def test_numbers_are_those_of_the_fits(text, results):
    egg = results.crossing
    cells = {name: re.findall(r"<td[^>]*>(.*?)</td>", body) for name, body in sections(text).items()}

    def after(figure, label):
        k = cells[figure].index(label)
        return cells[figure][k + 2 : k + 4]

    assert mm(egg.paper.rms) != mm(egg.default.rms)
    assert after("Fig. 6", "error RMS of the model") == [mm(egg.paper.rms), mm(egg.default.rms)]
    assert after("Fig. 3", "error RMS of the superellipsoid")[0] == mm(egg.paper.superquadric_rms)
    ratio = f"{egg.paper.compression_ratio:.1f}"
    assert after("Fig. 19", "compression ratio, egg") == [ratio, ratio]
    lids = [mm(np.sqrt(np.mean(f.residuals[20:] ** 2))) for f in egg.fits]
    assert after("Fig. 15", "the same without the lids where the image cuts the egg") == lids
    assert after("Fig. 22", "error RMS, first to last iteration, egg")[1].endswith(" in 5")
    shell = results.third.subject
    assert after("Fig. 21", "compression ratio, shell")[0] == f"{3 * shell.paper.n_points / 397:.1f}"
    assert after("Fig. 21", "the same for endo in a box of its own, by count")[0] == f"{3 * len(shell.cloud) / 386:.1f}"
    assert text.count("A note.") == 2
    assert after("No figure", "error with 50% strangers") == ["4 mm", "1.5 mm"]


def test_the_paper_is_quoted_with_its_own_ratios(text):
    summary = sections(text)["What the paper says in numbers"]
    for number in ("46", "7.7", "154"):
        assert f">{number}</td>" in summary
    assert "not given" not in summary


def test_without_hearts_the_page_says_so(text, results, monkeypatch):
    assert "No folder of real hearts was given" in text
    assert text.count("stand-in") == 2
    monkeypatch.setattr(whole, "FIGURES", (image_figures.first_images, image_figures.third_image))
    with_hearts = drawn(replace(results, human=results.crossing), lambda: None).decode()
    assert "No folder of real hearts" not in with_hearts
    assert "stand-in" not in with_hearts


def test_beside():
    assert beside(0.5, 1.0) == "50% smaller"
    assert beside(1.5, 1.0) == "50% larger"
    assert beside(1.01, 1.0) == "the same within 2 %"


def test_equal_errors_are_compared_where_curves_overlap():
    one = np.array([1.0, 2.0, 4.0]), np.array([8.0, 4.0, 2.0])
    assert _at_equal_error(one, (one[0], 3 * one[1])) == pytest.approx(3)
    assert np.isnan(_at_equal_error(one, (one[0] * 10, one[1])))


# --- synthetic data ----------------------------------------------------------------------------------------------


def test_crossing_superquadrics_keep_what_is_seen_outside():
    points = clouds.crossing(8)
    straight = points[:, :2] / (1 - 0.35 * points[:, 2:] / 50)  # the taper undone
    local = np.column_stack([straight, points[:, 2]])
    half, width = clouds.ARMS
    arms = [Superquadric(semi_axes=np.where(np.arange(3) == k, half, width), exponents=(0.6, 0.6)) for k in range(3)]
    values = np.stack([arm.implicit(local) for arm in arms])
    assert values.min(axis=0) == pytest.approx(1, abs=1e-9)


def test_sizes_are_the_papers():
    points = clouds.ventricle()
    assert len(points) == pytest.approx(6000, rel=0.03)
    assert np.ptp(points[:, 2]) == pytest.approx(100, abs=8)
    assert len(clouds.three_planes(points)) == 600
    assert len(np.unique(clouds.subsample(points), axis=0)) == 900


def test_three_planes_are_orthogonal_cuts():
    grid = np.stack(np.meshgrid(*(np.arange(-n, n + 1.0) for n in (6, 5, 4)), indexing="ij"), axis=-1).reshape(-1, 3)
    on_planes = grid[(grid == 0).any(axis=1)]
    assert len(clouds.three_planes(grid, len(on_planes))) == len(on_planes)
    found = clouds.three_planes(grid, len(on_planes))
    assert (np.abs(found).min(axis=1) < 1e-9).all()


def test_strangers_are_a_share_and_the_rest_is_untouched():
    points = clouds.ventricle(8)
    dirty = clouds.with_strangers(points, 0.25)
    moved = (dirty != points).any(axis=1)
    assert moved.sum() == round(0.25 * len(points))
    assert np.array_equal(clouds.with_strangers(points, 0.0), points)


def test_the_scanner_image_has_the_papers_voxels():
    volume = clouds.scanner_image()
    assert volume.values.shape == (98, 100, 110)
    assert volume.spacing == pytest.approx(0.926)
    blood = (volume.values > 145).sum() * 0.926**3
    from quadriform.heart.synthetic import SyntheticVentricle

    assert blood == pytest.approx(SyntheticVentricle().model(0.0).volume("endo"), rel=0.02)


@pytest.mark.slow
def test_stand_ins_have_the_papers_sizes_and_both_methods_refine_them():
    coarse, crossed = subjects.coarse_brain(), subjects.crossing()
    assert coarse.vertices["surface"] == pytest.approx(1000, rel=0.1)
    assert np.linalg.det(coarse.volume.world_from_voxel[:3, :3]) == pytest.approx(
        4**3 * np.linalg.det(subjects.example_volume().world_from_voxel[:3, :3])
    )
    assert len(crossed.cloud) == pytest.approx(6000, rel=0.1)
    for subject in (coarse.subject, crossed):
        assert max(subject.default.rms, subject.paper.rms) < 0.5 * subject.paper.superquadric_rms


# --- folders and the terminal ------------------------------------------------------------------------------------


def test_a_folder_without_hearts_is_refused_before_the_work(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        paper_page(tmp_path / "nowhere")
    (tmp_path / NEEDED[0]).parent.mkdir(parents=True)
    (tmp_path / NEEDED[0]).write_bytes(b"x")
    with pytest.raises(InputError, match=f"4 of {len(NEEDED)} files are missing: {re.escape(NEEDED[1])}"):
        check_hearts(tmp_path)


def test_real_data_is_where_the_page_looks(shared):
    check_hearts(shared / "data")
    assert count(shared / "data") > count(None)
