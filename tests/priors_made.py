"""Populations whose mean, modes and variances are known: ellipsoids with axes that vary independently."""

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

AXES = np.array([30.0, 22.0, 44.0])
SIGMAS = np.array([3.0, 1.0, 5.0])
SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))
"""Of eight members: their sample covariance is 8 / 7 times the identity."""
SPHERE = Superquadric("ellipsoid", (1, 1, 1)).mesh(8)
SQUARES = (SPHERE.vertices**2).mean(axis=0)
"""Mean square distance by which vertices move when one axis grows by 1."""
VARIANCES = 8 / 7 * SIGMAS**2 * SQUARES


def semi_axes():
    return AXES + SIGNS * SIGMAS


def meshes(size=1.0):
    return [Mesh(size * each * SPHERE.vertices, SPHERE.faces) for each in semi_axes()]


def bent(size=1.0):
    """Eight smooth shapes, each bent in a direction of its own: more modes than the axes have."""
    directions = np.random.default_rng(1).normal(size=(8, 3))
    return [
        Mesh(m.vertices + size * d * np.sin(m.vertices / size / 9), m.faces) for m, d in zip(meshes(size), directions)
    ]


def wall(mesh):
    """Two surfaces of one shape, the outer one larger by a fifth."""
    return {"endo": mesh, "epi": Mesh(1.2 * mesh.vertices, mesh.faces)}


def models(space="LPS", unit="mm"):
    surfaces = [Superquadric("ellipsoid", each) for each in semi_axes()]
    return [DeformableModel({"surface": one}, ControlBox.around(one), space, unit) for one in surfaces]


def poses(count, seed=3):
    """Random rotations (count, 3, 3) and shifts (count, 3)."""
    shifts = 100 * np.random.default_rng(seed).normal(size=(count, 3))
    return Rotation.random(count, random_state=seed).as_matrix(), shifts


def elsewhere(mesh, rotation, shift):
    return Mesh(mesh.vertices @ rotation.T + shift, mesh.faces)
