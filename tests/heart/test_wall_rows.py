"""The measures of the wall against sums over its lines: thickness, thickening, strain, twist, and curves over time."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from shapes_made import SKEW

from quadriform.heart import wall_rows
from quadriform.heart.axis import LongAxis
from quadriform.heart.wall import WEIGHTS, Wall
from quadriform.heart.wall_motion import ReferenceWall, relative_lengthening
from quadriform.heart.wall_rows import Contraction
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.superquadric import Superquadric

ENDO = Superquadric(semi_axes=(8.0, 9.0, 14.0), translation=(0.5, -0.3, 0.2))
EPI = Superquadric(semi_axes=(12.0, 13.0, 18.0))
AXIS = LongAxis(np.array([0.5, 0.2, -13.0]), np.array([-0.4, 0.3, 12.0]))
REST = ControlBox.around(EPI, (3, 3, 3))


def box(seed, size=0.5):
    moves = np.random.default_rng(seed).normal(0, size, REST.control_points.shape)
    return REST.with_control_points(REST.control_points + moves)


@pytest.fixture(scope="module")
def reference():
    return ReferenceWall.at(Wall.between(ENDO, EPI, 6), box(1), AXIS, None)


FRAMES = SimpleNamespace(millimetres=10.0, models=[SimpleNamespace(box=box(k)) for k in (1, 2)])


def values(rows):
    return {row.quantity: row.value for row in rows}


@pytest.mark.parametrize("every", [True, False])
def test_rows_of_a_part_are_means_over_its_area_and_volume(reference, every):
    later = box(2)
    strain, thickness = reference.strain(later), reference.wall.thickness(later)
    lines = np.ones(len(thickness), dtype=bool) if every else np.arange(len(thickness)) % 3 == 0
    rows = wall_rows._part_rows(FRAMES, reference, Contraction(thickness, strain), "part ", lines, True)
    found, areas = values(rows), reference.areas[lines]
    before = sum(areas * reference.thickness[lines]) / sum(areas) * 10
    after = sum(areas * thickness[lines]) / sum(areas) * 10
    assert found["part wall thickness, end diastole"] == pytest.approx(before)
    assert found["part wall thickness, end systole"] == pytest.approx(after)
    assert found["part wall thickening"] == pytest.approx(100 * (after - before) / before)
    ratios = thickness[lines] / reference.thickness[lines] - 1
    assert found["part radial strain"] == pytest.approx(100 * sum(areas * ratios) / sum(areas))
    weights = reference.volumes[lines].ravel()
    around = relative_lengthening(strain[lines]).reshape(-1, 3)[:, 1]
    assert found["part circumferential strain"] == pytest.approx(100 * (weights @ around) / weights.sum())
    for k, name in enumerate(("radial", "circumferential", "longitudinal")):
        green = weights @ strain[lines][..., k, k].ravel() / weights.sum()
        assert found[f"part Green strain, {name}"] == pytest.approx(green)
    assert all(row.observed for row in rows)
    alone = wall_rows._part_rows(FRAMES, reference, None, "", lines, True)
    assert values(alone) == {"wall thickness, end diastole": pytest.approx(before)}
    prior = wall_rows._part_rows(FRAMES, reference, Contraction(thickness, strain), "", lines, False)
    assert [row.observed for row in prior] == [True] * 4 + [False] * 4
    assert all(row.how.startswith("not observed") == (not row.observed) for row in prior)


def test_where_surfaces_cross_there_is_no_radial_strain(reference):
    crossing = np.arange(len(reference.thickness)) % 2 == 0
    wall = SimpleNamespace(crossing=crossing)
    of = SimpleNamespace(wall=wall, thickness=np.where(crossing, 0.0, 2.0))
    found = wall_rows._radial(of, np.full(len(crossing), 3.0))
    np.testing.assert_array_equal(found, np.where(crossing, 0.0, 0.5))


def test_twist_is_stated_in_degrees_and_millimetres(reference):
    later, strain = box(2), reference.strain(box(2))
    twist = reference.slices.twist(later)
    found = values(wall_rows._twist_rows(FRAMES, reference, later, strain, True))
    assert found["twist angle"] == pytest.approx(twist.angle)
    assert found["twist per length"] == pytest.approx(twist.angle / twist.distance / 10)
    assert found["torsional shear angle"] == pytest.approx(twist.shear_angle)
    weights = reference.volumes * reference.between_slices()
    shear = (weights * strain[..., 1, 2]).sum() / weights.sum()
    assert found["torsional shear strain"] == pytest.approx(shear)


def test_curves_are_those_of_every_frame(reference):
    found = wall_rows.wall_curves(FRAMES, reference)
    for k, model in enumerate(FRAMES.models):
        thickness = reference.wall.thickness(model.box)
        weights, volumes = reference.areas / reference.areas.sum(), reference.volumes / reference.volumes.sum()
        assert found["wall thickness"][k] == pytest.approx(10 * weights @ thickness)
        assert found["radial strain"][k] == pytest.approx(
            100 * weights @ (thickness / reference.thickness - 1), abs=1e-9
        )
        around = relative_lengthening(reference.strain(model.box))[..., 1]
        assert found["circumferential strain"][k] == pytest.approx(100 * (volumes * around).sum(), abs=1e-9)
        assert found["twist angle"][k] == pytest.approx(reference.slices.twist(model.box).angle, abs=1e-9)


def test_segments_without_wall_are_left_out(reference):
    warnings, frames = {}, SimpleNamespace(models=[SimpleNamespace(surfaces={"endo": ENDO})])
    every = wall_rows._segments(frames, reference, 0, None, warnings)
    assert list(warnings) == ["UNANCHORED"] and all(name.startswith("unanchored segment ") for name in every)
    numbers = sum(mask.astype(int) for mask in every.values())
    assert set(numbers) <= {0, 1} and len(every) == 17
    inserts = AXIS.apex + 0.5 * (AXIS.base - AXIS.apex) + 10 * np.array([[1, 0.5, 0], [1, -0.5, 0.0]]) @ SKEW.T
    lost = ReferenceWall(
        reference.wall,
        reference.box,
        reference.axis,
        reference.origins,
        reference.axes,
        reference.thickness,
        reference.volumes * (numbers > 0)[:, None] * (np.arange(len(numbers)) > 40)[:, None],
        reference.slices,
    )
    found = wall_rows._segments(frames, lost, 0, inserts, {})
    assert all(name.startswith("segment ") for name in found)
    assert not any(mask[:41].any() for mask in found.values())


@pytest.mark.parametrize("crosses", [False, True])
def test_a_cell_that_the_base_cuts_counts_by_how_much_of_it_lies_below(reference, crosses):
    """Its width is the square root of its volume over its depth: that of the line, of a crossing one of length one."""
    crossing = np.full(len(reference.thickness), crosses)
    of = replace(reference, wall=replace(reference.wall, crossing=crossing))
    plane = BasePlane(np.array([0.0, 0, 2.0]), np.array([0.0, 0.6, 0.8]))
    heights = (reference.box.deform(reference.origins.reshape(-1, 3)) - plane.point) @ plane.direction
    depths = WEIGHTS * (1.0 if crosses else reference.thickness[:, None])
    below = 0.5 - heights.reshape(reference.volumes.shape) / np.sqrt(reference.volumes / depths)
    expected = np.minimum(np.maximum(below, 0), 1)
    assert ((expected > 0) & (expected < 1)).sum() > 20
    np.testing.assert_allclose(of.fraction_below(plane), expected, rtol=1e-12)
