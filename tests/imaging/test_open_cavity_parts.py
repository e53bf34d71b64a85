"""Background inside the convex hull of an open wall: what touches the cavity belongs to it, the rest to the wall."""

import numpy as np

from quadriform.imaging.open_cavity import _fill_pockets
from quadriform.imaging.voxel_faces import BACKGROUND, CAVITY, WALL


def test_pockets_at_the_cavity_are_cavity_and_others_wall():
    """Along a line: a pocket first, wall, cavity, a pocket beside it, and one that leaves the hull."""
    b, w, c = BACKGROUND, WALL, CAVITY
    tissue = np.array([b, w, c, c, b, w, b, b, w], dtype=np.int8)[:, None, None]
    hull = np.array([1, 1, 1, 1, 1, 1, 1, 0, 1], dtype=bool)[:, None, None]
    _fill_pockets(tissue, hull)
    assert tissue.ravel().tolist() == [w, w, c, c, c, w, b, b, w]
