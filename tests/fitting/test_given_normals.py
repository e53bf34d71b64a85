"""Normals that were given say which way points face, where those of their neighbours would have to be guessed."""

import numpy as np
import pytest
from shapes_made import even_directions, lumpy

import quadriform as qf
from quadriform.errors import OptionError, PointsError
from quadriform.fitting.cloud import Distinct
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.shapes.superquadric import Superquadric

SPHERE = even_directions(200)


def facing(points, normals):
    return SurfaceData.of(Superquadric(), points, np.ones(len(points)), None, normals).oriented()


@pytest.mark.parametrize("sign", [1, -1])
def test_given_normals_are_used_as_they_are(sign):
    tilted = SPHERE + 0.2 * np.roll(SPHERE, 1, axis=1)
    tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
    found = facing(SPHERE, sign * tilted)
    np.testing.assert_array_equal(found.normals, tilted)
    np.testing.assert_array_equal(found.flatness, 1)


def test_arbitrary_signs_are_found():
    signs = np.random.default_rng(1).choice([-1.0, 1.0], (200, 1))
    np.testing.assert_array_equal(facing(SPHERE, signs * SPHERE).normals, SPHERE)


def test_signs_that_agree_are_kept_where_neighbours_would_mislead():
    """Two sheets so near that a point's neighbours lie on both: only the given normals tell one from the other."""
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 12), np.linspace(-1, 1, 12)), -1).reshape(-1, 2)
    points = np.vstack([np.c_[grid, np.full(144, 0.02)], np.c_[grid + 0.05, np.full(144, -0.02)]])
    normals = np.repeat([[0.0, 0, 1], [0, 0, -1]], 144, axis=0)
    tree_would = facing(points, None).normals[:, 2]
    assert (np.sign(tree_would) != normals[:, 2]).any()
    np.testing.assert_array_equal(np.sign(facing(points, normals).normals[:, 2]), normals[:, 2])


def test_a_point_without_a_normal_takes_that_of_its_neighbours():
    given = SPHERE.copy()
    given[:50] = 0
    found = facing(SPHERE, given)
    assert (np.einsum("ij,ij->i", found.normals, SPHERE) > 0.9).all()
    np.testing.assert_array_equal(found.flatness[50:], 1)


def test_normals_follow_their_points_through_copies_and_weights():
    points = np.vstack([SPHERE, SPHERE[:20]])
    distinct = Distinct.of(points, np.r_[np.zeros(5), np.ones(215)])
    np.testing.assert_array_equal(distinct.of_distinct(points), distinct.points)


def test_normals_come_with_columns_by_name_or_beside(tmp_path):
    cloud, options = lumpy(80), {"box": (2, 2, 2)}
    beside = qf.fit({"a": cloud}, normals={"a": cloud}, **options)
    for found in (
        qf.fit({"a": np.hstack([cloud, cloud])}, columns="x,y,z,nx,ny,nz", **options),
        qf.fit({"a": cloud}, normals=[cloud.tolist()][0], **options),
    ):
        np.testing.assert_array_equal(found.model.box.control_points, beside.model.box.control_points)


@pytest.mark.parametrize(
    ("normals", "error", "message"),
    [
        (SPHERE[:-1], PointsError, "normals: expected one for each of 200 points, found 199"),
        (np.full((200, 3), np.nan), PointsError, "normals: 200 of 200 rows are not finite"),
        (SPHERE[:, :2], PointsError, "normals: expected an array of shape"),
        ({"other": SPHERE}, OptionError, "must have the same names"),
    ],
)
def test_normals_that_cannot_be_are_refused(normals, error, message):
    with pytest.raises(error, match=message):
        qf.fit(SPHERE, normals=normals)
