"""The iterative two-step algorithm (paper 3.3): displacements, then control points, again and again."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from quadriform.errors import OptionError, choose
from quadriform.fitting.matching import MATCHINGS
from quadriform.fitting.outcome import Iteration, Progress
from quadriform.fitting.regularity import REGULARITIES, Regulariser, step_for
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.superquadric import Superquadric

MODEL_RESOLUTION = 20
"""Cells along a cube edge for the model's sample: 2,402 points a surface."""


@dataclass(frozen=True)
class PaperOptions:
    """The choices of the paper's iteration.

    Attributes:
        box: control points along each axis.
        regularity: "svd" (P8), "svd-position", "springs" (on the displacement), "springs-paper" (P9 to the letter) or
            a regulariser of one's own.
        strength: for the SVD a count (>= 1) or a threshold (< 1) of singular values; for springs alpha; or "auto".
        matching: "data-to-model" or "model-to-data".
        iterations: how many turns.
        tolerance: stop when the surface moves less than this share of the cloud's RMS radius; None never stops early.
    """

    box: tuple[int, int, int] = (5, 5, 5)
    regularity: str | Regulariser = "springs"
    strength: float | str = "auto"
    matching: str = "data-to-model"
    iterations: int = 30
    tolerance: float | None = None

    def __post_init__(self) -> None:
        choose(self.matching, tuple(MATCHINGS), "matching")
        if isinstance(self.regularity, str):
            choose(self.regularity, REGULARITIES, "regularity")
        if not isinstance(self.strength, (int, float)) or isinstance(self.strength, bool):
            choose(self.strength, ("auto",), "strength")
        if not isinstance(self.iterations, int) or self.iterations < 1:
            raise OptionError(f"option iterations={self.iterations!r} is out of range; expected a whole number >= 1")
        if self.tolerance is not None and not self.tolerance > 0:
            raise OptionError(f"option tolerance={self.tolerance!r} is out of range; expected a number above 0")


def outer_box(superquadrics: Mapping[str, Superquadric], shape: tuple[int, int, int]) -> ControlBox:
    """The undeformed box around the largest of the surfaces."""
    return ControlBox.around(max(superquadrics.values(), key=_box_volume), shape)


def _box_volume(superquadric: Superquadric) -> float:
    return float(np.abs(np.linalg.det(ControlBox.around(superquadric, (2, 2, 2)).edges)))


def two_step(
    superquadrics: Mapping[str, Superquadric],
    clouds: Mapping[str, Array],
    options: PaperOptions,
    progress: Progress | None = None,
) -> tuple[ControlBox, tuple[Iteration, ...], float]:
    """Deform one box so that its surfaces approach their points.

    Args:
        superquadrics: name -> superquadric, centred and scaled.
        clouds: name -> (n, 3) points, likewise.
        options: the choices.
        progress: called after each iteration.

    Returns:
        The deformed box, the record of each iteration, and the strength used.
    """
    box = outer_box(superquadrics, options.box)
    samples = {name: surface.grid(MODEL_RESOLUTION)[0] for name, surface in superquadrics.items()}
    b = box.matrix(np.concatenate(list(samples.values())))  # P5
    ends = np.cumsum([len(sample) for sample in samples.values()])[:-1]
    solve, strength = step_for(b, options.box, options.regularity, options.strength)
    match = MATCHINGS[options.matching]
    rest = box.control_points.reshape(-1, 3)
    control, history = rest, []
    for turn in range(options.iterations):
        surface = b @ control
        wanted = [match(part, clouds[name]) for name, part in zip(samples, np.split(surface, ends))]
        displacement = np.concatenate(wanted)  # P6; the union over the surfaces, 3.4.2
        step = solve(displacement, control, rest)  # P7
        control = control + step
        moved = b @ step
        history.append(
            Iteration(
                error=_rms(moved - displacement),
                box_motion=_rms(step),
                box_displacement=_rms(control - rest),
                surface_motion=_rms(moved),
            )
        )
        if progress is not None:
            progress(turn + 1, options.iterations)
        if options.tolerance is not None and history[-1].surface_motion < options.tolerance:
            break
    return box.with_control_points(control), tuple(history), strength


def _rms(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))
