"""A whole cycle at once: foot points of every frame are updated, then control points of all times are solved for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from quadriform.errors import DegenerateError, OptionError
from quadriform.fitting.least_squares.normal_equations import normal_equations
from quadriform.fitting.least_squares.regularisers import Regulariser, penalty_matrix
from quadriform.fitting.refinement.multiresolution import FIRST_NOISE
from quadriform.fitting.refinement.point_to_plane import data_rows, evidence_of, step_length
from quadriform.fitting.refinement.surface_data import SurfaceData
from quadriform.fitting.refinement.unfolding import JacobianPenalty
from quadriform.fitting.result import Progress
from quadriform.motion.cycle_equations import CycleEvidence
from quadriform.motion.slice_shifts import SliceNumbers, SlicePlanes
from quadriform.points import Array
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.splines import TimeBasis
from quadriform.shapes.superquadric import Superquadric

STRONGEST, DESCENT = 1e3, 6
SEARCHES = 2
ROUNDS, MOST_ROUNDS = 6, 24
REST = 0.005
"""The cycle is fitted when the noise changes by less than this fraction, and no frame folds."""
TANGENTIAL_STEPS = 3
LEAST_INLIERS = 0.5
"""Of the points of a surface in a frame at least this fraction belongs to it."""
MEDIAN = 0.6745
"""Of the distance of normally distributed values from their mean, in standard deviations."""


@dataclass(frozen=True)
class CycleFit:
    """The fitted cycle, in the centred, scaled frame.

    Attributes:
        control_points: (K, l+1, m+1, n+1, 3), at the knots.
        datasets: for each frame the surfaces with their points, moved by the shifts, and inlier probabilities.
        noise: standard deviation of the data along the normal.
        strengths: alpha in space, gamma in time.
        shifts: (S, 2), of the slices in their planes; none without slice numbers.
        certified: whether each frame is proven not to fold.
    """

    control_points: Array
    datasets: tuple[dict[str, SurfaceData], ...]
    noise: float
    strengths: tuple[float, float]
    shifts: Array
    certified: tuple[bool, ...]

    @property
    def inliers(self) -> list[dict[str, Array]]:
        """Probabilities of the points of each frame, by surface."""
        return [{name: data.inliers for name, data in datasets.items()} for datasets in self.datasets]


class Cycle:
    """The state that goes from round to round.

    Args:
        surfaces: name -> superquadric.
        box: undeformed, around the outermost surface.
        frames: name -> points, for each frame.
        values: (F, K), the splines at the frames' times.
        basis: the splines.
        regularity: in space.
        robust: whether outliers are down-weighted.
        planes: of the slices whose shifts are sought, with the slice number of each point; or None.
    """

    def __init__(
        self,
        surfaces: Mapping[str, Superquadric],
        box: ControlBox,
        frames: Sequence[Mapping[str, Array]],
        values: Array,
        basis: TimeBasis,
        regularity: str | Regulariser,
        robust: bool,
        planes: tuple[SlicePlanes, SliceNumbers] | None,
    ) -> None:
        self.surfaces, self.values, self.basis, self.robust, self.planes = surfaces, values, basis, robust, planes
        self.boxes = [box] * len(frames)
        self.displacement = np.zeros((values.shape[1], box.rest.size // 3, 3))
        self.frames = frames
        self.datasets = [self._datasets(frame, box) for frame in frames]
        self.shape: tuple[int, int, int] = box.control_points.shape[:3]
        self.regularity, self.penalty = regularity, penalty_matrix(regularity, self.shape)
        self.noise = FIRST_NOISE * float(np.median(np.abs(np.concatenate(self._distances()))))
        squared = [np.concatenate([data.distances(box) for data in datasets]) for datasets in self.datasets]
        order = np.argsort([distances @ distances for distances in squared], kind="stable")
        self.ends = int(order[0]), int(order[-1])
        self.shifts = np.zeros((0 if planes is None else len(planes[0].axes), 2))
        count = sum(len(cloud) for cloud in frames[0].values())
        self.penalties = [JacobianPenalty.of(box, surfaces, count, self.noise)] * len(frames)

    def _datasets(self, frame: Mapping[str, Array], box: ControlBox) -> list[SurfaceData]:
        found = [SurfaceData.of(self.surfaces[name], points, np.ones(len(points))) for name, points in frame.items()]
        return [data.with_nearest_foot_points(box) for data in found]

    def _distances(self) -> list[Array]:
        return [data.distances(box) for box, datasets in zip(self.boxes, self.datasets) for data in datasets]

    def fit(self, alpha: float | None, progress: Progress | None = None) -> CycleFit:
        """From strengths at which nothing folds down to those of the largest evidence, then until it converges.

        The search for the strength in time begins at the one at which a motion of the whole cloud once a period costs
        as much as the noise.

        Args:
            alpha: the strength in space; None for the evidence's.
            progress: called after each round.

        Raises:
            OptionError: the strength that the user gave leaves control points undetermined.
            DegenerateError: so do all strengths.
        """
        report, total = progress or (lambda done, total: None), DESCENT + ROUNDS
        strengths = alpha or self._alone(None), self.noise**2 / (2 * np.pi) ** 4
        solved = []
        for done, factor in enumerate(np.geomspace(STRONGEST, 1, DESCENT)):
            solved.append(self._round((factor * strengths[0], factor * strengths[1])))
            report(done + 1, total)
        certified: tuple[bool, ...] = ()
        for done in range(MOST_ROUNDS):
            if done < SEARCHES:
                in_space = alpha or self._alone(strengths[0])
                strengths = in_space, self._evidence().best_in_time(in_space, strengths[1])
            before = self.noise
            solved.append(self._round(strengths))
            report(min(DESCENT + done + 1, total), total)
            if done + 1 >= ROUNDS:
                certified = self._certified()
                if all(certified) and abs(self.noise - before) < REST * before:
                    break
        if alpha is not None and not solved[-1] and self._evidence().solve(*strengths) is None:
            raise OptionError(f"option strength={alpha:g} leaves control points undetermined; expected a larger one")
        if not any(solved):
            raise DegenerateError("frames leave control points undetermined; expected points all around the body")
        control = self.displacement.reshape(-1, *self.shape, 3) + self.boxes[0].rest
        datasets = tuple(dict(zip(frame, datasets)) for frame, datasets in zip(self.frames, self.datasets))
        return CycleFit(control, datasets, self.noise, strengths, self.shifts, certified)

    def _alone(self, near: float | None) -> float:
        """The smaller of the best strengths in space of the two frames with the least and the largest displacement.

        With more strength one of them would lag behind. Over a whole cycle smoothness in time could replace this
        strength on the surface, but nothing would then regularise the space inside.
        """
        nothing = [None] * len(self.surfaces)
        ends = [evidence_of(self.datasets[n], nothing, self.boxes[n], self.regularity) for n in self.ends]
        return min(each.select(None, near).strength for each in ends)

    def _round(self, strengths: tuple[float, float]) -> bool:
        """Move everything towards the solution of the linear problem as far as lowers the sum; false without one."""
        self._update_foot_points()
        if self.robust:
            self._update_inliers()
        evidence = self._evidence()
        penalties = [penalty.equations(box) for penalty, box in zip(self.penalties, self.boxes)]
        solution = evidence.plus(penalties).solve(*strengths)
        if solution is None:
            return False
        moved, shifted = solution.displacement - self.displacement, solution.shifts - self.shifts.ravel()

        def total(length: float) -> float:
            trial = self.displacement + length * moved, self.shifts.ravel() + length * shifted
            return self._total(evidence, *trial, strengths)

        length = step_length(total)
        displacement, shifts = self.displacement + length * moved, self.shifts.ravel() + length * shifted
        self.displacement, self.shifts = displacement, shifts.reshape(-1, 2)
        self.boxes, self.noise = self._boxes(self.displacement), solution.noise
        self._shift()
        return True

    def _total(
        self, evidence: CycleEvidence, displacement: Array, shifts: Array, strengths: tuple[float, float]
    ) -> float:
        penalties = [penalty.cost(box) for penalty, box in zip(self.penalties, self._boxes(displacement))]
        return evidence.cost(displacement, shifts, *strengths) + sum(penalties)

    def _boxes(self, displacement: Array) -> list[ControlBox]:
        rest = self.boxes[0].rest
        in_time = np.einsum("fa,akc->fkc", self.values, displacement).reshape(-1, *rest.shape)
        return [self.boxes[0].with_control_points(rest + moved) for moved in in_time]

    def _update_foot_points(self) -> None:
        self.datasets = [
            [data.with_tangential_steps(box, TANGENTIAL_STEPS) for data in datasets]
            for box, datasets in zip(self.boxes, self.datasets)
        ]

    def _update_inliers(self) -> None:
        self.datasets = [
            [self._weighted(data, box) for data in datasets] for box, datasets in zip(self.boxes, self.datasets)
        ]

    def _weighted(self, data: SurfaceData, box: ControlBox) -> SurfaceData:
        """With inlier probabilities at the noise of the cycle, or where most points are outliers, at their own."""
        distances = data.distances(box)
        found = data.weighted(distances, self.noise)
        if np.average(found.inliers, weights=data.weights) >= LEAST_INLIERS:
            return found
        return data.weighted(distances, float(np.median(distances)) / MEDIAN)  # not yet near, rather than outliers

    def _shift(self) -> None:
        """Move the points of each slice by its shift."""
        if self.planes is None:
            return
        planes, slices = self.planes
        self.datasets = [
            [
                replace(data, points=points + planes.offsets(self.shifts, numbers[name]))
                for data, (name, points) in zip(datasets, frame.items())
            ]
            for frame, datasets, numbers in zip(self.frames, self.datasets, slices)
        ]

    def _evidence(self) -> CycleEvidence:
        equations, rows, count = [], [], 0.0
        for frame, (box, datasets) in enumerate(zip(self.boxes, self.datasets)):
            found = [data_rows(data, box) for data in datasets]
            targets = list(self.frames[frame].values()) if self.planes else [row.targets for row in found]
            parts = [
                normal_equations(box.local(row.origins), row.metric, target - row.origins, box.degrees)
                for row, target in zip(found, targets)
            ]
            equations.append(sum(parts[1:], parts[0]))
            count += sum(float((data.weights * data.inliers).sum()) for data in datasets)
            if self.planes:
                rows.append(list(zip(found, self.planes[1][frame].values(), targets)))
        bordered_block = self.planes[0].bordered_block(rows, self.boxes, self.noise) if self.planes else None
        return CycleEvidence(equations, self.values, self.basis, self.penalty, self.shape, count, bordered_block)

    def _certified(self) -> tuple[bool, ...]:
        """Which frames are verified to be free of folds; the penalties of the others become stronger."""
        result = []
        for frame, (box, penalty) in enumerate(zip(self.boxes, self.penalties)):
            verified, penalty = penalty.check(box, self.surfaces)
            result.append(verified)
            if not verified:
                self.penalties[frame] = penalty.stronger()
        return tuple(result)
