"""A fit encloses the body whose surface the points are, where the inside of that is known; else it is unreliable."""

import numpy as np
import pytest
from shapes_made import made

import quadriform as qf
from quadriform.fitting.diagnostics import LEAST_OVERLAP
from quadriform.point_sets import PointSet, point_set

QUICK = {"box": (3, 3, 3), "strength": 1e-4}
BODY = made(semi_axes=(30.0, 22.0, 18.0), exponents=(0.9, 1.1))


def capsule(thickness: float) -> qf.Mesh:
    """The body's closed shell: its outer side, and its inner side wound inwards."""
    outer = BODY.mesh(16)
    middle = outer.vertices.mean(axis=0)
    inner = middle + (1 - thickness) * (outer.vertices - middle)
    faces = np.concatenate([outer.faces, len(inner) + outer.faces[:, ::-1]])
    return qf.Mesh(np.concatenate([outer.vertices, inner]), faces)


def volume_of(inside) -> qf.Volume:
    """A mask of what a function of world points (n, 3) says, in voxels of 2 mm."""
    size = np.array([44, 44, 44])
    centres = (np.moveaxis(np.indices(size), 0, -1) - (size - 1) / 2) * 2.0
    affine = np.diag([2.0, 2.0, 2.0, 1.0])
    affine[:3, 3] = -(size - 1.0)
    shift = BODY.translation
    values = inside(centres.reshape(-1, 3) + shift).reshape(size).astype(np.uint8)
    affine[:3, 3] += shift
    return qf.Volume(values, affine)


def test_a_thin_capsule_is_unreliable():
    """Old fault: both sides of a shell 5 % of the radius thick were fitted by one surface between them, "ok"."""
    found = qf.fit(capsule(0.05), **QUICK)
    assert found.status == "unreliable" and "Dice of 0." in found.warnings["LOW_OVERLAP"]
    assert found.model.record.warnings["LOW_OVERLAP"] == found.warnings["LOW_OVERLAP"]
    # as points alone nothing tells which side is the inside
    assert "LOW_OVERLAP" not in qf.fit(capsule(0.05).vertices, **QUICK).warnings


def test_a_body_is_not():
    assert qf.fit(BODY.mesh(16), **QUICK).status == "ok"


@pytest.mark.slow
def test_a_mask_knows_its_inside():
    whole = qf.points_from_image(volume_of(lambda points: BODY.implicit(points) < 1))
    assert qf.fit(whole.cloud, **QUICK).status == "ok"
    assert point_set(whole.cloud).solid.dice(BODY.mesh(32), None) > LEAST_OVERLAP
    cup = qf.points_from_image(volume_of(_cup))
    assert "LOW_OVERLAP" in qf.fit(cup.cloud, **QUICK).warnings


def _cup(points: np.ndarray) -> np.ndarray:
    """A wall of two voxels with an opening."""
    radius = BODY.implicit(points)
    open_side = (points - BODY.translation)[:, 0] > 12
    return (radius < 1) & (radius > 0.72) & ~open_side


def test_the_overlap_is_that_in_the_unit_of_the_points():
    mesh = BODY.mesh(16)
    cloud = point_set(mesh)
    centimetres = point_set(qf.Mesh(mesh.vertices / 10, mesh.faces))
    scaled = PointSet(centimetres.points, unit="cm", solid=centimetres.solid).in_metric_unit()
    assert scaled.solid.dice(mesh, None) == pytest.approx(cloud.solid.dice(mesh, None), abs=1e-3)
    assert "LOW_OVERLAP" not in qf.fit(scaled, **QUICK).warnings


def test_data_that_ends_at_a_base_is_compared_up_to_it():
    """Half a body whose other half was cut off on purpose: the surface closes beyond, where nothing is compared."""
    cut = BODY.translation + np.array([4.0, 0, 0])
    kept = qf.points_from_image(
        volume_of(lambda points: (BODY.implicit(points) < 1) & (points[:, 0] < cut[0])), border="close"
    )
    below = kept.points[:, 0] < cut[0] - 2
    cloud = PointSet(kept.points[below], solid=kept.solid)
    assert "LOW_OVERLAP" not in qf.fit(cloud, base=(cut, [1, 0, 0]), **QUICK).warnings
