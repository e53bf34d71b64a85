"""The table of kinds: an entry is all that a new kind needs, for Python, the compiled loops, files and the viewer."""

import json
from dataclasses import replace

import numpy as np
import pytest
from shapes_made import SKEW, angles, even_directions, made

import quadriform as qf
from quadriform.fitting.superquadric.candidates import Candidates, distances
from quadriform.shapes.closest import closest_on, surface_points
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.kinds import KINDS, LAYOUTS, TERMS, Kind, Norm
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

CUSHION = Kind(
    name="cushion",
    title="superellipsoid around the y axis",
    inner=Norm(1, "z", "x"),
    outer=Norm(0, "y", "inner"),
    over="outer",
    under="one",
    powers=(-1, -1, -1),
    curves=("circle", "circle"),
    layout="sphere",
)
"""An ellipsoid whose coordinates have other names: x, y, z are y, z, x of the entry "ellipsoid"."""
SWAP = np.roll(np.eye(3), 1, axis=0)


@pytest.fixture
def pair(monkeypatch):
    """A new kind, and the ellipsoid that is the same body."""
    monkeypatch.setitem(KINDS, "cushion", CUSHION)
    sizes, rotation = np.array([3.0, 2.0, 1.5]), SKEW
    new = Superquadric("cushion", sizes, (0.6, 0.9), rotation, (1, 2, 3))
    return new, Superquadric("ellipsoid", SWAP @ sizes, (0.6, 0.9), rotation @ SWAP.T, (1, 2, 3))


def test_a_new_entry_is_a_kind_for_python(pair, rng):
    new, same = pair
    points = rng.normal(size=(50, 3)) * 3
    np.testing.assert_allclose(new.implicit(points), same.implicit(points), rtol=1e-12)
    np.testing.assert_allclose(new.gradient(points), same.gradient(points), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(new.project(points), same.project(points), rtol=1e-9)
    np.testing.assert_allclose(new.implicit(new.surface(even_directions(30))), 1, rtol=1e-12)
    assert new.mesh(16).volume() == pytest.approx(same.mesh(16).volume(), rel=1e-9)
    by_exponents = [f.parameter_derivatives(points)[1][:, 3:5] for f in (new, same)]
    np.testing.assert_allclose(*by_exponents, rtol=1e-9, atol=1e-12)


def test_a_new_entry_is_a_kind_for_the_compiled_loops(pair, rng):
    new, same = pair
    points = rng.normal(size=(50, 3)) * 3
    boxes = [ControlBox.around(each) for each in pair]
    new_feet, feet = (closest_on(each, box, points) for each, box in zip(pair, boxes))
    np.testing.assert_allclose(new_feet.signed, feet.signed, rtol=1e-6, atol=1e-8)
    normals = [surface_points(each, box, feet.origins)[1] for each, box in zip(pair, boxes)]
    np.testing.assert_allclose(*normals, atol=1e-9)
    found = [distances(Candidates.of([each]), points)[0] for each in (new, same)]
    np.testing.assert_allclose(*found, rtol=1e-9, atol=1e-12)


def test_a_new_entry_is_a_kind_for_files(pair, tmp_path):
    model = DeformableModel({"surface": pair[0]}, ControlBox.around(pair[0], (2, 2, 2)))
    qf.save(model, tmp_path / "model.json")
    again = qf.load(tmp_path / "model.json")
    assert again.superquadric().kind == "cushion"
    np.testing.assert_array_equal(again.mesh().vertices, model.mesh().vertices)


@pytest.mark.parametrize("name", KINDS)
def test_nothing_depends_on_the_name_of_a_kind(monkeypatch, rng, name):
    """With ridges too, which have a search of their own."""
    monkeypatch.setitem(KINDS, f"copy of {name}", replace(KINDS[name], name=f"copy of {name}"))
    same = replace(made(name), exponents=(1.4, 1.2))
    new = replace(same, kind=f"copy of {name}")
    points = same.grid(6)[0] + rng.normal(size=3)
    for found in zip(
        *((closest_on(s, ControlBox.around(s), points).signed, s.natural(angles(name))) for s in (same, new))
    ):
        np.testing.assert_allclose(*found, rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_every_entry_is_whole(kind):
    """What the compiled loops and the viewer take has a meaning there, and nothing is left out."""
    for norm in (kind.inner, kind.outer):
        assert {norm.u, norm.v} <= set(TERMS[:5]) and norm.exponent in (0, 1)
    assert kind.over in ("inner", "outer") and kind.under in ("one", "outer", "x")
    assert kind.layout in LAYOUTS and json.loads(json.dumps(kind.record())) == kind.record()
    assert (kind.volume is None) == (kind.cut_axis is not None)
    assert kind.codes.shape == (11,)
