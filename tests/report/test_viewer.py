"""The viewer's numbers against Python's, in a browser with and without WebGL."""

import json
import re

import numpy as np
import pytest
from heart_made import beating
from shapes_made import made

import quadriform as qf
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.report.page import Section, page, source
from quadriform.report.viewer import FIELD_CELLS, ScalarField, Scene, payload, viewer
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel

SHAPES = {kind: made(kind) for kind in ("ellipsoid", "toroid", "hyperboloid1", "hyperboloid2")}


def bent(surfaces, seed=0, shape=(4, 5, 3), **marks):
    """A model whose control points are moved by a twentieth of the box."""
    first = next(iter(surfaces.values()))
    box = ControlBox.around(first, shape)
    moved = np.random.default_rng(seed).normal(size=box.control_points.shape) * np.linalg.norm(box.edges, axis=1) / 20
    return DeformableModel(surfaces, box.with_control_points(box.control_points + moved), **marks)


def written(folder, model, scene=None, title="model"):
    path = folder / "page.html"
    path.write_bytes(page(title, "", [Section("Model", viewer(model, scene))], source("viewer/viewer.css")))
    return path


@pytest.mark.parametrize("kind", SHAPES)
def test_vertices_are_where_python_has_them_and_so_is_the_volume(browser, tmp_path, kind):
    model = bent({"surface": SHAPES[kind]}, unit="mm")
    browser.open(written(tmp_path, model))
    size = np.ptp(model.mesh().vertices, axis=0).max()
    for cells in (5, 8):
        seen = np.reshape(browser.run("return quadriform.vertices('surface', arguments[0])", cells), (-1, 3))
        assert np.abs(seen - model.mesh(resolution=cells).vertices).max() < 1e-6 * size  # control points in 32 bits
    assert browser.colours() > 5
    if kind in ("ellipsoid", "toroid"):  # the closed ones
        assert browser.text("volume-surface") == f"{float(f'{model.volume() / 1000:.4g}')} ml"


def test_a_moved_control_point_changes_the_volume_as_python_says(browser, tmp_path):
    model = bent({"surface": SHAPES["ellipsoid"]}, unit="mm")
    browser.open(written(tmp_path, model))
    before = browser.picture()
    for name, value in {"i": 3, "j": 2, "k": 1, "dx": 2, "dy": -0.5, "dz": 1}.items():
        browser.run("document.getElementById('move-' + arguments[0]).value = arguments[1]", name, value)
    browser.run("document.getElementById('move').requestSubmit()")
    moved = model.box.control_points.copy()
    moved[3, 2, 1] += (2, -0.5, 1)
    after = DeformableModel(model.surfaces, model.box.with_control_points(moved)).volume() / 1000
    assert abs(after / (model.volume() / 1000) - 1) > 0.01
    assert browser.run("return quadriform.volume('surface')") == pytest.approx(after, rel=1e-6)
    assert browser.picture() != before
    browser.run("document.getElementById('undo').click()")
    assert browser.run("return quadriform.volume('surface')") == pytest.approx(model.volume() / 1000, rel=1e-6)
    browser.check()


def test_a_control_point_is_dragged_by_the_mouse(every_browser, tmp_path):
    from selenium.webdriver.common.action_chains import ActionChains

    every_browser.open(written(tmp_path, bent({"surface": SHAPES["ellipsoid"]}, unit="mm")))
    volume = every_browser.run("document.getElementById('show-box').click(); return quadriform.volume('surface')")
    canvas = every_browser.driver.find_element("id", "scene")
    x, y = every_browser.run(
        """const c = quadriform.camera, [l, m, n] = JSON.parse(document.getElementById('model').textContent).box.shape;
        const data = JSON.parse(document.getElementById('model').textContent);
        const raw = new Float32Array(Uint8Array.from(atob(data.control), (b) => b.charCodeAt(0)).buffer);
        const last = raw.length - 3, p = c.seen([0, 1, 2].map((k) => raw[last + k] + data.centre[k]), 0);
        const scale = document.getElementById('scene').clientHeight / 2 / c.reach;
        return [scale * p[0], -scale * p[1]]"""
    )
    ActionChains(every_browser.driver).move_to_element_with_offset(
        canvas, round(x), round(y)
    ).click_and_hold().move_by_offset(-40, 25).release().perform()
    assert abs(every_browser.run("return quadriform.volume('surface')") / volume - 1) > 1e-3
    every_browser.check()


def test_time_moves_surface_and_volume(browser, tmp_path):
    model = beating(4)
    browser.open(written(tmp_path, model, Scene(errors=[0.5] * 4)))
    volumes = [model.at(t).volume("endo") / 1000 for t in model.frame_times]
    fraction = 100 * (1 - min(volumes) / max(volumes))
    assert browser.number("ejection") == float(f"{fraction:.4g}")
    assert browser.number("error") == 0.5
    pictures = set()
    for time in (0.0, 0.3, 0.5, 0.9):  # at frames and between them
        browser.run(
            """const slider = document.getElementById('time'); slider.step = 'any'; slider.value = arguments[0];
            slider.dispatchEvent(new Event('input'))""",
            time,
        )
        for name in ("endo", "epi"):
            assert browser.number(f"volume-{name}") == float(f"{model.at(time).volume(name) / 1000:.4g}")
        pictures.add(browser.picture())
    assert len(pictures) == 4
    browser.check()


def test_play_runs_and_stops(browser, tmp_path):
    browser.open(written(tmp_path, beating(2), Scene(errors=[None] * 2)))
    browser.run("document.getElementById('play').click()")
    browser.wait_until(lambda: browser.number("time-now") > 0)
    browser.run("document.getElementById('play').click()")
    stopped = browser.number("time-now")
    browser.driver.execute_async_script(
        "const frame = requestAnimationFrame, done = arguments[0]; frame(() => frame(() => frame(done)))"
    )
    assert browser.number("time-now") == stopped


def test_a_click_on_the_volume_curve_sets_the_time_that_is_drawn_there(browser, tmp_path):
    browser.open(written(tmp_path, beating(4), Scene(errors=[None] * 4)))
    click = """const area = document.getElementById('line').getBoundingClientRect();
        const place = { clientX: area.left + arguments[0] * area.width, bubbles: true };
        document.getElementById('volume-curve').dispatchEvent(new MouseEvent('click', place))"""
    for part in (0.0, 0.25, 0.9):  # of a period of 1
        browser.run(click, part)
        assert browser.number("time-now") == pytest.approx(part, abs=0.005)


def test_the_base_cuts_the_cavity_as_in_python(browser, tmp_path):
    model, ventricle = beating(4), SyntheticVentricle()
    point, direction = ventricle.base_plane(0.8)
    planes = [(np.asarray(point), np.asarray(direction))] * 4
    browser.open(written(tmp_path, model, Scene(errors=[None] * 4, planes=planes)))
    measured = qf.measure([model.at(t) for t in model.frame_times], base=(point, direction))
    assert browser.number("volume-endo") == float(f"{measured['end-diastolic volume']:.4g}")
    assert browser.number("ejection") == float(f"{measured['ejection fraction']:.4g}")
    cut = browser.picture()
    browser.open(written(tmp_path, model, Scene(errors=[None] * 4)))
    assert browser.picture() != cut


def test_only_what_reaches_below_the_base_is_drawn(browser):
    """Three squares on top of each other in the plane y = 0, and a base between the second and the third."""
    x = [value for height in range(4) for corner in (0, 1) for value in (corner, 0, height)]
    quads = [vertex for k in (0, 2, 4) for vertex in (k, k + 1, k + 3, k + 2)]
    script = f"{source('viewer/model.js')}; return [...quadsBelow(...arguments)]"
    browser.driver.get("about:blank")
    for height, kept in ((1.5, 8), (1.0, 8), (2.0, 12), (-1.0, 0)):
        assert browser.run(script, quads, x, [[0, 0, height], [0, 0, 1]]) == quads[:kept]
    assert browser.run(script, quads, x, None) == quads


def test_every_colour_and_switch_draws_something_else(every_browser, tmp_path):
    model = bent({"inner part": SHAPES["ellipsoid"], "outer": made(semi_axes=(4.0, 3.0, 5.0))}, unit="mm")
    places = {name: model.box.deform(s.grid(FIELD_CELLS)[0]) for name, s in model.surfaces.items()}
    values = {name: [np.where(x[:, 0] > x[:, 0].mean(), np.nan, x[:, 1])] for name, x in places.items()}
    points = {name: [x[::3]] for name, x in places.items()}
    off = {name: [np.sin(x[::3, 2])] for name, x in places.items()}
    every_browser.open(
        written(tmp_path, model, Scene("both", points, off, [1.0], [ScalarField("residual", "mm", values)]))
    )
    pictures = [every_browser.picture()]
    for colour in ("residual", "displacement", "jacobian"):
        every_browser.run(
            """const choice = document.getElementById('colour'); choice.value = arguments[0];
            choice.dispatchEvent(new Event('input'))""",
            colour,
        )
        assert every_browser.text("legend-name") == colour and every_browser.text("high")
        pictures.append(every_browser.picture())
    for switch in ("show-points", "show-box", "show-arrows", "show-outer"):
        every_browser.run("document.getElementById(arguments[0]).click()", switch)
        pictures.append(every_browser.picture())
    assert len(set(pictures)) == len(pictures)
    every_browser.check()


def test_keys_turn_zoom_and_reset(every_browser, tmp_path):
    from selenium.webdriver.common.keys import Keys

    every_browser.open(written(tmp_path, bent({"surface": SHAPES["ellipsoid"]})))
    every_browser.driver.execute_async_script("setTimeout(arguments[0], 50)")
    first, canvas = every_browser.picture(), every_browser.driver.find_element("id", "scene")
    seen = []
    for key in (Keys.ARROW_LEFT, Keys.ARROW_UP, "+", "0"):
        canvas.send_keys(key)
        every_browser.driver.execute_async_script("setTimeout(arguments[0], 300)")
        seen.append(every_browser.picture())
    assert len({first, *seen[:3]}) == 4
    assert seen[3] == first


def test_a_name_that_looks_like_markup_stays_a_name(browser, tmp_path):
    name = "a</script><img src=x onerror=document.title='broken'>\"'"
    model = bent({name: SHAPES["ellipsoid"]}, unit="mm")
    browser.open(written(tmp_path, model, Scene(title=name), title=name))
    assert browser.driver.title == f"ready: {name}"
    assert browser.run("return quadriform.volume(arguments[0])", name) == pytest.approx(model.volume() / 1000, rel=1e-6)


def test_the_page_holds_parameters_and_not_meshes(tmp_path):
    model = beating(25)
    data = json.dumps(payload(model, Scene(errors=[None] * 25)))
    assert model.n_parameters == 4522 and len(data) < 40_000
    assert re.search(r"https?://(?!www\.w3\.org)", written(tmp_path, model).read_text(encoding="utf-8")) is None


def test_the_same_page_twice(tmp_path):
    scene = Scene(points={"surface": [np.zeros((0, 3))]}, residuals={"surface": [np.zeros(0)]})
    model = bent({"surface": SHAPES["ellipsoid"]})
    assert viewer(model, scene) == viewer(model, scene)
