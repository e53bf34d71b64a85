"""The iterative two-step algorithm (paper 3.3): displacements and control points alternately."""

from collections.abc import Mapping

import numpy as np

from quadriform.fitting.options import PaperOptions
from quadriform.fitting.paper.displacement import data_to_model, model_to_data
from quadriform.fitting.paper.solvers import step_for
from quadriform.fitting.result import Iteration, Progress
from quadriform.points import Array, rms_length
from quadriform.shapes.control_box import ControlBox, outer_box
from quadriform.shapes.superquadric import Superquadric

MODEL_RESOLUTION = 20
"""Cells along a cube edge for the model's sample: 2,402 points a surface."""


def two_step(
    superquadrics: Mapping[str, Superquadric],
    clouds: Mapping[str, Array],
    options: PaperOptions,
    progress: Progress | None = None,
) -> tuple[ControlBox, tuple[Iteration, ...], float]:
    """The box deformed so that its surfaces approach their points, the record of each iteration, and the strength used.

    Args:
        superquadrics: name -> superquadric, centred and scaled.
        clouds: name -> (n, 3) points, likewise.
        options: the choices.
        progress: called after each iteration.
    """
    box = outer_box(superquadrics, options.box)
    samples = {name: surface.grid(MODEL_RESOLUTION)[0] for name, surface in superquadrics.items()}
    b = box.matrix(np.concatenate(list(samples.values())))  # P5
    ends = np.cumsum([len(sample) for sample in samples.values()])[:-1]
    solve, strength = step_for(b, options.box, options.regularity, options.strength)
    match = data_to_model if options.matching == "data-to-model" else model_to_data
    rest = box.control_points.reshape(-1, 3)
    control, history = rest, []
    for iteration in range(options.iterations):
        surface = b @ control
        targets = [match(part, clouds[name]) for name, part in zip(samples, np.split(surface, ends))]
        displacement = np.concatenate(targets)  # P6; the union of section 3.4.2
        step = solve(displacement, control, rest)  # P7
        control = control + step  # section 3.3
        moved = b @ step
        lengths = (rms_length(vectors) for vectors in (moved - displacement, step, control - rest, moved))
        history.append(Iteration(*lengths))
        if progress is not None:
            progress(iteration + 1, options.iterations)
        if options.tolerance is not None and history[-1].surface_motion < options.tolerance:
            break  # section 3.3, the stop test
    return box.with_control_points(control), tuple(history), strength
