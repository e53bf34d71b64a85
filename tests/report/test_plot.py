"""Surfaces in three dimensions: what is drawn is the model's own mesh, and nothing outside the axes is touched."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure
from shapes_made import made, single

import quadriform as qf
from quadriform.errors import OptionError, PointsError
from quadriform.fitting.result import Fit
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.shapes.splines import TimeBasis

VENTRICLE = SyntheticVentricle()
MODEL = VENTRICLE.model(0.0)
RESOLUTION = 4
FEW = {"resolution": RESOLUTION}


def moving():
    """The ventricle at end diastole and end systole, and straight between them."""
    boxes = [VENTRICLE.model(time).box for time in (0.0, 0.5)]
    control = np.stack([box.control_points for box in boxes])
    return qf.MovingModel(
        MODEL.surfaces, boxes[0].origin, boxes[0].edges, TimeBasis(np.array([0.0, 0.5])), control, unit="mm"
    )


def box_of(axes):
    return np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])


def triangles(axes):
    """Every triangle of the surfaces on the axes, (m, 3, 3); matplotlib has no public way to ask for them."""
    return np.concatenate([drawn._faces for drawn in axes.collections if hasattr(drawn, "_faces")])


def test_the_triangles_are_those_of_the_meshes():
    meshes = [MODEL.mesh(name, RESOLUTION) for name in MODEL.surfaces]
    expected = np.concatenate([mesh.vertices[mesh.faces] for mesh in meshes])
    assert np.array_equal(np.sort(triangles(qf.plot(MODEL, **FEW)), axis=0), np.sort(expected, axis=0))


def test_one_surface_by_its_name():
    assert len(triangles(qf.plot(MODEL, surface="endo", **FEW))) == len(MODEL.mesh("endo", RESOLUTION).faces)


def test_the_resolution_is_the_meshs():
    assert len(triangles(qf.plot(MODEL, surface="endo", resolution=6))) == len(MODEL.mesh("endo", 6).faces)


def test_scales_are_equal_along_all_axes():
    axes = qf.plot(MODEL, **FEW)
    ratio = axes.get_box_aspect() / np.ptp(box_of(axes), axis=1)
    assert np.allclose(ratio, ratio[0], rtol=1e-9)


def test_labels_carry_the_unit_where_it_is_known():
    assert [getattr(qf.plot(MODEL, **FEW), f"get_{c}label")() for c in "xyz"] == ["x, mm", "y, mm", "z, mm"]
    unknown = single(made(), qf.ControlBox.around(made(), (3, 3, 3)))
    assert qf.plot(unknown, **FEW).get_xlabel() == "x"


def test_it_draws_on_the_axes_that_it_is_given():
    axes = Figure().add_subplot(projection="3d")
    assert qf.plot(MODEL, axes, surface="endo", **FEW) is axes
    before = len(axes.collections)
    qf.plot(MODEL, axes, surface="epi", **FEW)
    assert len(axes.collections) == before + 1
    vertices = MODEL.mesh("epi", RESOLUTION).vertices
    assert (box_of(axes)[:, 0] <= vertices.min(axis=0)).all() and (vertices.max(axis=0) <= box_of(axes)[:, 1]).all()


def test_points_are_drawn_where_they_are():
    points = VENTRICLE.surface_points("epi", 0.0, 50)
    for given in (points, {"epi": points[:20], "endo": points[20:]}):
        dots = qf.plot(MODEL, points=given, **FEW).collections[0]
        assert np.allclose(np.stack(dots._offsets3d, axis=1), points)


def test_a_number_a_vertex_becomes_the_mean_of_each_triangle():
    mesh = MODEL.mesh("endo", RESOLUTION)
    drawn = qf.plot(MODEL, surface="endo", colour=mesh.vertices[:, 2], **FEW).collections[-1]
    assert np.allclose(drawn.get_array(), mesh.vertices[mesh.faces, 2].mean(axis=1))
    assert drawn.get_clim() == (drawn.get_array().min(), drawn.get_array().max())


def test_a_colour_by_name_is_shown_in_its_hue():
    face = qf.plot(MODEL, surface="endo", colour="red", **FEW).collections[-1].get_facecolor()
    assert (face[:, 0] > 0.3).all() and np.allclose(face[:, 1:3], 0)


def test_a_moving_model_at_a_time_a_fit_and_a_mesh():
    at = triangles(qf.plot(moving(), time=0.5, **FEW))
    assert np.allclose(at, triangles(qf.plot(VENTRICLE.model(0.5), **FEW)))
    nothing = np.zeros(0)
    fit = Fit(MODEL, {}, nothing, nothing, (), 1.0, 1.0, nothing)
    assert np.array_equal(triangles(qf.plot(fit, **FEW)), triangles(qf.plot(MODEL, **FEW)))
    assert len(triangles(qf.plot(MODEL.mesh("epi", RESOLUTION)))) == len(MODEL.mesh("epi", RESOLUTION).faces)


def test_a_picture_comes_of_it(tmp_path):
    """Not one colour only: the surface is there when it is rendered."""
    qf.plot(MODEL, **FEW).figure.savefig(tmp_path / "picture.png", dpi=30)
    from matplotlib.image import imread

    assert len(np.unique(imread(tmp_path / "picture.png").reshape(-1, 4), axis=0)) > 50


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"resolution": 0}, "resolution"),
        ({"resolution": 2.5}, "resolution"),
        ({"resolution": 513}, "resolution"),
        ({"surface": "lumen"}, "lumen"),
        ({"time": 0.5}, "does not move"),
        ({"colour": "no such colour"}, "no colour"),
        ({"colour": [1.0, 2.0], "surface": "endo"}, "98 finite numbers"),
        ({"colour": np.full(98, np.nan), "surface": "endo"}, "98 finite numbers"),
        ({"colour": np.ones(98)}, "expected the name of one"),
        ({"axes": Figure().add_subplot()}, "three dimensions"),
        ({"axes": "left"}, "three dimensions"),
    ],
)
def test_what_cannot_be_drawn_is_refused(options, message):
    with pytest.raises(OptionError, match=message):
        qf.plot(MODEL, **({"resolution": RESOLUTION} | options))


def test_other_things_are_refused():
    with pytest.raises(OptionError, match="found int"):
        qf.plot(3)
    with pytest.raises(OptionError, match=r"frames go from 0 to 0\.5"):
        qf.plot(moving())
    with pytest.raises(OptionError, match="named surfaces"):
        qf.plot(MODEL.mesh(), surface="epi")
    with pytest.raises(PointsError, match="not finite"):
        qf.plot(MODEL, points=[[0.0, np.nan, 0.0]], **FEW)


def test_refusing_leaves_given_axes_as_they_were():
    axes = Figure().add_subplot(projection="3d")
    for options in (
        {"colour": "no such colour"},
        {"points": [[np.nan] * 3]},
        {"colour": np.ones(3), "surface": "endo"},
    ):
        with pytest.raises((OptionError, PointsError)):
            qf.plot(MODEL, axes, **FEW, **options)
    assert not axes.has_data() and axes.get_xlabel() == ""


def test_pyplot_is_never_touched():
    script = (
        "import sys, quadriform as qf, matplotlib\n"
        "from quadriform.heart.synthetic import SyntheticVentricle\n"
        "before = matplotlib.rcParams.copy()\n"
        "qf.plot(SyntheticVentricle().model(0.0), resolution=2)\n"
        "print('matplotlib.pyplot' in sys.modules, before == matplotlib.rcParams.copy())"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=True)
    assert done.stdout.split() == ["False", "True"]
