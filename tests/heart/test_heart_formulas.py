"""Sections, axes, segments, twist and strain against plain computations, triangle by triangle and point by point."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from shapes_made import SKEW, turned

from quadriform.errors import OptionError
from quadriform.heart import axis as axes
from quadriform.heart import heart_cycle, measure, twist, volumes
from quadriform.heart.aha_segments import AhaSegmentation
from quadriform.heart.axis import LongAxis
from quadriform.heart.wall import Wall
from quadriform.heart.wall_motion import ReferenceWall, green_strain, in_axes, local_axes, relative_lengthening
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

ENDO = Superquadric(semi_axes=(8.0, 9.0, 14.0), exponents=(0.9, 1.1), translation=(0.5, -0.3, 0.2))
EPI = Superquadric(semi_axes=(12.0, 13.0, 18.0), exponents=(1.0, 0.9))
AXIS = LongAxis(np.array([0.5, 0.2, -13.0]), np.array([-0.4, 0.3, 12.0]))


def deformed(seed=2, size=0.6):
    box = ControlBox.around(EPI, (3, 3, 3))
    return box.with_control_points(box.control_points + np.random.default_rng(seed).normal(0, size, (3, 3, 3, 3)))


def clipped_area(corners, heights):
    """The area of a triangle below height 0, by clipping its outline."""
    outline = []
    for k in range(3):
        a, b, low, high = corners[k], corners[k - 2], heights[k], heights[k - 2]
        if low <= 0:
            outline.append(a)
        if (low <= 0) != (high <= 0):
            outline.append(a + low / (low - high) * (b - a))
    return sum(np.linalg.norm(np.cross(p - outline[0], q - outline[0])) / 2 for p, q in pairwise(outline[1:]))


def test_the_part_of_a_triangle_below_a_plane_is_that_of_its_clipped_outline(rng):
    corners, heights = rng.normal(size=(60, 3, 3)), rng.normal(size=(60, 3))
    heights[:6] = [[0, 0, 0], [0, 1, 1], [0, -1, 1], [0, 0, 1], [0, 0, -1], [-1, 2, 0]]
    expected = []
    for triangle, height in zip(corners, heights):
        whole = np.linalg.norm(np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])) / 2
        expected.append(clipped_area(triangle, height) / whole)
    np.testing.assert_allclose(volumes._fraction_below(heights), expected, atol=1e-12)


def test_sections_run_from_where_outlines_rise_to_where_they_fall():
    mesh, plane = ENDO.mesh(4), BasePlane(np.array([0.1, 0.2, 3.0]), SKEW[:, 2])
    expected = []
    for face in mesh.faces:
        corners, heights = mesh.vertices[face], plane.heights(mesh.vertices[face])
        if (heights > 0).any() and (heights <= 0).any():
            ends = {}
            for k in range(3):
                a, b, low, high = corners[k], corners[k - 2], heights[k], heights[k - 2]
                if (low <= 0) != (high <= 0):
                    ends[low <= 0] = a + low / (low - high) * (b - a)
            expected.append([ends[True], ends[False]])
    np.testing.assert_allclose(volumes.section(mesh, plane), np.swapaxes(expected, 0, 1), atol=1e-12)


def test_volumes_are_extrapolated_from_two_meshes():
    model = DeformableModel({"endo": ENDO}, ControlBox.around(EPI))
    plane = BasePlane(np.array([0.0, 0, 4.0]), np.array([0, 0, 1.0]))
    coarse, fine = (volumes.volume_below(model.mesh("endo", n), plane) for n in (32, 64))
    assert volumes.volume(model, "endo", plane) == pytest.approx(fine + (fine - coarse) / 3, rel=1e-12)


def test_the_mean_contour_is_that_of_twelve_planes_through_the_axis():
    """Every fifteen degrees; of a body of revolution each is as long."""
    mesh = Superquadric(semi_axes=(3.0, 3.0, 5.0)).mesh(48)
    upright = LongAxis(np.array([0, 0, -5.0]), np.array([0, 0, 5.0]))
    turn = np.linspace(0, 2 * np.pi, 4001)
    outline = np.column_stack([3 * np.sin(turn), 5 * np.cos(turn)])
    steps = np.linalg.norm(np.diff(outline, axis=0), axis=1)
    assert measure.contour_length(mesh, upright, None) == pytest.approx(steps.sum(), rel=1e-3)
    base = BasePlane(np.array([0, 0, 2.0]), np.array([0, 0, 1.0]))
    below = steps[(outline[1:, 1] + outline[:-1, 1]) / 2 < 2].sum()
    assert measure.contour_length(mesh, upright, base) == pytest.approx(below, rel=2e-3)
    across = measure._directions(AXIS)
    assert across.shape == (12, 3)
    np.testing.assert_allclose(across @ AXIS.direction, 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), 1)
    np.testing.assert_allclose(np.diag(across @ across.T, 1), np.cos(np.pi / 12), rtol=1e-12)
    assert across[0] @ across[-1] == pytest.approx(np.cos(11 * np.pi / 12))
    handed = np.cross(across[:-1], across[1:]) @ AXIS.direction
    np.testing.assert_allclose(handed, np.sin(np.pi / 12), rtol=1e-9)


def test_segments_count_by_the_part_below_the_base():
    base = BasePlane(np.array([0, 0, 1.0]), np.array([0, 0, 1.0]))
    starts = np.array([[0, 0, 0], [0, 0, 2], [0, 0, 0], [0, 0, 3.0], [0, 0, 1], [0, 0, 0.5]], dtype=float)
    stops = np.array([[0, 0, 4], [5, 0, 2], [9, 0, 0.5], [0, 0, -1.0], [5, 0, 1], [7, 0, 0.5]], dtype=float)
    found = measure._fractions_below(np.stack([starts, stops]), base)
    np.testing.assert_allclose(found[[0, 1, 2, 3, 5]], [0.25, 0, 1, 0.5, 1])
    np.testing.assert_array_equal(measure._fractions_below(np.stack([starts, stops]), None), np.ones(6))


def test_positions_along_and_across_a_long_axis(rng):
    points = rng.normal(size=(9, 3)) * 10
    length = np.linalg.norm(AXIS.base - AXIS.apex)
    direction = (AXIS.base - AXIS.apex) / length
    assert AXIS.length == pytest.approx(length)
    np.testing.assert_allclose(AXIS.fractions(points), [(p - AXIS.apex) @ direction / length for p in points])
    np.testing.assert_allclose(AXIS.across(points), [p - (p @ direction) * direction for p in points])
    plane = AXIS.plane(0.25)
    np.testing.assert_allclose(plane.point, AXIS.apex + 0.25 * (AXIS.base - AXIS.apex))
    np.testing.assert_allclose(plane.direction, direction)


@pytest.mark.parametrize("widest", [1, -1])
def test_the_apex_is_at_the_narrower_end(widest):
    """A cavity that is wider at one end; of an even one the end is ambiguous."""
    model = DeformableModel({"endo": ENDO}, ControlBox.around(EPI, (3, 3, 3)))
    warnings = {}
    axes.cavity_ends(model, "endo", warnings)
    assert list(warnings) == ["APEX_AMBIGUOUS"]
    points = model.box.control_points.copy()
    points[:, :, 1 + widest, :2] *= 1.5
    warnings = {}
    ends = axes.cavity_ends(replace(model, box=model.box.with_control_points(points)), "endo", warnings)
    assert warnings == {}
    np.testing.assert_allclose(ends, ENDO.translation + np.array([[0, 0, -14.0], [0, 0, 14.0]]) * widest, atol=1e-9)


@pytest.mark.parametrize(("wider", "ambiguous"), [(1.02, True), (1.06, False)])
def test_ends_that_differ_by_less_than_a_twentieth_are_ambiguous(wider, ambiguous):
    model = DeformableModel({"endo": ENDO}, ControlBox.around(EPI, (3, 3, 2)))
    points = model.box.control_points.copy()
    points[:, :, 1, :2] *= wider
    model = replace(model, box=model.box.with_control_points(points))
    ends = ENDO.translation + np.array([[0, 0, -14.0], [0, 0, 14.0]])
    of, mesh = LongAxis(*model.deform(ends)), model.mesh("endo")
    low = volumes.volume_below(mesh, of.plane(0.25))
    high = mesh.volume() - volumes.volume_below(mesh, of.plane(0.75))
    assert (high - low < 0.05 * high) == ambiguous
    warnings = {}
    axes.cavity_ends(model, "endo", warnings)
    assert bool(warnings) == ambiguous


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_the_axis_of_a_base_begins_at_the_farthest_point_below_it(unit):
    box = deformed()
    box = ControlBox(unit * box.origin, unit * box.edges, unit * box.control_points)
    endo = replace(ENDO, semi_axes=unit * ENDO.semi_axes, translation=unit * ENDO.translation)
    model = DeformableModel({"endo": endo}, box)
    plane = BasePlane(np.array([0.0, 0, 6.0]) * unit, np.array([0.1, 0, 1.0]) / np.hypot(0.1, 1))
    mesh = model.mesh("endo", 48)
    found = axes.axis_to_base_plane(mesh, plane)
    centre = volumes.section_centre(mesh, plane)
    below = [p for p in mesh.vertices if (p - plane.point) @ plane.direction < 0]
    np.testing.assert_allclose(found.base, centre)
    np.testing.assert_allclose(found.apex, max(below, key=lambda p: np.linalg.norm(p - centre)))
    with pytest.raises(OptionError, match="does not meet the cavity"):
        axes.axis_to_base_plane(mesh, BasePlane(np.array([0, 0, 99.0]), np.array([0, 0, 1.0])))


@pytest.mark.parametrize("turn", range(3))
def test_segments_are_thirds_of_the_axis_and_sectors_from_the_septum(turn):
    frame = turned(turn)
    axis = LongAxis(frame @ [1.0, 2, 3], frame @ [1.0, 2, 3] + 9 * frame[:, 2])
    segments = AhaSegmentation(axis, frame[:, 0])
    # seen from the apex, that is along z, counter-clockwise is left-handed about z
    degrees = np.array([-119, -61, -59, -1, 1, 59, 61, 119, 121, 179, 181, 239])
    names = [1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6]
    quarters = np.array([-134, -46, -44, 44, 46, 134, 136, 224])

    def at(height, degree):
        angle = -np.radians(degree)
        return axis.apex + 9 * height * frame[:, 2] + frame[:, 0] * np.cos(angle) + frame[:, 1] * np.sin(angle)

    for height, first in ((0.67, 0), (0.99, 0), (0.34, 6), (0.66, 6)):
        found = segments.numbers(np.array([at(height, degree) for degree in degrees]))
        assert found.tolist() == [first + name for name in names]
    for height in (0.01, 0.33):
        found = segments.numbers(np.array([at(height, degree) for degree in quarters]))
        assert found.tolist() == [13, 13, 14, 14, 15, 15, 16, 16]
    beyond = segments.numbers(np.array([at(-0.01, 0), at(1.01, 0)]))
    assert beyond.tolist() == [17, 0]
    angles = segments.angles(np.array([at(0.5, degree) for degree in degrees]))
    np.testing.assert_allclose(np.cos(angles - np.radians(degrees)), 1, rtol=1e-12)
    np.testing.assert_allclose(np.sin(angles - np.radians(degrees)), 0, atol=1e-9)


def test_the_septum_halves_the_angle_between_groups_of_insertions():
    axis = LongAxis(np.zeros(3), np.array([0, 0, 10.0]))
    degrees = np.array([40.0, 42, 44, -50])  # three of one group, whose mean direction is at 42
    points = np.column_stack([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), [1, 2, 3, 4.0]])
    found = AhaSegmentation.anchored(axis, points).septum
    np.testing.assert_allclose(np.degrees(np.arctan2(found[1], found[0])), -4, atol=1e-9)
    for shift, message in ((0, "all on one side"), (178, None)):
        pair = np.array([[1.0, 0, 1], [np.cos(np.radians(shift)), np.sin(np.radians(shift)), 2]])
        if message:
            with pytest.raises(OptionError, match=message):
                AhaSegmentation.anchored(axis, pair)
    for half, around in ((87.0, False), (87.3, True)):  # a mean direction of 0.05
        pair = np.array([[np.cos(np.radians(s * half)), np.sin(np.radians(s * half)), 1.0] for s in (1, -1)])
        if around:
            with pytest.raises(OptionError, match="all around"):
                AhaSegmentation.anchored(axis, pair)
        else:
            np.testing.assert_allclose(AhaSegmentation.anchored(axis, pair).septum, [1, 0, 0], atol=1e-9)


def test_twist_is_the_difference_of_rotations_in_four_definitions():
    found = twist.Twist(0.3, 0.1, 20.0, np.array([10.0, 14.0]))
    assert found.angle == pytest.approx(np.degrees(0.2))
    assert found.angle_per_length == pytest.approx(np.degrees(0.2) / 20)
    assert found.shear_angle == pytest.approx(np.degrees(0.2) * 12 / 20)


def test_edges_are_cut_where_heights_change_sign(rng):
    origins, heights = rng.normal(size=(6, 3)), np.array([1.0, -1, 0, 2, -3, 0])
    edges = np.array([[0, 1], [0, 3], [1, 4], [2, 3], [3, 2], [2, 5], [4, 3]])
    found = twist._crossings(origins, heights, edges)
    expected = [(origins[0] + origins[1]) / 2, origins[2], origins[2], origins[4] + 0.6 * (origins[3] - origins[4])]
    np.testing.assert_allclose(found, expected)


def test_the_angle_between_turned_vectors_and_the_shortest_rotation(rng):
    for angle in (-3.0, -0.4, 0.0, 1.2):
        frame = turned(1)
        plane = rng.normal(size=(9, 2))
        spin = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        before, after = (rows @ frame[:, :2].T for rows in (plane, 2 * plane @ spin.T))
        assert twist._angle_between(before, after, frame[:, 2]) == pytest.approx(angle)
    one, other = frame[:, 0], SKEW[:, 1]
    rotation = twist._shortest_rotation(one, other)
    np.testing.assert_allclose(rotation @ one, other, atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    normal = np.cross(one, other)
    np.testing.assert_allclose(rotation @ normal, normal, atol=1e-12)


def test_slices_turn_as_the_tissue_does_whatever_the_heart_does_as_a_whole():
    """A rotation about the axis that grows with height, then a motion of the whole heart."""
    upright = LongAxis(np.array([0, 0, -14.0]), np.array([0, 0, 14.0]))
    wall, box = Wall.between(ENDO, EPI, 8), ControlBox.around(EPI, (2, 2, 2))
    slices = twist.Slices.cut(wall, box, upright)
    for level, origins in zip((0.25, 0.75), slices.origins):
        np.testing.assert_allclose(upright.fractions(origins), level, atol=1e-12)
    x, y, z = np.moveaxis(box.control_points, -1, 0)
    sheared = box.with_control_points(np.stack([x - 0.01 * z * y, y + 0.01 * z * x, z], axis=-1))
    whole = turned(2)
    moved = sheared.with_control_points(sheared.control_points @ whole.T + [5, 6, 7])
    for frame in (sheared, moved):
        found = slices.twist(frame)
        # counter-clockwise seen from the apex: left-handed about the axis; a rotation of the whole counts in both
        assert found.angle == pytest.approx(2 * np.degrees(np.arctan(0.07)), rel=1e-6)
        assert found.apical == pytest.approx(np.arctan(0.07), rel=1e-6) or frame is moved
        assert found.distance == pytest.approx(14)
        radii = [np.linalg.norm((o - o.mean(axis=0))[:, :2], axis=1).mean() for o in slices.origins]
        np.testing.assert_allclose(found.radii, radii, rtol=1e-9)


def test_strain_and_lengthening_are_those_of_stretched_lines(rng):
    gradient = np.eye(3) + 0.2 * rng.normal(size=(5, 3, 3))
    strain = green_strain(gradient)
    for f, e in zip(gradient, strain):
        np.testing.assert_allclose(e, (f.T @ f - np.eye(3)) / 2)
    turns = np.stack([turned(k) for k in range(5)])
    along = in_axes(strain, turns)
    for f, axes_, e in zip(gradient, turns, along):
        for i, j in ((0, 0), (0, 1), (2, 1)):
            assert e[i, j] == pytest.approx(axes_[i] @ (f.T @ f - np.eye(3)) @ axes_[j] / 2)
        lengthening = [np.linalg.norm(f @ axis) - 1 for axis in axes_]
        np.testing.assert_allclose(relative_lengthening(e), lengthening, rtol=1e-9)


def reference_wall(plane=None, resolution=6):
    return ReferenceWall.at(Wall.between(ENDO, EPI, resolution), deformed(), AXIS, plane)


def test_a_reference_wall_has_the_points_axes_and_volumes_of_its_lines():
    of, nodes = reference_wall(), (np.polynomial.legendre.leggauss(4)[0] + 1) / 2
    for k, depth in enumerate(nodes):
        np.testing.assert_allclose(of.origins[:, k], of.wall.at(depth))
        found = local_axes(of.box, of.wall.at(depth), of.wall.normals_at(depth), AXIS.direction)
        np.testing.assert_array_equal(of.axes[:, k], found)
        jacobian = of.box.jacobian(of.wall.at(depth))
        radial = np.einsum("nji,nj->ni", np.linalg.inv(jacobian), of.wall.normals_at(depth))
        np.testing.assert_allclose(found[:, 0], radial / np.linalg.norm(radial, axis=1, keepdims=True), atol=1e-9)
        around = np.cross(AXIS.direction, found[:, 0])
        np.testing.assert_allclose(found[:, 1], around / np.linalg.norm(around, axis=1, keepdims=True), atol=1e-9)
        np.testing.assert_allclose(found[:, 2], np.cross(found[:, 0], found[:, 1]), atol=1e-9)
    np.testing.assert_allclose(of.areas, of.volumes.sum(axis=1) / of.thickness)
    assert (of.volumes > 0).all()


def test_cells_count_by_the_part_of_their_width_below_a_plane():
    of, weights = reference_wall(), np.polynomial.legendre.leggauss(4)[1] / 2
    plane = AXIS.plane(0.7)
    expected = np.zeros_like(of.volumes)
    for i in range(len(of.volumes)):
        for k in range(4):
            width = np.sqrt(of.volumes[i, k] / (weights[k] * of.thickness[i]))
            height = (of.box.deform(of.origins[i, k][None])[0] - plane.point) @ plane.direction
            expected[i, k] = np.clip(0.5 - height / width, 0, 1)
    np.testing.assert_allclose(of.fraction_below(plane), expected, atol=1e-9)
    assert ((expected > 0) & (expected < 1)).any()
    np.testing.assert_allclose(reference_wall(plane).volumes, of.volumes * expected)
    levels = of.fraction_below(AXIS.plane(0.75)) - of.fraction_below(AXIS.plane(0.25))
    np.testing.assert_allclose(of.between_slices(), levels)


def test_means_are_over_the_volume_at_end_diastole(rng):
    of = reference_wall()
    values, parts = rng.normal(size=(*of.volumes.shape, 3)), rng.uniform(0, 1, of.volumes.shape)
    weights = of.volumes * parts
    expected = sum(w * v for w, v in zip(weights.ravel(), values.reshape(-1, 3))) / weights.sum()
    np.testing.assert_allclose(of.mean(values, parts), expected)
    one = np.arange(len(of.volumes))[:, None] < 5
    np.testing.assert_allclose(of.mean(values, one), of.mean(values, np.broadcast_to(one, of.volumes.shape)))


def test_lines_of_a_wall_and_their_lengths_and_volumes():
    wall, box = Wall.between(ENDO, EPI, 4), deformed()
    nodes, weights = np.polynomial.legendre.leggauss(4)
    inner, outer = (wall.centre + s[:, None] * wall.rays for s in (wall.start, wall.stop))
    np.testing.assert_allclose(ENDO.implicit(inner), 1, rtol=1e-9)
    np.testing.assert_allclose(EPI.implicit(outer), 1, rtol=1e-9)
    np.testing.assert_allclose(wall.at(0.3), inner + 0.3 * (outer - inner))
    mixed = 0.7 * wall.normals[0] + 0.3 * wall.normals[1]
    np.testing.assert_allclose(wall.normals_at(0.3), mixed / np.linalg.norm(mixed, axis=1, keepdims=True))
    steps = np.linspace(0, 1, 401)
    lines = np.stack([box.deform(wall.at(depth)) for depth in steps])
    lengths = np.linalg.norm(np.diff(lines, axis=0), axis=2).sum(axis=0)
    np.testing.assert_allclose(wall.thickness(box), lengths, rtol=1e-4)
    span = wall.stop - wall.start
    for k in range(4):
        depth = (nodes[k] + 1) / 2
        determinant = np.linalg.det(box.jacobian(wall.at(depth)))
        expected = wall.cells * (wall.start + depth * span) ** 2 * span * weights[k] / 2 * determinant
        np.testing.assert_allclose(wall.volumes(box)[:, k], expected, rtol=1e-9)
    crossing = np.arange(len(span)) % 3 == 0
    without = np.where(crossing[:, None], 0, wall.volumes(box))
    np.testing.assert_array_equal(replace(wall, crossing=crossing).volumes(box), without)
    assert wall.cells.sum() == pytest.approx(4 * np.pi * 8 * 9 * 14)


@pytest.mark.parametrize("field", ["semi_axes", "translation", "exponents", "rotation"])
def test_frames_have_the_same_undeformed_space_up_to_rounding(field):
    box = ControlBox.around(EPI)
    size = np.linalg.norm(box.edges)
    scale = size if field in ("semi_axes", "translation") else 1.0
    one = DeformableModel({"endo": ENDO}, box)
    for factor, same in ((0.98, True), (1.02, False)):
        step = factor * heart_cycle.SAME * scale
        value = np.array(getattr(ENDO, field), dtype=float)
        spin = np.array([[1, -step, 0], [step, 1, 0], [0, 0, 1]])
        value = value @ spin if field == "rotation" else value + step
        other = DeformableModel({"endo": replace(ENDO, **{field: value})}, box)
        assert heart_cycle._same_undeformed(one, other) == same
    shifted = replace(box, origin=box.origin + 1.1 * heart_cycle.SAME * size)
    assert not heart_cycle._same_undeformed(one, DeformableModel({"endo": ENDO}, shifted))


def test_end_systole_is_the_smallest_volume():
    found = measure._ed_and_es(np.array([3.0, 9, 1, 5]), None)
    assert found == (1, 2) and measure._ed_and_es(np.array([3.0, 9, 1, 5]), 0) == (0, 2)
    assert measure._ed_and_es(np.array([3.0]), None) == (0, None)
    for wrong in (-1, 4):
        with pytest.raises(OptionError, match=r"no such frame; expected 0 to 3"):
            measure._ed_and_es(np.array([3.0, 9, 1, 5]), wrong)
    with pytest.raises(OptionError, match="smallest volume"):
        measure._ed_and_es(np.array([3.0, 9, 1, 5]), 2)


def test_a_section_has_its_centre_of_area():
    """A prism over an L: two rectangles."""
    outline = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3.0]])
    n = len(outline)
    low, high = (np.column_stack([outline, np.full(n, z)]) for z in (0.0, 5.0))
    sides = [[k, (k + 1) % n, n + k] for k in range(n)] + [[(k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]
    prism = Mesh(np.concatenate([low, high]) @ SKEW.T, np.array(sides))
    plane = BasePlane(SKEW @ [7.0, 8.0, 2.0], SKEW[:, 2])
    expected = (4 * np.array([2, 0.5]) + 2 * np.array([0.5, 2])) / 6
    np.testing.assert_allclose(SKEW.T @ volumes.section_centre(prism, plane), [*expected, 2], rtol=1e-9)


def test_function_is_that_of_both_volumes():
    rows = measure._ejection_rows(np.array([120.0, 45.0]), "how", ", closed")
    found = [tuple(vars(row).values())[:3] for row in rows]
    expected = [("end-systolic volume", 45, "ml"), ("stroke volume", 75, "ml"), ("ejection fraction", 62.5, "%")]
    assert found == [(f"{name}, closed", value, unit) for name, value, unit in expected]


def test_the_twist_is_measured_where_the_sides_of_the_cells_cross_its_levels():
    endo, epi = Superquadric(semi_axes=(8.0, 9.0, 14.0)), Superquadric(semi_axes=(12.0, 13.0, 18.0))
    wall, box = Wall.between(endo, epi, 4), ControlBox.around(epi, (3, 3, 3))
    axis = LongAxis(np.array([0.3, 0.2, -13.0]), np.array([-0.4, 0.1, 12.0]))
    points, heights = wall.at(twist.DEPTH), axis.fractions(wall.at(twist.DEPTH))
    for level, found in zip(twist.LEVELS, twist.Slices.cut(wall, box, axis).origins):
        expected = []
        for quad in wall.quads:
            for a, b in zip(quad, np.roll(quad, -1)):
                if (heights[a] > level) != (heights[b] > level):
                    part = (level - heights[a]) / (heights[b] - heights[a])
                    expected.append(points[a] + part * (points[b] - points[a]))
        assert len(found) == len(expected) > 10
        order = [np.lexsort(np.round(rows, 6).T) for rows in (found, np.array(expected))]
        np.testing.assert_allclose(found[order[0]], np.array(expected)[order[1]], atol=1e-9)
