"""The arithmetic of the benchmark of intervals; none of its data is needed here."""

import importlib
from pathlib import Path

import numpy as np
import pytest

import quadriform as qf
from quadriform.shapes.landmarks import BasePlane, plane_through
from quadriform.shapes.mesh import richardson

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
BALL = qf.Superquadric(semi_axes=(30.0, 30.0, 30.0))


@pytest.fixture
def intervals(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("intervals")


@pytest.mark.parametrize("height", [0.0, 12.0])
def test_a_mesh_with_halved_edges_has_three_quarters_of_what_flat_triangles_lack(intervals, height):
    mesh, plane = BALL.mesh(12), BasePlane(np.array([0.0, 0, height]), np.array([0.0, 0, 1]))
    exact = np.pi * (30 + height) ** 2 * (60 - height) / 3
    below = intervals.volume_below(mesh, plane), intervals.volume_below(intervals.halved_edges(*mesh_of(mesh)), plane)
    assert richardson(*below) == pytest.approx(exact, rel=1e-3)
    lacking = exact - below[0]
    assert exact - below[1] == pytest.approx(lacking / 4, rel=0.2)
    assert intervals.true_volume(*mesh_of(mesh), plane) == pytest.approx(
        (below[0] + lacking / 3) / 1000, abs=2e-5 * lacking
    )


def test_points_on_edges_are_a_third_of_the_way_from_triangles_to_the_surface(intervals):
    """The reason for the volume of `true_volume`: radii, for the means of a ball."""
    mesh = BALL.mesh(12)
    radii = np.linalg.norm(intervals.points_on_edges(*mesh_of(mesh)), axis=1)
    inside = 30 - (mesh.volume() / (4 / 3 * np.pi)) ** (1 / 3)
    assert 30 - radii.mean() == pytest.approx(inside * 2 / 3, rel=0.15)


def test_a_plane_is_that_of_its_points(intervals):
    plane = BasePlane(np.array([1.0, 2, 3]), np.array([2.0, -1, 2]) / 3)
    found = plane_through(intervals.on_plane(plane), plane.point - plane.direction)
    np.testing.assert_allclose(found.direction, plane.direction, atol=1e-12)
    assert abs((found.point - plane.point) @ plane.direction) < 1e-12


def test_a_line_of_the_table_has_the_share_that_is_covered(intervals):
    of = intervals.QUANTITIES[0]
    every = [intervals.Error(500, of, 1.0, 2.0, True), intervals.Error(550, of, -3.0, 1.0, False)]
    others = [intervals.Error(500, each, 0.0, 1.0, True) for each in intervals.QUANTITIES[1:]]
    line = next(intervals.lines("aligned", every + others))
    assert line == ("aligned", of, "2", "-1.00", "2.00", "1.58", "-1.25", "1.75", "50")


def mesh_of(mesh):
    return mesh.vertices, mesh.faces
