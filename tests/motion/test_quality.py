"""What the data of each frame of a cycle supports, and which frames are named in the warnings."""

import numpy as np
import pytest
from shapes_made import even_directions

import quadriform as qf
from quadriform.fitting.support import Reach, Support
from quadriform.motion.quality import support_warnings

SPHERE = even_directions(400)


def support(within, reach=0.1):
    return Support(within, within, within, within, 0.2, reach, Reach(reach, 1.0))


def test_the_frame_with_the_least_support_is_named():
    frames = [{"a": support(0.99)}, {"a": support(0.9)}, {"a": support(0.8)}, {"a": support(0.96, reach=3.0)}]
    found = support_warnings(frames)
    assert found["PARTIAL_COVERAGE"].startswith("frame 2: 20 % of the surface")
    assert found["RUNAWAY"].startswith("frame 3: ")  # another frame than that with the least support
    assert support_warnings([{"a": support(0.96)}] * 2) == {}
    walls = support_warnings([{"a": support(0.4), "b": support(0.9)}, {"a": support(0.3), "b": support(0.99)}])
    assert "a: frame 1: 70 %" in walls["PARTIAL_COVERAGE"] and "b: frame 0: 10 %" in walls["PARTIAL_COVERAGE"]
    assert walls["UNSUPPORTED"] == "a: frame 1: data supports 30 % of the area only"


@pytest.mark.parametrize("strategy", ["cycle", "previous"])
def test_a_cap_that_is_missing_in_some_frames_is_reported(strategy):
    """A sphere that grows; 30 % of the area has no points in the second frame, nearly half of it near some."""
    whole, part = SPHERE, SPHERE[SPHERE[:, 2] < 0.4]
    found = qf.track([10 * whole, 11 * part, 10.5 * whole], box=(3, 3, 3), strategy=strategy)
    assert (found.supported[[0, 2]] > 0.99).all() and 0.7 < found.supported[1] < 0.85
    assert "frame 1" in found.warnings["PARTIAL_COVERAGE"] and found.status != "ok"
    assert found.moving.record.status == found.status


def test_a_base_is_no_missing_data():
    part = SPHERE[SPHERE[:, 2] < 0.4]
    plane = ([0.0, 0, 4], [0.0, 0, 1])
    found = qf.track([10 * part, 10 * part + 0.01], box=(3, 3, 3), base=plane)
    assert "PARTIAL_COVERAGE" not in found.warnings and (found.supported < 0.85).all()
    with_noise = qf.track([10 * part, 10 * part + 0.01], box=(3, 3, 3), base=plane, noise=0.01)
    np.testing.assert_allclose(with_noise.supported, found.supported, atol=0.05)
