"""Landmarks of contours that have some in a part of the frames, or one kind only."""

import numpy as np

from quadriform.files.guide_points import GuidePoints
from quadriform.imaging.contour_landmarks import landmarks_of_contours

RING = 10 * np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
CONTOUR = {"SAX_LV_ENDOCARDIAL": RING - [0, 0, 20]}
MITRAL = {"MITRAL_VALVE": RING}
INSERTS = {"RV_INSERT": np.array([[10.0, 5, -20], [10, -5, -20]])}


def frame(number, **points):
    points = CONTOUR | points
    each = {name: np.zeros(len(of)) for name, of in points.items()}
    return GuidePoints(points, each, {name: np.ones(len(of)) for name, of in points.items()}, number)


def test_no_landmarks_are_none():
    assert landmarks_of_contours([frame(0), frame(1)]) == ()


def test_insertions_alone_are_landmarks():
    found = landmarks_of_contours([frame(0, **INSERTS), frame(1)])
    assert [len(each.rv_inserts) for each in found] == [2, 0] and all(each.base is None for each in found)


def test_a_base_of_some_frames_is_left_out_and_one_of_all_kept():
    assert [each.base for each in landmarks_of_contours([frame(0, **MITRAL), frame(1)])] == [None, None]
    bases = [each.base for each in landmarks_of_contours([frame(0, **MITRAL), frame(1, **MITRAL)])]
    for base in bases:
        np.testing.assert_allclose(base.point, 0, atol=1e-12)
        np.testing.assert_allclose(base.direction, [0, 0, 1], atol=1e-12)
