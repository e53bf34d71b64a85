"""The deformable model: superquadric surface(s) carried by one control box (paper 3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadriform.errors import OptionError
from quadriform.points import Array, check_points
from quadriform.shapes import fold_bound
from quadriform.shapes.closest import FootPoints, closest_on
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.crossings import crossings
from quadriform.shapes.landmarks import NONE_KNOWN, Landmarks
from quadriform.shapes.mesh import Mesh, richardson, split_quads
from quadriform.shapes.posterior import STEP, Posterior
from quadriform.shapes.record import ModelRecord, Recorded
from quadriform.shapes.spaces import rotation_between
from quadriform.shapes.superquadric import Superquadric
from quadriform.words import listed, summary


@dataclass(frozen=True, repr=False)
class DeformableModel(Recorded):
    """Named superquadrics in one box of control points.

    Attributes:
        surfaces: name -> superquadric before deformation; a single one is called "surface". Methods without a name take
            the first.
        box: the deformation, the same for all surfaces.
        space: the frame of the world coordinates: "LPS", "RAS" or "unknown".
        unit: "mm", "m" or "unknown".
        input_sha256: hash of the input that the model was fitted to, empty for models built by hand.
        record: status, warnings and sources of its fit; "unknown" for models built by hand.
        landmarks: of a ventricle, above all the base below which its volumes count.
        posterior: samples of its control points, given the data; None where they are not known.
    """

    surfaces: dict[str, Superquadric]
    box: ControlBox
    space: str = "unknown"
    unit: str = "unknown"
    input_sha256: str = ""
    record: ModelRecord = field(default_factory=ModelRecord)
    landmarks: Landmarks = NONE_KNOWN
    posterior: Posterior | None = None

    def __repr__(self) -> str:
        counts = " x ".join(map(str, self.box.control_points.shape[:3]))
        title = f"DeformableModel: {counts} control points, {self.n_parameters} parameters"
        return summary(title, f"status {self.status}, space {self.space}, unit {self.unit}", *lines_of(self.surfaces))

    def __post_init__(self) -> None:
        if not self.surfaces:
            raise OptionError("surfaces: expected at least one named superquadric")

    @property
    def n_parameters(self) -> int:
        """The number of parameters: 11 of each superellipsoid (12 of a toroid) and 3 of each control point."""
        return sum(len(s.parameters) for s in self.surfaces.values()) + self.box.control_points.size

    def transformed(self, scale: float, offset: Array) -> DeformableModel:
        """The same model after `scale` x + `offset`: from a centred, scaled frame back to the world."""
        surfaces = {name: s.transformed(scale, offset) for name, s in self.surfaces.items()}
        landmarks = self.landmarks.transformed(scale, offset)
        posterior = None if self.posterior is None else self.posterior.scaled(scale)
        box = self.box.transformed(scale, offset)
        return replace(self, surfaces=surfaces, box=box, landmarks=landmarks, posterior=posterior)

    def in_space(self, space: str) -> DeformableModel:
        """The same model in another frame of the world, "LPS" or "RAS": a half-rotation about z lies between them.

        Raises:
            OptionError: another frame.
            InputError: the model's own is unknown.
        """
        rotation = rotation_between(self.space, space)
        surfaces = {name: s.rotated(rotation) for name, s in self.surfaces.items()}
        return replace(
            self,
            surfaces=surfaces,
            box=self.box.rotated(rotation),
            space=space,
            landmarks=self.landmarks.rotated(rotation),
            posterior=None if self.posterior is None else self.posterior.rotated(rotation),
        )

    def samples(self, step: float = 1.0) -> list[DeformableModel]:
        """A model for each sample of the posterior, without a posterior of its own; empty where that is not known.

        Args:
            step: fraction of the deviations from the estimate.
        """
        boxes = [] if self.posterior is None else self.posterior.boxes(self.box, step)
        return [replace(self, box=box, posterior=None) for box in boxes]

    def deviation_of(self, measure: Callable[[DeformableModel], float]) -> float | None:
        """The standard deviation of a measure of the model, by its posterior; None where that is not known."""
        found = [measure(sample) for sample in self.samples(STEP)]
        return float(np.std(found, ddof=1)) / STEP if len(found) > 1 else None

    def superquadric(self, surface: str | None = None) -> Superquadric:
        """The undeformed superquadric of a surface, given by name; without a name the first.

        Raises:
            OptionError: unknown name.
        """
        name = next(iter(self.surfaces)) if surface is None else surface
        if name not in self.surfaces:
            raise OptionError(f"surface={name!r} is unknown; expected one of {', '.join(map(repr, self.surfaces))}")
        return self.surfaces[name]

    def mesh(self, surface: str | None = None, resolution: int = 24) -> Mesh:
        """The triangle mesh of a deformed surface; `resolution` as in `Superquadric.mesh`."""
        before, quads = self.superquadric(surface).grid(resolution)
        vertices = self.box.deform(before)
        return Mesh(vertices, split_quads(quads, vertices))

    def deform(self, points: ArrayLike) -> Array:
        """The world points (n, 3) after the volumetric deformation.

        Raises:
            PointsError: points so far outside the box that they are deformed beyond 1e30.
        """
        return check_points(self.box.deform(points), "deformed points")

    def undeform(self, points: ArrayLike) -> Array:
        """The world points (n, 3) before deformation: the inverse of `deform`."""
        return self.box.undeform(points)

    def foot_points(self, points: ArrayLike, surface: str | None = None) -> FootPoints:
        """The closest surface points to world points (n, 3), with their normals and signed distances."""
        return closest_on(self.superquadric(surface), self.box, check_points(points))

    def closest(self, points: ArrayLike, surface: str | None = None) -> Array:
        """The closest points (n, 3) of a surface to world points (n, 3)."""
        return self.foot_points(points, surface).points

    def distance(self, points: ArrayLike, surface: str | None = None) -> Array:
        """Signed distances (n,) of world points (n, 3) to a surface, in the unit of the model; negative inside."""
        return self.foot_points(points, surface).signed

    def contains(self, points: ArrayLike, surface: str | None = None) -> NDArray[np.bool_]:
        """A mask (n,) of the world points (n, 3) that lie inside a closed surface."""
        return self.distance(points, surface) < 0

    def volume(self, surface: str | None = None) -> float:
        """Enclosed volume in cubed units, from two meshes by Richardson's extrapolation."""
        return richardson(*(self.mesh(surface, n).volume() for n in (32, 64)))

    def area(self, surface: str | None = None) -> float:
        """Area of a surface in squared units, from two meshes by Richardson's extrapolation."""
        return richardson(*(self.mesh(surface, n).area() for n in (32, 64)))

    def min_jacobian(self) -> float:
        """A proven lower bound of det(d deformed / d point) over the inside of the surfaces; positive: no fold."""
        return fold_bound.determinant_lower_bound(self.box, self.surfaces.values())

    def folds(self) -> Array:
        """Points (n, 3) of the inside, before deformation, where det(d deformed / d point) is not positive.

        Returns:
            An empty array when a bound proves that there are none. Otherwise the first point has the lowest determinant
            that was found; where neither a proof nor a fold was found it is the only one, and its determinant is
            positive.
        """
        return fold_bound.possible_folds(self.box, self.surfaces.values())

    def crossings(self, resolution: int = 24) -> dict[tuple[str, str], Array]:
        """Points (n, 3) where surfaces cross themselves, (a, a), or each other, (a, b); empty when none does.

        Args:
            resolution: of the meshes that are tested, as in `mesh`; crossings finer than their cells can be missed.
        """
        meshes = {name: self.mesh(name, resolution) for name in self.surfaces}
        found = {(name, name): crossings(mesh) for name, mesh in meshes.items()}
        found |= {(a, b): crossings(meshes[a], meshes[b]) for a, b in combinations(meshes, 2)}
        return {pair: points for pair, points in found.items() if len(points)}

    def nesting(self, resolution: int = 24) -> dict[tuple[str, str], str]:
        """The relation of each pair (a, b) of closed surfaces: a is "around" b, "inside" b, "apart" or "crossing"."""
        crossed = self.crossings(resolution)
        result = {}
        for a, b in combinations(self.surfaces, 2):
            one, two = (self.mesh(name, 2).vertices[:1] for name in (a, b))
            if (a, b) in crossed:
                result[a, b] = "crossing"
            elif self.contains(two, a)[0]:
                result[a, b] = "around"
            else:
                result[a, b] = "inside" if self.contains(one, b)[0] else "apart"
        return result


def lines_of(surfaces: Mapping[str, Superquadric]) -> list[str]:
    """A line of text for each surface: its name, kind and semi-axes."""
    return [f"{name}: {surface.kind} with semi-axes {listed(surface.semi_axes)}" for name, surface in surfaces.items()]
