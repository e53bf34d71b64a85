"""The page that makes the paper again: every figure, its source, its numbers; made from small clouds, a figure "
"at a time."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import quadriform as qf
from quadriform.errors import InputError, OptionError
from quadriform.fitting.paper.displacement import data_to_model
from quadriform.fitting.result import rms
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.volume import Volume
from quadriform.report.paper import (
    convergence,
    drawing,
    image_figures,
    kinds,
    scans,
    shape_figures,
    space_figures,
    trade_off,
    whole,
)
from quadriform.report.paper.convergence import Convergence, measure_convergence
from quadriform.report.paper.remake import beside, listed, mm, similar
from quadriform.report.paper.robustness import Matching, Robustness
from quadriform.report.paper.scans import NEEDED, Scan, check_hearts
from quadriform.report.paper.subjects import Sparse, Subject, Walls, before, displacement_field, fitted, walls
from quadriform.report.paper.trade_off import FOUR, Curve, TradeOff, measure_trade_off, moved, ratios, turning
from quadriform.report.paper.whole import FIGURES, drawn, paper_page
from quadriform.report.slices import slice_pictures

SOURCE = "a test's own <ball> & nobody's"
LIMIT = 5_000_000
BOX = (3, 3, 3)


@pytest.fixture(scope="module", autouse=True)
def coarse():
    """Coarse meshes, and fewer of them and of the slices: the same pages in less time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawing, "RESOLUTION", 4)
        patch.setattr(shape_figures, "GALLERY", (0.5, 2.0))
        patch.setattr(image_figures, "SLICES", 2)
        yield


@pytest.fixture(scope="module")
def material():
    """An egg in a small image stands for every set of data; few control points, and two fits that differ."""
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in (18, 16, 14)), indexing="ij"), axis=-1)
    inside = (((grid - [9, 8, 7]) / [6.5, 5.2, 4.4]) ** 2).sum(axis=-1) < 1
    volume = Volume(inside * 100.0, np.diag([5.0, 5.0, 5.0, 1.0]))
    mesh = points_from_image(volume, select=50.0).mesh
    egg = Subject("egg", SOURCE, {"surface": mesh.vertices}, *both(mesh.vertices), note="A note.")
    caps = np.arange(len(mesh.vertices)) < 20
    scan = Scan(egg, volume, mesh, "by hand", caps, overlap=0.875)
    few = Subject("few", SOURCE, {"surface": mesh.vertices[::2]}, egg.default, egg.paper)
    curve = Curve((90, 64, 40, 20, 10, 8, 7, 6, 5, 4), np.linspace(1, 2, 10), np.linspace(9, 3, 10))
    fits = [egg.default, egg.paper] * 2
    middle = mesh.vertices.mean(axis=0)
    some = mesh.vertices[::3]
    points = {"epi": some, "endo": middle + 0.6 * (some - middle)}
    egg_end = Convergence(egg, egg.paper, (0, 1), (2.0, egg.paper.rms))
    found = SimpleNamespace(superquadric=kinds.TRUE[1])
    bent = kinds.Bent(kinds.TRUE[1], points["epi"], found, 0.5, points["epi"], egg.fits)
    return SimpleNamespace(
        box=BOX,
        real=False,
        crossing=egg,
        sparse=Sparse(egg, few, few),
        sparse_heart=None,
        matchings={
            "dense: egg": Matching(100, {"data-to-model": 0.3, "model-to-data": 0.2}, 0.1),
            "sparse: egg": Matching(10, {"data-to-model": 2.0, "model-to-data": 4.0}, 1.0),
        },
        kinds=[bent],
        trade_off=TradeOff(curve, curve, curve, curve.take(FOUR), fits, egg.default),
        robustness=Robustness((0.0, 0.5), (1.0, 4.0), (1.0, 1.5), 100),
        first=scan,
        second=scan,
        third=scan,
        walls=walls("shell", SOURCE, points, BOX),
        convergence=[egg_end],
    )


def both(points):
    """By the paper's method in one iteration, and in five with another box in the place of the default."""
    return [qf.fit(points, method="paper", box=box, iterations=n) for box, n in ((BOX, 1), ((4, 4, 4), 5))]


@pytest.fixture(scope="module")
def text(material):
    done = []
    page = drawn(material, list(FIGURES), lambda k, n: done.append((k, n)))
    assert done == [(k + 1, len(FIGURES)) for k in range(len(FIGURES))]
    assert len(page) < LIMIT
    return page.decode()


def sections(text):
    """From the name of a figure to its part of the page."""
    parts = re.findall(r"<section .*?<h2[^>]*>(.*?)</h2>(.*?)</section>", text, re.DOTALL)
    return {title.split(":")[0]: body for title, body in parts}


def cells(text):
    return {name: re.findall(r"<td[^>]*>(.*?)</td>", body) for name, body in sections(text).items()}


def after(text, figure, label):
    """The cells of both methods in the row of a label."""
    row = cells(text)[figure]
    k = row.index(label)
    return row[k + 2 : k + 4]


def comparison(text, figure):
    return re.search(r'class="comparison">(.*?)</p>', sections(text)[figure], re.DOTALL)[1]


def test_every_figure_is_there_in_the_papers_order(text):
    names = [name for name in sections(text) if name.startswith("Fig. ")]
    assert names == [f"Fig. {k}" for k in range(1, 23)]
    assert {"Section 2", "Section 3.4.2", "Section 6"} < sections(text).keys()


def test_every_figure_has_a_picture_and_every_picture_a_source(text):
    for name, body in sections(text).items():
        pictures = re.findall(r"<figure.*?</figure>", body, re.DOTALL)
        assert bool(pictures) == (name != "What the paper says in numbers"), name
        for picture in pictures:
            assert re.search(r"<figcaption>.*Source: \S.*</figcaption>", picture, re.DOTALL), name
            assert "<svg" in picture or 'src="data:image/png;base64,' in picture, name


def test_every_figure_says_what_the_paper_shows_and_compares_in_numbers(text):
    for name, body in sections(text).items():
        if name != "What the paper says in numbers":
            assert re.search(r"The paper</strong> \(p\. \d\d\): \w", body), name
            if name not in ("Fig. 13", "Fig. 14"):
                assert re.search(r"\d", comparison(text, name)), name


def test_texts_of_the_page_are_no_markup(text):
    """The texts of figures.toml are escaped like the numbers that fill them."""
    assert "det J &lt;= 0" in comparison(text, "Section 3.4.2")
    assert "<ball>" not in text and "&lt;ball&gt; &amp; nobody" in text


def test_the_page_needs_nothing_beside_it(text):
    assert not re.search(r"""(?:src|href)=["'](?!#|data:)""", text)
    assert "a test&#39;s own &lt;ball&gt; &amp; nobody&#39;s" in text
    assert SOURCE not in text


def test_text_in_charts_is_legible(text):
    """At least 12 pixels where a drawing keeps its width; charts are no wider than a narrow screen."""
    for drawing_ in re.findall(r"<svg.*?</svg>", text, re.DOTALL):
        sizes = [float(size) for size in re.findall(r"font: ([\d.]+)px", drawing_)]
        points = float(re.search(r'width="([\d.]+)pt"', drawing_)[1])
        assert sizes == [] or min(sizes) * 96 / 72 >= 12
        assert points * 96 / 72 < 390


def test_numbers_are_those_of_the_fits(text, material):
    egg = material.crossing
    assert mm(egg.paper.rms) != mm(egg.default.rms)
    assert after(text, "Fig. 6", "error RMS of the model") == [mm(egg.paper.rms), mm(egg.default.rms)]
    assert beside(egg.default.rms, egg.paper.rms) in comparison(text, "Fig. 6")
    assert after(text, "Fig. 3", "error RMS of the superellipsoid")[0] == mm(egg.paper.superquadric_rms)
    assert after(text, "Fig. 19", "compression ratio, egg") == [f"{fit.compression_ratio:.1f}" for fit in egg.fits]
    lids = [mm(np.sqrt(np.mean(f.residuals[20:] ** 2))) for f in egg.fits]
    assert after(text, "Fig. 15", "the same without the lids where the image or its region ends, egg") == lids
    assert after(text, "Section 6", "error with 50% outliers") == ["4 mm", "1.5 mm"]
    assert "0.88 (Dice)" in comparison(text, "Fig. 17")
    assert text.count("A note.") == 5


def test_sentences_follow_from_the_numbers(text, material):
    """Both ways: the comparisons of matchings change with the errors."""
    said = comparison(text, "Fig. 4")
    assert "50% larger on egg (0.300 and 0.200 mm)" in said and "50% smaller on egg (2.000 and 4.000 mm)" in said
    assert "nearer by more than 2% in 1 of 2 cases, the other one in 1." in said
    other = {
        name: replace(each, directions=dict(zip(each.directions, (4.0, 3.0))))
        for name, each in material.matchings.items()
    }
    page = drawn(SimpleNamespace(**vars(material) | {"matchings": other}), ["4"]).decode()
    assert "nearer by more than 2% in 0 of 2 cases, the other one in 2." in comparison(page, "Fig. 4")


def test_the_approximations_of_the_distance_stand_beside_the_exact_one(text, material):
    """Section 2.4: radial, P4 and Taubin's, of two points and of the data; each number from the distances."""
    row = cells(text)["Fig. 4"]
    body, cloud = material.crossing.paper.model.superquadric(), material.crossing.cloud
    exact = np.abs(qf.DeformableModel({"surface": body}, qf.ControlBox.around(body)).distance(cloud))
    for name, values in (
        ("radial |M0 M|", body.radial_distance(cloud)),
        ("first order (P4)", body.first_order_distance(cloud)),
        ("second order (Taubin)", body.taubin_distance(cloud)),
    ):
        above = f"{(values > exact * (1 + 1e-9)).mean():.0%}"
        k = row.index(name)
        assert row[k + 3 : k + 6] == [f"{rms(values):.3f}", f"{rms(values - exact):.3f}", above]
        assert f"{rms(values - exact):.3f}" in comparison(text, "Fig. 4") and above in comparison(text, "Fig. 4")
    assert row[row.index("exact |M P|") + 3] == f"{rms(exact):.3f}"
    of_n = [row[row.index(name) + 2] for name in ("first order (P4)", "second order (Taubin)", "exact |M P|")]
    assert float(of_n[1]) < float(of_n[2]) < float(of_n[0])


def test_one_box_is_compared_with_two_in_numbers(text, material):
    found = material.walls
    for name in ("epi", "endo"):
        one = [mm(rms(fit.residuals[name])) for fit in found.together.fits]
        assert after(text, "Fig. 21", f"error RMS in one box, {name}") == one
        two = [mm(fit.rms) for fit in found.alone[name].fits]
        assert after(text, "Fig. 21", f"error RMS in a box of its own, {name}") == two
    assert "One box has 103 parameters, two have 184." in comparison(text, "Fig. 21")
    alone = {name: replace(s, paper=far(s.paper), default=far(s.default)) for name, s in found.alone.items()}
    swapped = Walls(found.together, alone)
    assert "With the paper&#39;s method a box each is nearer by more than 2% on neither wall" in comparison(
        drawn(SimpleNamespace(**vars(material) | {"walls": swapped}), ["21"]).decode(), "Fig. 21"
    )


def far(fit):
    return replace(fit, residuals={name: 10 * values for name, values in as_named(fit.residuals).items()})


def as_named(residuals):
    return residuals if isinstance(residuals, dict) else {"surface": residuals}


def test_the_paper_is_quoted_with_its_own_ratios(text):
    summary = sections(text)["What the paper says in numbers"]
    for number in ("46", "7.7", "77", "154"):
        assert f">{number}</td>" in summary
    assert "not given" not in summary


def test_without_hearts_the_page_says_so(text, material):
    assert "No folder of real hearts was given" in text
    assert text.count("for no real data was given") == 2
    real = replace(material.first, real=True)
    given = {"real": True, "first": real, "third": real, "sparse_heart": material.sparse}
    with_hearts = SimpleNamespace(**vars(material) | given)
    page = drawn(with_hearts, ["9", "13", "14"]).decode()
    assert "No folder of real hearts" not in page and "no real data" not in page and "no medical example" not in page


def test_some_figures_alone_fit_only_what_they_need(monkeypatch):
    monkeypatch.setattr(shape_figures, "GALLERY", (1.0,))
    page = paper_page(figures=["5", "1"], box=(2, 3, 4)).decode()
    assert [name for name in sections(page) if name.startswith("Fig.")] == ["Fig. 1", "Fig. 5"]
    assert "2 x 3 x 4 control points" in page
    with pytest.raises(OptionError, match="figure='23' is unknown; expected one of '1', 'kinds', '2'"):
        paper_page(figures=["23"])
    with pytest.raises(OptionError, match="box"):
        paper_page(figures=["1"], box=(1, 5, 5))


def test_words_for_comparisons():
    assert beside(0.5, 1.0) == "50% smaller"
    assert beside(1.5, 1.0) == "50% larger"
    assert beside(1.01, 1.0) == "the same within 2%"
    assert similar(0.9, 100) == "similar (0.90% of the length)"
    assert similar(2.8, 100) == "not similar (2.80% of the length)"
    assert listed(["a", "b", "c"]) == "a, b and c"
    assert mm(26591.3) == "26,591 mm"


# --- what the figures are made of --------------------------------------------------------------------------------


def test_the_fits_are_by_the_papers_own_algorithm(material):
    """P7 by SVD in 30 iterations, with the box that was asked for: what the two-step loop gives when told so."""
    points = qf.examples.crossing_superquadrics(5)
    found = fitted("three", SOURCE, points, BOX)
    told = qf.fit(points, method="paper", regularity="svd", iterations=30, box=BOX)
    assert np.array_equal(found.paper.model.box.control_points, told.model.box.control_points)
    assert found.paper.iterations == 30
    assert found.default.model.box.control_points.shape == (*BOX, 3)


def test_displacements_are_those_of_the_paper_on_all_model_points(material):
    egg = material.crossing
    at, steps = displacement_field(egg.paper.model, egg.cloud, egg.surface)
    assert len(at) == len(steps) == 2402
    assert at == pytest.approx(egg.paper.model.box.deform(egg.paper.model.superquadric().grid(20)[0]))
    assert np.array_equal(steps, data_to_model(at, egg.cloud))
    rest = before(egg.paper.model)
    assert np.array_equal(rest.box.control_points, egg.paper.model.box.rest)


def test_regularities_are_p8_and_p9_as_printed(monkeypatch):
    monkeypatch.setattr(trade_off, "STRENGTHS", (1e-6, 1e-2, 1.0))
    monkeypatch.setattr(trade_off, "BENDING", (1e-4,))
    monkeypatch.setattr(trade_off, "FRACTIONS", (1.0, 0.5))
    monkeypatch.setattr(trade_off, "FOUR", (1, 0))
    found = measure_trade_off(BOX, 5)
    points = qf.examples.noisy(qf.examples.ventricle(5))
    strong = qf.fit(points, method="paper", regularity="springs-paper", strength=1.0, box=BOX)
    assert found.springs_paper.error[-1] == pytest.approx(strong.rms, rel=1e-9)
    assert found.springs_paper.moved[-1] == pytest.approx(moved(strong), rel=1e-9)
    assert (
        turning(found.springs_paper) < len(found.springs_paper.settings) - 1
    )  # the box collapses: its curve turns back
    assert turning(found.springs) == len(found.springs.settings) - 1
    whole_rank = qf.fit(points, method="paper", box=BOX)
    assert found.svd.error[0] == pytest.approx(whole_rank.rms, rel=1e-9)
    assert found.svd.settings == [27, 14]
    assert [fit.rms for fit in found.four] == list(found.svd.error[[1, 0]])


def test_motions_are_compared_at_equal_errors():
    one = Curve((1, 2, 3), np.array([1.0, 2.0, 4.0]), np.array([8.0, 4.0, 2.0]))
    assert ratios(one, replace(one, moved=3 * one.moved)) == pytest.approx(np.full(50, 3))
    assert len(ratios(one, replace(one, error=10 * one.error))) == 0
    back = Curve((1, 2, 3, 4), np.append(one.error, 9.0), np.append(one.moved, 50.0))
    assert ratios(one, back) == pytest.approx(np.ones(50))
    assert turning(back) == 2


def test_convergence_is_run_to_the_stop_test(monkeypatch):
    monkeypatch.setattr(convergence, "STEPS", (1,))
    points = qf.examples.crossing_superquadrics(6)
    subject = Subject("three", SOURCE, {"surface": points}, *[qf.fit(points, method="paper", box=BOX)] * 2)
    found = measure_convergence(subject, BOX)
    radius = rms(np.linalg.norm(points - points.mean(axis=0), axis=1))
    assert found.long.iterations < convergence.LONGEST
    assert found.long.history[-1].surface_motion < convergence.STOP * radius < found.long.history[-2].surface_motion
    assert found.errors[list(found.steps).index(30)] == subject.paper.rms
    error = np.array([record.error for record in found.long.history])
    near = np.abs(error - error[-1]) <= convergence.WITHIN * error[-1]
    assert near[found.converged - 1 :].all() and (found.converged == 1 or not near[found.converged - 2])


def test_an_undeformed_box_folds_nowhere(material):
    box = before(material.walls.together.paper.model).box
    assert space_figures._folded(box) == 0
    mirrored = box.with_control_points(box.rest * [-1, 1, 1])
    assert space_figures._folded(mirrored) == 1


def test_sections_of_boxes_are_turned_alike(material):
    """A box whose edges come in another order and run the other way is drawn as the first is."""
    model = material.walls.together.paper.model
    box = model.box
    origin, edges = box.origin + box.edges[0] + box.edges[2], -box.edges[[2, 1, 0]] * [[1], [-1], [1]]
    points = box.control_points.transpose(2, 1, 0, 3)[::-1, :, ::-1]
    other = replace(model, box=qf.ControlBox(origin, edges, points))
    here, there = (space_figures._section(each, box) for each in (model, other))
    for ours, theirs in zip(here, there):
        ends = [np.concatenate([part.reshape(-1, 2) for part in parts]) for parts in (ours, theirs)]
        order = [np.lexsort(np.round(points, 6).T) for points in ends]
        assert ends[0][order[0]] == pytest.approx(ends[1][order[1]], abs=1e-5)


def test_slices_of_one_value_are_left_out():
    values = np.zeros((6, 5, 40))
    values[2:4, 1:4, 10:31] = 7.0
    assert min(slice_pictures(values, np.eye(4), [], 5)) == 10
    assert max(slice_pictures(values, np.eye(4), [], 5)) == 30
    assert list(slice_pictures(values[:, :, :3], np.eye(4), [], 5)) == [0, 1, 2]


def test_the_page_fits_a_narrow_screen(material, tmp_path, browser):
    path = tmp_path / "paper.html"
    path.write_bytes(drawn(material, ["4", "11", "21", "22"]))
    with browser.phone():
        browser.driver.get(path.as_uri())
        assert browser.faults_of_layout() == []


def test_the_scanner_image_has_the_papers_voxels():
    volume = scans.scanner_image()
    assert volume.values.shape == (98, 100, 110)
    assert volume.spacing == pytest.approx(0.926)
    blood = (volume.values > 145).sum() * 0.926**3
    from quadriform.heart.synthetic import SyntheticVentricle

    assert blood == pytest.approx(SyntheticVentricle().model(0.0).volume("endo"), rel=0.02)


def test_real_hearts_come_through_the_papers_chain(shared):
    """From the grey image: threshold, largest component, closing, isosurface; the labels only judge the result."""
    image = qf.read_volume(shared / "data" / scans.PIG_IMAGE, 0)
    found = scans.PIG_CAVITY.points(image)
    assert found.record["components_kept"] == 1 and found.record["closing"] == scans.PIG_CAVITY.closing > 0
    by_hand = qf.read_volume(shared / "data" / scans.PIG_LABELS, 0).values == scans.CAVITY_LABEL
    region = tuple(slice(*pair) for pair in scans.PIG_CAVITY.region)
    mask = found.segmentation.mask[region]
    assert 2 * (mask & by_hand[region]).sum() / (mask.sum() + by_hand[region].sum()) > 0.8
    for study in (1, 2):
        spect = scans.SPECT_WALL.points(qf.read_volume(shared / "data" / scans.SPECT_FILE.format(study)))
        assert spect.segmentation.hole_voxels == 0 and len(spect.points) > 1000


def test_stand_ins_have_the_papers_sizes():
    coarse = scans.coarse_brain(BOX)
    assert len(coarse.subject.cloud) == pytest.approx(1000, rel=0.1)
    assert np.linalg.det(coarse.volume.world_from_voxel[:3, :3]) == pytest.approx(
        4**3 * np.linalg.det(scans.example_volume().world_from_voxel[:3, :3])
    )
    for fit in coarse.subject.fits:
        assert fit.rms < fit.superquadric_rms


# --- folders ----------------------------------------------------------------------------------------------------


def test_a_folder_without_hearts_is_refused_before_the_work(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        paper_page(tmp_path / "nowhere")
    (tmp_path / NEEDED[0]).parent.mkdir(parents=True)
    (tmp_path / NEEDED[0]).write_bytes(b"x")
    with pytest.raises(InputError, match=f"4 of {len(NEEDED)} files are missing: {re.escape(NEEDED[1])}"):
        check_hearts(tmp_path)


def test_real_data_is_where_the_page_looks(shared):
    check_hearts(shared / "data")
    assert whole.FIGURES.keys() >= {str(k) for k in range(1, 23)}
