"""The same shape on another grid is the same surface in the world: fits of label images, not their points alone.

A ventricle with bumps, cavity 1 in a wall 2. Surfaces are compared by distances both ways: in RMS radii where the grid
is the same but for the order of its axes, in voxels where it is another one.
"""

import numpy as np
import pytest
from shapes_made import gap, turned

import quadriform as qf
from quadriform.imaging.segmentation import Labels
from quadriform.imaging.ventricle import ventricle_from_labels
from quadriform.imaging.volume import Volume

EXACT = 1e-6
SEMI_AXES = {"endo": np.array([15.3, 13.2, 24.1]), "epi": np.array([23.4, 20.6, 32.5])}
MIDDLE, HALF = np.array([0.23, -0.11, -3.3]), 38.0
REORDERED = {
    "mirrored and permuted": ((2, 0, 1), (True, False, False)),
    "quarter turn": ((1, 0, 2), (True, False, False)),
}
OTHERS = {
    "rotated": (turned(2), (4.0, 4.0, 4.0)),
    "twice as fine": (turned(5), (2.5, 2.5, 2.5)),
    "long voxels": (turned(4), (2.0, 2.0, 6.0)),
}
ONE, TWO = ("endo",), ("endo", "epi")


def bumpy(points, semi_axes):
    """Below 0 inside: an ellipsoid with bumps, blunter on top; no symmetry at all."""
    moved = points + 1.5 * np.sin(points[..., [1, 2, 0]] / 9 + [0.3, 1.0, 2.0])
    blunt = np.where((np.arange(3) == 2) & (moved > 0), 1.35 * moved, moved)
    return ((blunt / semi_axes) ** 2).sum(axis=-1) - 1


def round_about_z(points, semi_axes):
    """Below 0 inside: an ellipsoid of revolution."""
    return (((points - MIDDLE) / semi_axes[[0, 0, 2]]) ** 2).sum(axis=-1) - 1


def image(rotation, spacing, shape=bumpy):
    """A cube about the shape, its axes turned."""
    counts = [int(2 * HALF / step) + 1 for step in spacing]
    affine = np.eye(4)
    affine[:3, :3] = rotation * spacing
    affine[:3, 3] = MIDDLE - affine[:3, :3] @ (np.array(counts) - 1) / 2
    at = np.moveaxis(np.indices(counts), 0, -1) @ affine[:3, :3].T + affine[:3, 3]
    inside = [shape(at, SEMI_AXES[name]) < 0 for name in ("endo", "epi")]
    return Volume(np.select(inside, [1, 2], 0).astype(np.uint8), affine)


def reordered(volume, axes, flips):
    """The same voxels at the same places in the world, in another order."""
    values, affine = volume.values.transpose(axes), volume.world_from_voxel[:, [*axes, 3]]
    for axis in np.flatnonzero(flips):
        values = np.flip(values, axis)
        affine[:3, 3] += (values.shape[axis] - 1) * affine[:3, axis]
        affine[:3, axis] *= -1
    return Volume(values, affine)


def fitted(volume, surfaces):
    clouds = ventricle_from_labels(volume, cavity=Labels((1,)), wall=Labels((2,))).clouds
    return qf.fit({name: clouds[name] for name in surfaces}, box=(4, 4, 4)).model


def farthest(one, other, surface):
    """Largest distance between two surfaces, both ways, in mm."""
    pairs = ((one, other), (other, one))
    return max(np.abs(a.distance(b.mesh(surface, 8).vertices, surface)).max() for a, b in pairs)


def off_the_truth(model, surface):
    """Largest distance of a surface to the true one in mm, to first order."""
    vertices, step = model.mesh(surface, 8).vertices, 1e-3 * np.eye(3)
    height = bumpy(vertices, SEMI_AXES[surface])
    ahead, behind = (bumpy(vertices[:, None] + sign * step, SEMI_AXES[surface]) for sign in (1, -1))
    return (np.abs(height) / np.linalg.norm((ahead - behind) / 2e-3, axis=1)).max()


@pytest.fixture(scope="module", params=[ONE, TWO], ids=" ".join)
def plain(request):
    volume = image(turned(1), (4.0, 4.0, 4.0))
    return request.param, volume, fitted(volume, request.param)


@pytest.mark.parametrize("how", REORDERED)
def test_the_order_of_the_axes_does_not_matter(plain, how):
    surfaces, volume, model = plain
    found = fitted(reordered(volume, *REORDERED[how]), surfaces)
    assert max(gap(model, found, name) for name in surfaces) < EXACT


@pytest.mark.parametrize("how", OTHERS)
def test_another_grid_gives_the_same_surface_to_half_a_voxel(plain, how):
    """Half the longest side: its own to the true surface, that of the coarser grid to the plain fit."""
    surfaces, volume, model = plain
    other = image(*OTHERS[how])
    found = fitted(other, surfaces)
    own, coarser = other.spacing.max() / 2, max(other.spacing.max(), volume.spacing.max()) / 2
    for name in surfaces:
        assert off_the_truth(found, name) < own
        assert farthest(model, found, name) < coarser


def test_a_shape_of_revolution_has_one_surface_too():
    """Its voxels have partners equally far from everything, and 5.3 is no number of a computer."""
    volume = image(np.eye(3), (5.3, 5.3, 5.3), round_about_z)
    model, found = (fitted(v, ["epi"]) for v in (volume, reordered(volume, *REORDERED["quarter turn"])))
    assert gap(model, found) < EXACT
