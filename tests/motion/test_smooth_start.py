"""The smooth box that all frames of a cycle start from: of which strengths, and that it does not amplify rounding."""

from types import SimpleNamespace

import numpy as np
import pytest

import quadriform as qf
from quadriform.errors import OptionError
from quadriform.fitting.options import TangentOptions
from quadriform.fitting.refinement import refine
from quadriform.motion import whole_cycle
from quadriform.points import Frame


class Box(SimpleNamespace):
    def elevate(self, degrees):
        return f"{self.name} of degrees {degrees}"


def smooth(monkeypatch, boxes, folds=(), fails=()):
    """The smooth box where fits at the two strengths have these boxes, and what they started from."""
    asked, left = [], iter(boxes)

    def trial_of(given, superquadrics, shape):
        first = SimpleNamespace(solution=SimpleNamespace(strength=0.002), box=Box(name="first"))
        return SimpleNamespace(first=first, given=given, problem=given, datasets=None, coarse=None, surfaces={})

    def fine(problem, datasets, coarse):
        asked.append((problem.options.strength, problem.warm_start))
        if len(asked) in fails:
            raise OptionError("undetermined")
        return SimpleNamespace(box=next(left))

    monkeypatch.setattr(refine, "_Trial", SimpleNamespace(of=trial_of))
    monkeypatch.setattr(refine, "fine_stage", fine)
    monkeypatch.setattr(refine, "never_folds", lambda box, surfaces: box not in folds)
    given = refine.RefinementInput({}, {}, {}, None, TangentOptions((5, 4, 3)))
    return refine.smooth_box(given, {}), asked


def test_a_smooth_box_is_fitted_at_a_hundred_and_ten_times_the_first_strength(monkeypatch):
    box, asked = smooth(monkeypatch, ["a", "b"])
    assert box == "b" and asked == [(pytest.approx(0.2), None), (pytest.approx(0.02), "a")]


def test_a_smooth_box_is_the_one_before_where_the_next_folds_or_is_undetermined(monkeypatch):
    assert smooth(monkeypatch, ["a", "b"], folds=["b"])[0] == smooth(monkeypatch, ["a", "b"], fails=[2])[0] == "a"
    found, asked = smooth(monkeypatch, ["a", "b"], folds=["a"])
    assert found == smooth(monkeypatch, ["a"], fails=[1])[0] == "first of degrees (4, 3, 2)" and len(asked) == 1


def test_the_start_of_open_contours_does_not_amplify_rounding(shared):
    """A single fit of them moves control points by several RMS radii where its points move by 1e-12 of one."""
    folder = shared / "data" / "human_lv_guidepoints_2"
    if not folder.is_dir():
        pytest.skip("the guide points of a second left ventricle are not among the real data")
    frame = qf.read_guide_point_frames(sorted(folder.glob("GPFile_*.txt")))[0]
    options, found = {"box": (5, 5, 5), "regularity": "bending", "robust": True}, []
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        clouds = {name: frame.surface(name)[0][::8] for name in ("endo", "epi")}
        moved = {name: points + 1e-10 * rng.normal(size=points.shape) for name, points in clouds.items()}
        local = Frame.of(np.concatenate(list(moved.values())))
        points = {name: local.to_local(each) for name, each in moved.items()}
        found.append(whole_cycle.smooth_start(points, None, options).approach.box.control_points)
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-6)
