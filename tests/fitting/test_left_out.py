"""Patches that are left out: together they are all of the data, and each is predicted by the others."""

import numpy as np
import pytest
from shapes_made import lumpy

from quadriform.fitting.refinement.left_out import _equations, _patch_of
from quadriform.fitting.refinement.point_to_plane import data_rows
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.points import Frame
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

CLOUD = Frame.of(lumpy(400)).to_local(lumpy(400))


def test_squares_of_the_patches_are_the_distances_to_the_moved_surface(rng):
    """Each with the weights of its points; together those of all points."""
    ball = Superquadric()
    box = ControlBox.around(ball, (3, 4, 3))
    data = SurfaceData.of(ball, CLOUD, rng.uniform(0.5, 2, 400), None).with_nearest_foot_points(box)
    parts, rows, patch = _equations(data, box, 6), data_rows(data, box), _patch_of(CLOUD, 6)
    moves = rng.normal(0, 0.1, box.rest.shape)
    moved = box.with_control_points(box.rest + moves).deform(rows.origins)
    off = rows.targets - moved
    squares = np.einsum("ni,nij,nj->n", off, rows.metric, off)
    for number, (equations, weight) in enumerate(parts):
        assert equations.squares(moves.reshape(-1, 3)) == pytest.approx(squares[patch == number].sum(), rel=1e-9)
        assert weight == pytest.approx(data.effective_weights[patch == number].sum())
