"""Two surfaces side by side: spheres say what the distances and the overlap must be."""

import numpy as np
import pytest
from shapes_made import KINDS, SKEW, made, single
from shapes_meshes import box_mesh

from quadriform.errors import DegenerateError, InputError, OptionError
from quadriform.shapes import comparison
from quadriform.shapes.comparison import (
    _sampled,
    _to_surface,
    alone,
    dice,
    enclosed_volume,
    is_closed,
    parameter_difference,
    surface_distances,
)
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.pose import rotation_from_euler
from quadriform.shapes.superquadric import Superquadric

CENTRE = np.array([100.0, -40.0, 7.0])
SAMPLES = 4000


@pytest.fixture(autouse=True)
def fewer_samples(monkeypatch):
    """Enough for the tolerances here."""
    monkeypatch.setattr(comparison, "SAMPLES", SAMPLES)


def sphere(radius, centre=CENTRE):
    shape = Superquadric(semi_axes=(radius,) * 3, translation=centre)
    return single(shape, ControlBox.around(shape))


def deformed(seed=3):
    shape = made()
    box = ControlBox.around(shape)
    noise = np.random.default_rng(seed).normal(0, 0.1, box.control_points.shape)
    return single(shape, box.with_control_points(box.control_points + noise))


def plate(height=0.0, size=1.0):
    """A square of two triangles."""
    vertices = np.array([[0.0, 0, height], [size, 0, height], [size, size, height], [0, size, height]])
    return Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]))


def test_spheres_around_each_other_are_their_gap_apart():
    for found in surface_distances(sphere(10), sphere(12)):
        for value in (found.mean, found.rms, found.percentile_95, found.largest):
            assert value == pytest.approx(2, abs=2e-3)


def test_what_the_distances_are_of_a_shifted_sphere():
    """A point at angle t from the shift s is | |x - s| - r | away; cos t is even over a sphere."""
    r, s = 10.0, 4.0
    there, back = surface_distances(sphere(r), sphere(r, CENTRE + np.array([0, s, 0])))
    cosines = (np.arange(100_000) + 0.5) / 50_000 - 1
    expected = np.abs(np.sqrt(r**2 + s**2 - 2 * r * s * cosines) - r)
    for found in (there, back):
        assert found.mean == pytest.approx(expected.mean(), rel=5e-3)
        assert found.rms == pytest.approx(np.sqrt(np.mean(expected**2)), rel=5e-3)
        assert found.percentile_95 == pytest.approx(np.percentile(expected, 95), rel=5e-3)
        assert found.largest == pytest.approx(s, rel=5e-3)


def test_distances_to_a_large_triangle_are_exact_inside_and_beyond_its_edges():
    there, back = surface_distances(plate(0.5), plate())
    for found in (there, back):
        assert found.mean == pytest.approx(0.5, abs=1e-12) and found.largest == pytest.approx(0.5, abs=1e-12)
    wide = surface_distances(plate(0, 3), plate())[0]
    assert wide.largest == pytest.approx(2 * np.sqrt(2), rel=1e-12)
    assert surface_distances(plate(), plate(0, 3))[0].largest < 1e-12


def test_the_points_are_even_over_large_triangles():
    """From a unit square to the wall along its side the distances are even between 0 and 1."""
    wall = Mesh(plate(size=4).vertices[:, [2, 0, 1]] - [0, 2, 2], plate().faces)
    found = surface_distances(plate(), wall)[0]
    assert found.mean == pytest.approx(1 / 2, rel=1e-2)
    assert found.rms == pytest.approx(1 / np.sqrt(3), rel=1e-2)
    assert found.percentile_95 == pytest.approx(0.95, rel=1e-2)
    assert found.largest == 1


def test_a_model_with_itself():
    model = deformed()
    for found in surface_distances(model, model):
        assert found.largest < 1e-12
    assert dice(model, model) == 1
    numbers = parameter_difference(model, model)
    assert numbers.control_points == 0 and numbers.rotation < 1e-7
    assert not np.any([numbers.semi_axes, numbers.translation]) and not numbers.exponents.any()


def test_the_order_only_swaps():
    a, b = (deformed(seed).mesh(resolution=16) for seed in (3, 4))
    assert surface_distances(a, b) == surface_distances(b, a)[::-1]
    assert dice(a, b) == dice(b, a)


def test_a_model_is_its_mesh_also_wound_the_other_way():
    model = deformed()
    mesh = model.mesh(resolution=64)
    turned = Mesh(mesh.vertices, mesh.faces[:, ::-1])
    assert surface_distances(model, turned)[0].largest < 1e-12
    assert dice(model, turned) == 1
    assert enclosed_volume(turned) == pytest.approx(enclosed_volume(model), rel=1e-3)


def test_everything_grows_with_the_scale():
    models = deformed(), deformed(4)
    small, large = (
        [model.transformed(scale, np.zeros(3)).mesh(resolution=16) for model in models] for scale in (1, 1e-6)
    )
    one, two = surface_distances(*small)[0], surface_distances(*large)[0]
    assert two.rms == pytest.approx(1e-6 * one.rms, rel=1e-6)
    assert dice(*large) == pytest.approx(dice(*small), abs=1e-4)


def test_overlap_of_spheres():
    assert dice(sphere(10), sphere(12)) == pytest.approx(2 * 10**3 / (10**3 + 12**3), abs=1e-3)
    assert dice(sphere(10), sphere(10, CENTRE + 30)) == 0


@pytest.mark.parametrize(("height", "counted"), [(64.48, 64), (64.52, 65), (128, 128)])
def test_voxels_overlap_whose_centres_are_in_both(height, counted):
    """The longest side has 128 voxels, here of 1; their centres lie at halves."""
    whole, part = box_mesh((60.0, 100.0, 128.0)), box_mesh((60.0, 100.0, height))
    assert dice(whole, part) == dice(part, whole) == pytest.approx(2 * counted / (128 + counted), rel=1e-12)
    shift, r = 6.0, 10.0
    lens = np.pi * (4 * r + shift) * (2 * r - shift) ** 2 / 12
    for axis in np.eye(3):
        found = dice(sphere(r), sphere(r, CENTRE + shift * axis))
        assert found == pytest.approx(lens / (4 / 3 * np.pi * r**3), abs=2e-3)


def test_volumes_and_what_is_closed():
    assert enclosed_volume(sphere(10)) == pytest.approx(4 / 3 * np.pi * 1000, rel=1e-5)
    assert {kind: is_closed(made(kind).mesh(8)) for kind in KINDS} == {
        kind: not kind.startswith("hyperboloid") for kind in KINDS
    }
    mesh = made().mesh(8)
    assert is_closed(Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(mesh.faces.size).reshape(-1, 3)))
    assert not is_closed(Mesh(mesh.vertices, mesh.faces[1:]))
    assert enclosed_volume(plate()) is None


def test_numbers_of_two_models():
    one = made()
    turn = rotation_from_euler(np.array([0.0, 0.0, 0.3]))
    half = np.diag([-1.0, 1.0, -1.0])
    two = Superquadric("ellipsoid", one.semi_axes + np.array([1, 0, -1]), (0.7, 1.3), SKEW @ turn @ half, (1, -2, 3.5))
    box = ControlBox.around(one)
    a = single(one, box)
    found = parameter_difference(a, single(two, box.with_control_points(box.control_points + np.array([2, 0, 1]))))
    assert found.control_points == pytest.approx(np.sqrt(5))
    assert found.semi_axes == pytest.approx([1, 0, -1])
    assert found.exponents == pytest.approx([0.1, -0.1])
    assert found.translation == pytest.approx([0, 0, 3])
    assert found.rotation == pytest.approx(0.3)
    assert parameter_difference(a, single(one, ControlBox.around(one, (4, 5, 5)))) is None
    toroid = made("toroid")
    assert parameter_difference(a, single(toroid, ControlBox.around(toroid))) is None


def test_one_surface_of_several():
    two = DeformableModel({"epi": made(), "endo": made(exponents=(1, 1))}, ControlBox.around(made()))
    assert alone(two, "endo").superquadric() is two.surfaces["endo"]
    model = deformed()
    assert alone(model) is model and alone(model, "endo") is model
    for name in (None, "rv"):
        with pytest.raises(OptionError, match="'epi', 'endo'"):
            alone(two, name)


def test_what_has_no_overlap_or_no_area_is_refused():
    with pytest.raises(InputError, match="open"):
        dice(sphere(10), plate())
    with pytest.raises(InputError, match="voxel"):
        dice(sphere(1000), sphere(0.1, CENTRE + 1.234))
    with pytest.raises(DegenerateError, match="area"):
        surface_distances(sphere(10), Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]])))


def test_every_sample_counts_in_the_distances_to_a_plane():
    """Of a tetrahedron above a square: the distance of each sample is its height."""
    corners = np.array([[0.1, 0.2, 0.3], [0.9, 0.3, 0.4], [0.4, 0.8, 0.5], [0.5, 0.4, 0.9]])
    tetrahedron = Mesh(corners, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))
    square = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    samples = _sampled(tetrahedron)
    heights, found = samples.points[:, 2], _to_surface(samples, _sampled(square))
    assert found.mean == pytest.approx(heights[:SAMPLES].mean(), rel=1e-12)
    assert found.rms == pytest.approx(np.sqrt((heights[:SAMPLES] ** 2).mean()), rel=1e-12)
    assert found.percentile_95 == pytest.approx(np.percentile(heights[:SAMPLES], 95), rel=1e-12)
    assert found.largest == pytest.approx(0.9, rel=1e-12)
