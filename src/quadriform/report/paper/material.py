"""All fits of the page; each is made when a figure first needs it, and shared by its figures."""

from functools import cached_property
from pathlib import Path

from quadriform import examples
from quadriform.report.paper import scans
from quadriform.report.paper.convergence import Convergence, measure_convergence
from quadriform.report.paper.kinds import Kinds, measure_kinds
from quadriform.report.paper.robustness import Matching, Robustness, measure_matchings, measure_robustness
from quadriform.report.paper.subjects import SYNTHETIC, Box, Sparse, Subject, Walls, fitted
from quadriform.report.paper.trade_off import TradeOff, measure_trade_off


class Material:
    """Data and fits of the figures, computed when a figure first needs them."""

    def __init__(self, folder: Path | None = None, box: Box = (5, 5, 5)) -> None:
        """Keep the options; nothing is read yet.

        Args:
            folder: of real hearts; None does without.
            box: control points of every model along each axis.
        """
        self.folder, self.box = folder, box

    @property
    def real(self) -> bool:
        """Whether real hearts were given."""
        return self.folder is not None

    @cached_property
    def crossing(self) -> Subject:
        """The paper's synthetic example."""
        return fitted("three crossing tapered superquadrics", SYNTHETIC, examples.crossing_superquadrics(), self.box)

    @cached_property
    def sparse(self) -> Sparse:
        """A synthetic ventricle of 6,146 points, and what is left of it (p. 45)."""
        points = examples.noisy(examples.ventricle())
        return self._reduced(fitted("synthetic ventricle", SYNTHETIC, points, self.box), 600, 900)

    @cached_property
    def sparse_heart(self) -> Sparse | None:
        """A real heart reduced like `sparse`, in the paper's proportions; None without real hearts."""
        if not self.real:
            return None
        whole = self.third.subject
        return self._reduced(whole, len(whole.cloud) // 10, 3 * len(whole.cloud) // 20)

    def _reduced(self, whole: Subject, on_planes: int, on_grid: int) -> Sparse:
        planes, grid = examples.three_planes(whole.cloud, on_planes), examples.regular_grid(whole.cloud, on_grid)
        return Sparse(
            whole,
            fitted("three planes", whole.source, planes, self.box),
            fitted("regular grid", whole.source, grid, self.box),
        )

    @cached_property
    def matchings(self) -> dict[str, Matching]:
        """Both directions of matching."""
        return measure_matchings(self.box)

    @cached_property
    def kinds(self) -> Kinds:
        """The three other kinds of superquadric."""
        return measure_kinds(self.box)

    @cached_property
    def trade_off(self) -> TradeOff:
        """What each regularity costs."""
        return measure_trade_off(self.box)

    @cached_property
    def robustness(self) -> Robustness:
        """Errors with more and more outliers."""
        return measure_robustness(self.box)

    @cached_property
    def first(self) -> scans.Scan:
        """In the place of the paper's first image, SPECT of 64 x 64 x 64 voxels."""
        return scans.spect(self.folder, 1, self.box) if self.folder else scans.brain(self.box)

    @cached_property
    def second(self) -> scans.Scan:
        """In the place of the paper's second image, coarser SPECT."""
        return scans.spect(self.folder, 2, self.box) if self.folder else scans.coarse_brain(self.box)

    @cached_property
    def third(self) -> scans.Scan:
        """In the place of the paper's third image, of the Dynamic Spatial Reconstructor."""
        return scans.pig(self.folder, self.box) if self.folder else scans.scanner(self.box)

    @cached_property
    def walls(self) -> Walls:
        """Both walls of a ventricle in one box, and in a box each."""
        return scans.human_walls(self.folder, self.box) if self.folder else scans.scanner_walls(self.box)

    @cached_property
    def convergence(self) -> list[Convergence]:
        """The four sets of data of Fig. 22, iterated to the end."""
        subjects = (self.crossing, *(scan.subject for scan in (self.first, self.second, self.third)))
        return [measure_convergence(subject, self.box) for subject in subjects]
