"""The times at which the synthetic ventricle is measured, and where its base is marked."""

import numpy as np

from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.splines import TimeBasis

TIMES = (0.0, 0.25, 0.5, 0.75)
SHARE = 0.8


def beating(frames=10):
    """The synthetic ventricle as a moving model with a knot at every twelfth of the cycle."""
    ventricle, knots = SyntheticVentricle(), np.arange(12) / 12
    models = ventricle.models(knots)
    first = models[0]
    control = np.stack([model.box.control_points for model in models])
    basis = TimeBasis(knots, 1.0)
    times = np.arange(frames) / frames
    return MovingModel(
        first.surfaces, first.box.origin, first.box.edges, basis, control, "LPS", "mm", frame_times=times
    )
