"""The wall as hexahedra: it fills the space between the surfaces, and its axes are a frame."""

import numpy as np
import pytest

from quadriform.errors import InputError, OptionError
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.wall import wall_mesh

ENDO = Superquadric(semi_axes=(20, 18, 40), exponents=(0.8, 1.1), translation=(1, 2, 0))
EPI = Superquadric(semi_axes=(30, 29, 50), exponents=(1, 0.9), translation=(0, 1, 3))


def model(noise=2.0, inner=ENDO):
    box = ControlBox.around(EPI)
    moved = box.control_points + np.random.default_rng(0).normal(0, noise, box.control_points.shape)
    return DeformableModel({"epi": EPI, "endo": inner}, box.with_control_points(moved))


def test_it_fills_the_wall_and_no_cell_is_folded():
    made = model()
    wall = wall_mesh(made, layers=3, resolution=24)
    assert wall.jacobians().min() > 0
    assert wall.volumes().sum() == pytest.approx(made.volume("epi") - made.volume("endo"), rel=3e-3)
    assert len(wall.cells) == 3 * 6 * 24**2


def test_its_first_and_last_layers_are_the_surfaces():
    made = model()
    vertices = wall_mesh(made, layers=2, resolution=4).vertices.reshape(3, -1, 3)
    assert np.abs(made.distance(vertices[0], "endo")).max() < 1e-6
    assert np.abs(made.distance(vertices[2], "epi")).max() < 1e-6


def test_axes_are_right_angled_and_point_as_named():
    wall = wall_mesh(model(0.0), layers=1, resolution=8, long_axis=(0, 0, 2))
    assert np.allclose(wall.axes @ wall.axes.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    middles = wall.vertices[wall.cells].mean(axis=1)
    assert (np.einsum("ij,ij->i", wall.axes[:, 0], middles - ENDO.translation) > 0).all()
    assert np.abs(wall.axes[:, 1, 2]).max() < 1e-12
    assert (wall.axes[:, 2, 2] >= -1e-12).all()


def test_what_cannot_be_a_wall_is_refused():
    with pytest.raises(OptionError, match="swapped"):
        wall_mesh(model(), "epi", "endo")
    with pytest.raises(OptionError, match="layers"):
        wall_mesh(model(), layers=0)
    ring = Superquadric("toroid", (5, 5, 5), hole_radius=2.0)
    with pytest.raises(OptionError, match="expected a superellipsoid, found kind='toroid'"):
        wall_mesh(model(inner=ring))
    with pytest.raises(InputError, match="folded"):
        wall_mesh(model(30.0))
