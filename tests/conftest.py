"""Fixtures every test may use."""

import gc
import os
import signal
from collections import Counter
from pathlib import Path

for library in ("OMP", "OPENBLAS"):  # before NumPy is imported; threads that share tiny matrices wait for each other
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

import numpy as np  # noqa: E402
import pytest  # noqa: E402

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as in a background job, whose children would not be interrupted
    signal.signal(signal.SIGINT, signal.default_int_handler)
SLOW = Path(__file__).with_name("slow.txt")
SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers():
    """One more than there are cores: it works while another waits for a browser or for a process."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(items):
    """Mark what is listed as slow. Files with most of it come first: at the end short ones fill the gap of a worker."""
    listed = set(SLOW.read_text(encoding="utf-8").split())
    slow = [item for item in items if item.nodeid.partition("[")[0] in listed]
    for item in slow:
        item.add_marker("slow")
    count = Counter(item.path for item in slow)
    items.sort(key=lambda item: -count[item.path])


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """The thousands of collected tests stay to the end: the garbage collector need not look at them again and again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of real data beside the repository; the test is skipped where it is missing."""
    if not SHARED.is_dir():
        pytest.skip("the folder of real data is not beside this repository")
    return SHARED


@pytest.fixture
def blank_figures(monkeypatch):
    """Pages without their drawings."""
    from undrawn import draw_nothing

    draw_nothing(monkeypatch)


@pytest.fixture
def remembered_fits(monkeypatch):
    """The same fit is made once, for tests of what is done with it; not for tests of fits."""
    from remembered import remember_fits

    remember_fits(monkeypatch)


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(1998)
