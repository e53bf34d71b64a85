"""A patient's reference surfaces: their ejection fraction by planes through the mitral points."""

import numpy as np
import pytest

from quadriform.files import read_mesh
from quadriform.heart.base import plane_through
from quadriform.heart.volumes import volume_below


@pytest.fixture(scope="module")
def patient(shared):
    """Cavity and base plane at end diastole and end systole."""
    folder = shared / "data" / "human_lv_guidepoints"
    if not folder.is_dir():
        pytest.skip("the guide points of a left ventricle are not among the real data")
    found = []
    for frame in ("000", "009"):
        mesh = read_mesh(folder / "reference" / f"patient1_LV_ENDOCARDIAL_{frame}.obj")
        lines = (folder / "frames" / f"GPFile_{frame}.txt").read_text(encoding="utf-8").splitlines()
        rows = [line.split("\t") for line in lines if "\tMITRAL_VALVE\t" in line]
        points = np.array([[float(value) for value in row[:3]] for row in rows])
        found.append((mesh, plane_through(points, mesh.vertices.mean(axis=0))))
    return found


def fraction(before, after):
    return 100 * (1 - after / before)


def test_each_frames_own_mitral_plane(patient):
    assert fraction(*(volume_below(mesh, plane) for mesh, plane in patient)) == pytest.approx(59.7, abs=0.05)


def test_the_plane_of_end_systole_fixed(patient):
    plane = patient[1][1]
    assert fraction(*(volume_below(mesh, plane) for mesh, _ in patient)) == pytest.approx(54.3, abs=0.05)
