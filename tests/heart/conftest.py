import pytest
from heart_made import SHARE, TIMES

from quadriform.heart.measure import measure
from quadriform.heart.synthetic import SyntheticVentricle


@pytest.fixture(scope="session")
def heart():
    return SyntheticVentricle()


@pytest.fixture(scope="session")
def known(heart):
    """The known models over a cycle."""
    return heart.models(TIMES)


@pytest.fixture(scope="session")
def valve(heart):
    """Mitral points of every frame."""
    return [heart.mitral_points(time, SHARE) for time in TIMES]


@pytest.fixture(scope="session")
def measured(known, valve):
    """Everything about the known models, below each frame's mitral plane."""
    return measure(known, TIMES, base=valve)
