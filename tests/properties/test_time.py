"""Row 42 and M25: time may run backwards or be counted otherwise; frames that are the same have the same model."""

from itertools import pairwise

import numpy as np
import pytest
from shapes_made import gap, lumpy

import quadriform as qf

TIMES = np.arange(3)
FRAMES = [lumpy(80, seed=t) * [1 - 0.05 * np.sin(t), 1 - 0.08 * np.sin(t), 1] for t in TIMES]
SAME = 1e-6


def tracked(frames, **options):
    return qf.track(frames, box=(3, 3, 3), **options)


def apart(one, other):
    return max(gap(a, b) for a, b in zip(one.models, other.models, strict=True))


@pytest.fixture(scope="module", params=[("cycle", "auto"), ("cycle", None), ("previous", None)])
def plain(request):
    strategy, period = request.param
    options = {"strategy": strategy, "period": period}
    return options, tracked(FRAMES, **options)


def test_the_frames_differ(plain):
    models = plain[1].models
    assert min(gap(one, other) for one, other in pairwise(models)) > 1e-2


def test_backwards(plain):
    options, found = plain
    back = tracked(FRAMES[::-1], **options)
    assert max(gap(a, b) for a, b in zip(found.models, back.models[::-1], strict=True)) < SAME


def test_another_clock(plain):
    """Milliseconds from 100 on."""
    options, found = plain
    period = 30.0 * len(TIMES) if options["period"] else None
    assert apart(found, tracked(FRAMES, **options | {"times": 30.0 * TIMES + 100, "period": period})) < SAME


@pytest.mark.parametrize("strategy", ["cycle", "previous", "alone"])
def test_the_same_frame_again_and_again_has_the_same_model(strategy):
    found = tracked([FRAMES[0]] * 3, strategy=strategy)
    assert max(gap(found.models[0], model) for model in found.models[1:]) < SAME
