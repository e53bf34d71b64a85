"""The four kinds: F against the paper's and Barr's plain formulas, the parametrisations, distances, sizes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes_made import KINDS, SKEW, angles, even_directions, made

from quadriform import fit_superquadric
from quadriform.errors import OptionError, PointsError
from quadriform.shapes.closest import closest_on
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superellipse import norm, signed_power
from quadriform.shapes.superquadric import Superquadric
from quadriform.shapes.taubin import squared_implicit

MANY_EXPONENTS = [(1.0, 1.0), (0.6, 1.4), (0.3, 0.3), (0.01, 0.01), (2.0, 2.0)]


def plain_surface(q, kind, e1, e2, hole):
    """Barr's implicit surfaces, written out: 1 on the surface."""
    x, y, z = np.abs(q.T) ** (2 / np.array([[e2], [e2], [e1]]))
    if kind == "ellipsoid":
        return (x + y) ** (e2 / e1) + z
    if kind == "toroid":
        return (((x + y) ** (e2 / 2) - hole) ** 2) ** (1 / e1) + z
    if kind == "hyperboloid1":
        return (x + y) ** (e2 / e1) - z
    return (x - y) ** (e2 / e1) - z


@pytest.mark.parametrize("exponents", [(1.0, 1.0), (0.6, 1.4), (0.5, 0.5), (1.8, 1.3)])
@pytest.mark.parametrize("kind", KINDS)
def test_surface_is_barrs(kind, exponents):
    s = Superquadric(kind, exponents=exponents, hole_radius=made(kind).hole_radius, height=made(kind).height)
    for q in (s.natural(angles(kind)), s.grid(6)[0]):
        np.testing.assert_allclose(plain_surface(q, kind, *exponents, s.hole_radius), 1, rtol=1e-9, atol=1e-9)


def test_f_is_the_papers_p1(rng):
    s = made(exponents=(0.6, 1.4))
    points = rng.normal(size=(200, 3)) * 5
    x, y, z = np.abs((points - s.translation) @ SKEW / s.semi_axes).T
    e1, e2 = s.exponents
    p1 = ((x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1) + z ** (2 / e1)) ** (e1 / 2)
    np.testing.assert_allclose(s.implicit(points), p1, rtol=1e-12)


@pytest.mark.parametrize("exponent", [0.1, 0.5, 1.0, 1.7, 2.0])
def test_superellipse_is_p10(exponent):
    """(x / a)^(2/e) + (y / b)^(2/e) = 1 has the norm 1, x = a cos^e, y = b sin^e; k times as far it is k."""
    c, s = np.cos(np.linspace(0.05, 1.5, 20)), np.sin(np.linspace(0.05, 1.5, 20))
    np.testing.assert_allclose(norm(c**exponent, s**exponent, exponent), 1, rtol=1e-12)
    np.testing.assert_allclose(norm(-3 * c**exponent, 3 * s**exponent, exponent), 3, rtol=1e-12)
    assert norm(np.ones(1), np.ones(1), exponent)[0] == pytest.approx(2 ** (exponent / 2), rel=1e-12)


def test_powers_keep_their_sign():
    """A.1: sign(u) |u|^e."""
    u = np.array([-2.0, -0.5, 0.0, 0.25, 3.0])
    np.testing.assert_allclose(signed_power(u, 0.7), np.sign(u) * np.abs(u) ** 0.7, rtol=1e-12)


@given(
    st.floats(0.05, 2.0),
    st.floats(0.05, 2.0),
    st.floats(1e-3, 1e3),
    st.tuples(*[st.floats(-3, 3)] * 3).filter(lambda p: np.linalg.norm(p) > 0.01),
)
@settings(deadline=None, derandomize=True, max_examples=60)
def test_f_is_of_degree_one(e1, e2, factor, point):
    s = made(exponents=(e1, e2))
    f = s.implicit(s.translation + np.array([point, factor * np.array(point)]))
    np.testing.assert_allclose(f[1], factor * f[0], rtol=1e-9)


@pytest.mark.parametrize("exponents", MANY_EXPONENTS)
@pytest.mark.parametrize("kind", KINDS)
def test_f_is_one_on_every_parametrisation(kind, exponents, rng):
    s = made(kind, exponents)
    chart = even_directions(300) if kind == "ellipsoid" else angles(kind)
    # two sheets: beside the waist, where the axis' rays are long
    around = s.translation + rng.uniform(1, 6, (200, 3)) * rng.choice([-1.0, 1.0], (200, 3))
    for points in (s.grid(8)[0], s.surface(chart), s.natural(angles(kind)), s.project(around)):
        np.testing.assert_allclose(s.implicit(points), 1, rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_inside_is_below_one(kind):
    """Towards the core of the body F falls, away from it it grows."""
    s = made(kind, (0.8, 1.2))
    on = s.grid(6)[0]
    step = 0.05 * s.gradient(on) / np.linalg.norm(s.gradient(on), axis=1, keepdims=True)
    assert (s.implicit(on - step) < 1).all() and (s.implicit(on + step) > 1).all()
    named = {
        "ellipsoid": ([[0, 0, 0]], [[0, 0, 5]]),
        "toroid": ([[2.5 * 3, 0, 0]], [[0, 0, 0]]),
        "hyperboloid1": ([[0, 0, 3]], [[9, 0, 0]]),
        "hyperboloid2": ([[9, 0, 0], [-9, 0, 0]], [[0.1, 3, 0]]),
    }
    inside, outside = (s.translation + np.array(p) @ s.rotation.T for p in named[kind])
    assert (s.implicit(inside) < 1).all() and (s.implicit(outside) > 1).all()


def test_regular_parametrisation_keeps_directions():
    """Section 2.2: in units of the semi-axes the surface point lies on its direction's ray."""
    s = made(exponents=(0.4, 1.6))
    d = even_directions(200)
    scaled = (s.surface(d) - s.translation) @ s.rotation / s.semi_axes
    rho = np.linalg.norm(scaled, axis=1, keepdims=True)
    np.testing.assert_allclose(scaled / rho, d, atol=1e-14)
    np.testing.assert_allclose(s.surface(7 * d), s.surface(d), atol=1e-13)
    x, y, z = np.abs(d.T)
    e1, e2 = s.exponents
    expected = ((x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1) + z ** (2 / e1)) ** (-e1 / 2)
    np.testing.assert_allclose(rho[:, 0], expected, rtol=1e-12)


def test_radial_distance_is_section_2_4(rng):
    s = made(exponents=(0.6, 1.4))
    points = s.translation + rng.normal(size=(200, 3)) * 4
    f, from_centre = s.implicit(points), np.linalg.norm(points - s.translation, axis=1)
    foot = np.linalg.norm(s.project(points) - s.translation, axis=1)
    radial = s.radial_distance(points)
    np.testing.assert_allclose(radial, np.abs(1 - 1 / f) * from_centre, rtol=1e-9)
    np.testing.assert_allclose(radial, np.abs(f - 1) * foot, rtol=1e-9)
    np.testing.assert_allclose((f - 1) ** 2, (radial / foot) ** 2, rtol=1e-9)
    with pytest.raises(OptionError, match=r"radial_distance.*ellipsoid"):
        made("toroid").radial_distance(points)


@pytest.mark.parametrize("kind", KINDS)
def test_first_order_distance_is_exact_to_second_order(kind):
    """P4 a step h off the surface errs by O(h^2): ten times closer, a hundred times better."""
    s = made(kind, (0.8, 1.3))
    on = s.natural(angles(kind, 60, seed=9))
    normal = s.gradient(on) / np.linalg.norm(s.gradient(on), axis=1, keepdims=True)
    worst = [np.median(np.abs(s.first_order_distance(on + h * normal) - h)) for h in (1e-3, 1e-4)]
    assert worst[0] < 1e-2 * 1e-3
    assert worst[0] / worst[1] == pytest.approx(100, rel=0.05)


def test_first_order_distance_of_a_sphere_is_exact(rng):
    points = rng.normal(size=(50, 3))
    s = Superquadric(semi_axes=(2, 2, 2))
    np.testing.assert_allclose(s.first_order_distance(points), np.abs(np.linalg.norm(points, axis=1) - 2), rtol=1e-12)


@pytest.mark.parametrize("semi_axes", [(2, 2, 2), (3, 2, 4), (1, 1, 5), (4, 3, 0.5)])
def test_taubins_distance_bounds_that_to_an_ellipsoid_from_below(semi_axes, rng):
    s = Superquadric(semi_axes=semi_axes, rotation=SKEW, translation=(1, -2, 3))
    own = rng.uniform(-2, 2, (400, 3)) * semi_axes
    near = s.surface(even_directions(200)) + 1e-3 * rng.normal(size=(200, 3))
    points = np.concatenate([own @ SKEW.T + s.translation, near, [s.translation]])
    true = np.abs(closest_on(s, ControlBox.around(s), points).signed)
    found = s.taubin_distance(points)
    assert (found <= true + 1e-12).all()
    assert (found > 0.05 * true).all()
    assert np.abs(found - true)[400:600].max() < 1e-2 * 1e-3 * 10 / min(semi_axes)


def test_taubins_distance_is_bounded_where_p4_is_not():
    """In the middle of a long ellipsoid the gradient along its axis says 5, the surface is 1 away."""
    s = Superquadric(semi_axes=(1, 1, 5))
    middle = np.array([[0, 0, 1e-3], [0, 0, 0.5]])
    assert (s.first_order_distance(middle) > 4).all()
    assert (s.taubin_distance(middle) < 1).all() and (s.taubin_distance(middle) > 0.7).all()


def test_taubins_distance_of_a_sphere_in_closed_form(rng):
    """|r^2 - 1| = 2 r d + sqrt(3) d^2 for the radius 1, at the centre too."""
    r = np.array([0.0, 0.3, 1.0, 1.7])
    root = (np.sqrt(r**2 + np.sqrt(3) * np.abs(r**2 - 1)) - r) / np.sqrt(3)
    found = Superquadric().taubin_distance(np.outer(r, [0.36, -0.48, 0.8]))
    np.testing.assert_allclose(found, root, atol=1e-12)


@pytest.mark.parametrize("exponents", [(0.6, 1.3), (1.0, 1.0), (0.3, 0.5), (1.8, 0.9)])
def test_derivatives_of_taubins_function(exponents, rng):
    q, e, h = rng.uniform(0.2, 1.5, (30, 3)) * rng.choice([-1, 1], (30, 3)), np.array(exponents), 1e-5
    value, gradient, hessian = squared_implicit(q, e)
    np.testing.assert_allclose(value, Superquadric(exponents=exponents).implicit(q) ** 2 - 1, rtol=1e-10, atol=1e-12)
    for axis, step in enumerate(h * np.eye(3)):
        ahead, behind = squared_implicit(q + step, e), squared_implicit(q - step, e)
        np.testing.assert_allclose(gradient[:, axis], (ahead[0] - behind[0]) / (2 * h), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(hessian[:, :, axis], (ahead[1] - behind[1]) / (2 * h), rtol=1e-4, atol=1e-4)


def test_pinched_superquadrics_are_shapes():
    """A.1: exponents above 2; of 3 and 3 the astroidal ellipsoid, whose volume is 4 pi a b c / 35."""
    s = made(exponents=(3, 3))
    assert s.volume() == pytest.approx(4 * np.pi * 24 / 35, rel=1e-12)
    coarse, fine = s.mesh(40).volume(), s.mesh(80).volume()
    assert fine + (fine - coarse) / 3 == pytest.approx(s.volume(), rel=3e-3)
    local = (s.grid(8)[0] - s.translation) @ s.rotation / s.semi_axes
    np.testing.assert_allclose((np.abs(local) ** (2 / 3)).sum(axis=1), 1, rtol=1e-9)
    assert np.abs(made(exponents=(3, 3)).gradient(s.grid(8)[0])).max() < np.inf
    with pytest.raises(OptionError, match=r"fixed: exponents \[3.0, 3.0\]"):
        fit_superquadric(s.grid(8)[0], fixed={"exponents": (3, 3)})


KNOWN_VOLUMES = [
    ((2, 2, 2), (1, 1), 32 * np.pi / 3),
    ((3, 2, 4), (1, 1), 32 * np.pi),
    ((3, 2, 4), (2, 2), 4 / 3 * 24),  # octahedron
    ((3, 2, 4), (2, 1), 2 / 3 * np.pi * 24),  # double cone
    ((3, 2, 4), (1e-2, 1), 2 * np.pi * 24),  # nearly a cylinder
    ((3, 2, 4), (1e-2, 1e-2), 8 * 24),  # nearly a box
]


@pytest.mark.parametrize(("semi_axes", "exponents", "volume"), KNOWN_VOLUMES)
def test_known_volumes(semi_axes, exponents, volume):
    tolerance = 1e-12 if min(exponents) >= 1 else 1e-3
    assert made(semi_axes=semi_axes, exponents=exponents).volume() == pytest.approx(volume, rel=tolerance)


def test_torus_volume_and_area():
    torus = Superquadric("toroid", (1, 1, 1), hole_radius=2.5)
    assert torus.volume() == pytest.approx(2 * np.pi**2 * 2.5, rel=1e-12)
    assert torus.area() == pytest.approx(4 * np.pi**2 * 2.5, rel=1e-4)


@pytest.mark.parametrize("exponents", [(1.0, 1.0), (0.6, 1.4), (0.4, 0.4), (1.7, 0.8), (2.0, 2.0)])
@pytest.mark.parametrize("kind", ["ellipsoid", "toroid"])
def test_volume_is_the_meshs(kind, exponents):
    s = made(kind, exponents)
    coarse, fine = s.mesh(40).volume(), s.mesh(80).volume()
    assert fine + (fine - coarse) / 3 == pytest.approx(s.volume(), rel=2e-4)


def test_known_areas():
    prolate = made(semi_axes=(2, 2, 5), exponents=(1, 1))
    e = np.sqrt(1 - 4 / 25)
    assert prolate.area() == pytest.approx(2 * np.pi * 4 * (1 + 5 / (2 * e) * np.arcsin(e)), rel=1e-4)
    assert made(semi_axes=(2, 2, 2), exponents=(1, 1)).area() == pytest.approx(16 * np.pi, rel=1e-4)
    assert Superquadric(exponents=(2, 2)).area() == pytest.approx(4 * np.sqrt(3), rel=1e-9)


def test_hyperboloids_have_no_volume():
    with pytest.raises(OptionError, match="encloses no volume"):
        made("hyperboloid1").volume()


@pytest.mark.parametrize("kind", KINDS)
def test_placed_is_the_scaled_shifted_surface(kind):
    s = made(kind)
    offset = np.array([5.0, -1.0, 2.0])
    np.testing.assert_allclose(s.transformed(3.0, offset).grid(5)[0], 3 * s.grid(5)[0] + offset, rtol=1e-12, atol=1e-12)


BAD = [
    ({"kind": "elipsoid"}, "kind='elipsoid'.*expected one of"),
    ({"semi_axes": (1, 0, 1)}, "semi_axes.*above 0"),
    ({"semi_axes": (1, 1)}, "semi_axes.*shape"),
    ({"semi_axes": (1, np.nan, 1)}, "semi_axes.*finite"),
    ({"exponents": (0.001, 1)}, "exponents.*0.01"),
    ({"exponents": (1, 4.5)}, "exponents.*4.0"),
    ({"rotation": np.diag([1, 1, -1])}, "rotation.*orthogonal"),
    ({"rotation": 2 * np.eye(3)}, "rotation.*orthogonal"),
    ({"hole_radius": 2.0}, "hole_radius.*toroid alone"),
    ({"kind": "toroid"}, "hole_radius"),
    ({"kind": "toroid", "hole_radius": 1.0}, "hole_radius.*above 1"),
    ({"kind": "toroid", "hole_radius": 0.0}, "hole_radius.*above 1"),
    ({"kind": "toroid", "hole_radius": np.nan}, "hole_radius.*above 1"),
    ({"height": 2.0}, "height.*hyperboloids alone"),
    ({"kind": "hyperboloid1"}, "height"),
    ({"kind": "hyperboloid1", "height": 0.0}, "height"),
    ({"kind": "hyperboloid1", "height": np.inf}, "height"),
    ({"kind": "hyperboloid2", "height": 0.9}, "height.*above 1"),
]


@pytest.mark.parametrize(("fields", "message"), BAD)
def test_impossible_superquadrics_are_refused(fields, message):
    with pytest.raises(OptionError, match=message):
        Superquadric(**fields)


def test_bad_arguments_are_refused():
    with pytest.raises(PointsError, match=r"\(n, 3\)"):
        made().implicit(np.ones((4, 2)))
    with pytest.raises(OptionError, match=r"\(n, 2\)"):
        made("toroid").surface(np.ones((4, 3)))
    with pytest.raises(OptionError, match="angles"):
        made().natural([[np.nan, 0]])


def test_fields_are_copies_that_cannot_be_written():
    sizes = np.ones(3)
    s = Superquadric(semi_axes=sizes)
    sizes[0] = 9
    assert s.semi_axes[0] == 1
    with pytest.raises(ValueError, match="read-only"):
        s.semi_axes[0] = 2
