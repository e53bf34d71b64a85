"""Maps without folds that have given surfaces: folds of the space inside go, and the surfaces stay."""

import numpy as np
import pytest

from quadriform.fitting.population.given_surfaces import GivenSurface, GivenSurfaces, State
from quadriform.fitting.refinement.unfolding import certified
from quadriform.shapes.closest import closest_on
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

BODY = Superquadric("ellipsoid", (1.0, 0.8, 1.2))
DEVIATION = 0.02


def box_with(displacements):
    """A smooth deformation, and displacements of some control points by their indices besides."""
    box = ControlBox.around(BODY)
    control = box.rest + 0.1 * np.sin(2 * box.rest[..., [1, 2, 0]])
    for index, displacement in displacements.items():
        control[index] += displacement
    return box.with_control_points(control)


def without_folds(box, deviations=None):
    origins = BODY.grid(8)[0]
    given = GivenSurface(
        BODY, box.deform(origins), np.full(len(origins), DEVIATION) if deviations is None else deviations
    )
    return GivenSurfaces.of([given], (5, 5, 5)).without_folds(State(box, (origins,)))


def distances(box, found):
    """Of the surface of one box to that of another (n,)."""
    points = box.deform(BODY.grid(8)[0])
    return np.linalg.norm(found.deform(closest_on(BODY, found, points).origins) - points, axis=1)


@pytest.mark.parametrize("size", (8.0, 12.0))
def test_a_fold_inside_goes_and_the_surface_stays(size):
    box = box_with({(1, 2, 2): (size, 0, 0), (3, 2, 2): (-size, 0, 0)})
    assert not certified(box, {"body": BODY})
    found = without_folds(box)
    assert found is not None and certified(found, {"body": BODY})
    assert np.sqrt((distances(box, found) ** 2).mean()) < 0.5 * DEVIATION


def test_a_map_without_folds_keeps_its_surface():
    box = box_with({})
    assert np.abs(distances(box, without_folds(box))).max() < 0.1 * DEVIATION


def test_a_surface_gives_way_where_it_is_known_least():
    """A dent that turns inside out, in a part that is hardly known: the other parts stay where they were."""
    box = box_with({(2, 2, 4): (0, 0, -6.0)})
    origins = BODY.grid(8)[0]
    above = origins[:, 2] > 0.5
    found = without_folds(box, np.where(above, 1.0, DEVIATION))
    assert not certified(box, {"body": BODY}) and certified(found, {"body": BODY})
    assert np.sqrt((distances(box, found)[origins[:, 2] < 0] ** 2).mean()) < 0.5 * DEVIATION
