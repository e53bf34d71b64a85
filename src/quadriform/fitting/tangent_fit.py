"""The refinement by tangent distance as a whole: starts, rounds, the size of the box, and the check for folds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from quadriform.errors import WarningKind, Warnings
from quadriform.fitting.candidates import candidates
from quadriform.fitting.coarse_to_fine import Refined, Rounds, coarse_unfolded
from quadriform.fitting.options import TangentOptions, check_box, check_strength
from quadriform.fitting.outcome import Iteration, Progress
from quadriform.fitting.sheet import Sheet
from quadriform.points import Array
from quadriform.shapes import pose
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

AUTO_SIDES = (3, 5, 7)
STRONGER, MOST_STRONGER = 1.5, 60
"""A fold is cured by raising the strength of the evidence by halves."""
PRICE, CHEAP = 1.5, 0.025
"""A cure is worse than the fold when it makes the noise this many times larger, and larger than this share of the
cloud's RMS radius."""

HalfSpace = tuple[Array, Array]


@dataclass(frozen=True)
class Result:
    """A refinement by either method, in the centred, scaled frame.

    Attributes:
        model: refined.
        history: one record a round.
        strength: that was used.
        noise: standard deviation along the normal; None where none is estimated.
        covariance: of the control points, or None.
        inliers: name -> probabilities, or None.
        warnings: about the refinement itself.
        beyond: half-space where no data is expected.
        covered: whether the data was seen to sample closed surfaces, whatever directions it lies in.
        counted: name -> which points have a weight, or None for all.
    """

    model: DeformableModel
    history: tuple[Iteration, ...]
    strength: float
    noise: float | None = None
    covariance: Array | None = None
    inliers: dict[str, Array] | None = None
    warnings: Warnings = field(default_factory=dict)
    beyond: HalfSpace | None = None
    covered: bool = False
    counted: dict[str, NDArray[np.bool_]] | None = None


@dataclass(frozen=True)
class _Task:
    """What stays the same over starts and sizes."""

    clouds: Mapping[str, Array]
    weights: Mapping[str, Array]
    options: TangentOptions
    beyond: HalfSpace | None
    progress: Progress | None

    def sheets(self, surfaces: Mapping[str, Superquadric]) -> list[Sheet]:
        """One sheet a surface, without the points of weight zero."""
        result = []
        for name, cloud in self.clouds.items():
            there = self.weights[name] > 0
            result.append(Sheet(surfaces[name], cloud[there], self.weights[name][there], self.beyond))
        return result

    def rounds(self, surfaces: Mapping[str, Superquadric], shape: tuple[int, int, int]) -> Rounds:
        """Fresh rounds in the box around the surfaces."""
        strength = check_strength(self.options.strength)
        box = common_box(surfaces, shape)
        return Rounds(box, self.options.regularity, strength, self.options.robust, self.progress)


def fit_tangent(
    surfaces: dict[str, Superquadric],
    clouds: dict[str, Array],
    weights: dict[str, Array],
    options: TangentOptions,
    beyond: HalfSpace | None,
    max_error: float | None,
    kind: str | None,
    progress: Progress | None,
) -> Result:
    """Refine all surfaces at once; everything in the centred, scaled frame.

    Args:
        surfaces: name -> start.
        clouds: name -> (n, 3) points.
        weights: name -> (n,).
        options: the choices.
        beyond: half-space where no data is expected.
        max_error: RMS distance that box="auto" must reach.
        kind: other starts of this kind may take the place of the given ones; None keeps them.
        progress: called after each round.
    """
    task = _Task(clouds, weights, options, beyond, progress)
    starts = [surfaces] if kind is None else candidates(clouds, surfaces, kind)
    if max_error is None:
        return _best_start(task, starts, check_box(options.box))
    for side in AUTO_SIDES:
        result = _best_start(task, starts, (side, side, side))
        error = _error(result, clouds)
        if error <= max_error:
            return result
    result.warnings[WarningKind.POOR_FIT] = (
        f"no box up to {AUTO_SIDES[-1]} control points a side reached max_error: the last one's error is "
        f"{error / max_error:.2f} times it, the noise of the points {(result.noise or 0) / max_error:.2f} times"
    )
    return result


def _error(result: Result, clouds: dict[str, Array]) -> float:
    """RMS distance of the inliers to the model."""
    squares, total = 0.0, 0.0
    for name, cloud in clouds.items():
        weight = np.ones(len(cloud)) if result.inliers is None else result.inliers[name]
        squares += float(weight @ result.model.distance(cloud, name) ** 2)
        total += float(weight.sum())
    return float(np.sqrt(squares / total))


def _best_start(task: _Task, starts: Sequence[dict[str, Superquadric]], shape: tuple[int, int, int]) -> Result:
    """The start whose coarse stage is not tangled and has the largest evidence, refined on all points."""
    trials = [_tried(task, surfaces, shape) for surfaces in starts]
    rounds, sheets, coarse = min(trials, key=lambda trial: (trial[2].tangled, trial[2].solution.criterion))
    surfaces = dict(zip(task.clouds, (sheet.superquadric for sheet in sheets)))
    refined, warnings = unfold(rounds, coarse, rounds.fine(sheets, coarse), surfaces)
    return Result(
        model=DeformableModel(surfaces, refined.box),
        history=refined.history,
        strength=refined.solution.strength,
        noise=refined.solution.noise,
        covariance=refined.solution.covariance(),
        inliers=_all_inliers(task, refined),
        warnings=warnings,
        beyond=task.beyond,
        covered=coarse.covered and task.beyond is None,
    )


def _tried(
    task: _Task, surfaces: dict[str, Superquadric], shape: tuple[int, int, int]
) -> tuple[Rounds, list[Sheet], Refined]:
    rounds, sheets = task.rounds(surfaces, shape), task.sheets(surfaces)
    return rounds, sheets, coarse_unfolded(rounds, sheets)


def _all_inliers(task: _Task, refined: Refined) -> dict[str, Array]:
    """Probabilities of all points, zero for those of weight zero."""
    result = {}
    for (name, weights), sheet in zip(task.weights.items(), refined.sheets):
        result[name] = np.zeros(len(weights))
        result[name][weights > 0] = sheet.inliers
    return result


def unfold(
    rounds: Rounds, coarse: Refined, refined: Refined, surfaces: dict[str, Superquadric]
) -> tuple[Refined, Warnings]:
    """Raise the strength until the map is certified not to fold inside the surfaces, if that costs little.

    Begins again from the coarse stage: its few points do not make a fold of every wrinkle of the data. Several surfaces
    in one box are only worth having when the space between them does not fold: there any price is paid.
    """
    if _certified(refined, surfaces):
        return refined, {}
    limit = np.inf if len(surfaces) > 1 else max(PRICE * refined.solution.noise, CHEAP)
    few, strength = coarse, max(coarse.solution.strength, refined.solution.strength)
    for _ in range(MOST_STRONGER):
        few = rounds.held(few, strength)
        if few.solution.noise > 2 * limit:
            break
        if _certified(few, surfaces):
            cured = rounds.finished(few, refined)
            if cured.solution.noise > limit:
                break
            if _certified(cured, surfaces):
                return cured, {}
        strength *= STRONGER
    return refined, {WarningKind.FOLDING: _fold_text(refined, surfaces)}


def _fold_text(refined: Refined, surfaces: dict[str, Superquadric]) -> str:
    model = DeformableModel(surfaces, refined.box)
    crossed = ", ".join(" and ".join(dict.fromkeys(pair)) for pair in model.crossings())
    end = f"crossing: {crossed}" if crossed else "no surface crosses itself or another"
    return f"the map folds space inside the surface at {len(model.folds())} sampled places; {end}"


def _certified(refined: Refined, surfaces: dict[str, Superquadric]) -> bool:
    """Whether the map provably does not fold inside the surfaces and no mesh of them crosses."""
    for surface in surfaces.values():  # a look at some points is quicker than a proof that cannot come
        if np.linalg.det(refined.box.jacobian(surface.grid(12)[0])).min() <= 0:
            return False
    model = DeformableModel(surfaces, refined.box)
    return not model.crossings() and model.min_jacobian() > 0


def common_box(surfaces: Mapping[str, Superquadric], shape: tuple[int, int, int]) -> ControlBox:
    """The undeformed box of the largest surface, grown where another one reaches beyond it."""
    outer = max(surfaces.values(), key=lambda s: abs(float(np.linalg.det(ControlBox.around(s, (2, 2, 2)).edges))))
    box = ControlBox.around(outer, shape)
    if len(surfaces) == 1:
        return box
    corner = pose.to_local(box.origin[None], outer.rotation, outer.translation)[0]
    grids = [pose.to_local(s.grid(12)[0], outer.rotation, outer.translation) for s in surfaces.values()]
    low = np.minimum(corner, np.concatenate(grids).min(axis=0))
    high = np.maximum(-corner, np.concatenate(grids).max(axis=0))
    edges = (high - low)[:, None] * outer.rotation.T
    return ControlBox.undeformed(pose.to_world(low[None], outer.rotation, outer.translation)[0], edges, shape)
