"""Points of a wall that is far from them at first are not lost as outliers."""

import importlib.util

import pytest

import quadriform as qf


def test_a_part_of_a_wall_that_starts_far_from_its_points_reaches_them(shared):
    """Old fault: 75 of 600 points beside the base became outliers in the first round and stayed 15 mm from the wall."""
    path = shared / "bench" / "hearts" / "make_cases.py"
    if not path.is_file() or not (shared / "data" / "mesa_lv_atlas").is_dir():
        pytest.skip("the benchmark of hearts and its atlas are not beside this repository")
    spec = importlib.util.spec_from_file_location("make_cases", path)
    bench = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bench)
    cases = [bench.case(896, phase, "aligned") for phase in ("ed", "es")]
    found = qf.track([case.points for case in cases], slices=[case.slices for case in cases])
    assert found.rms < 0.5  # mm, of a noise of 0.3; it was 1.9
