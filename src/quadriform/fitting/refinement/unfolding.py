"""Folds of the map found, located, and cured: the determinant is held above a floor where it falls below.

The data says where the surface is, and next to nothing about the space inside; there a fold can be pressed out almost
without moving the surface. More strength everywhere would press it out too, but at the price of the surface.
"""

from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from quadriform.fitting.least_squares.normal_equations import NormalEquations
from quadriform.fitting.refinement.multiresolution import Refined, Rounds
from quadriform.points import Array
from quadriform.shapes.closest import closest_on
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.fold_bound import determinant_rows, jacobian_bound, lattice_inside, never_folds
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

FLOOR, NEAR_FLOOR = 0.1, 0.03
"""Determinants are pressed up to the first, 1 being no change of volume; above the second a proof is worth trying."""
FIRST_PRESS, HARDER, MOST_PRESSES = 1e-3, 2.0, 30
"""The pressure on a place begins with this share of all the data's, and grows by this factor from round to round."""
LATTICE, GRID, FINE_LATTICE, FINE_GRID = 21, 12, 45, 32
STRONGEST, DESCENT, PRESSES = 1e3, 8, 4
AFFINE = 1e3
"""A strength at which the data bends nothing."""
PRICE, CHEAP = 1.5, 0.025
"""A cure is worse than the fold when it makes the noise this many times larger, and larger than this share of the
cloud's RMS radius."""


@dataclass(frozen=True)
class Floor:
    """Pressure where the determinant falls below the floor: weight (FLOOR - det)^2 over the places below it.

    Attributes:
        places: (n, 3) points before deformation where the determinant is watched.
        weight: of a place.
    """

    places: Array
    weight: float

    @classmethod
    def under(cls, box: ControlBox, surfaces: Mapping[str, Superquadric], weight: float) -> "Floor":
        """Watched on a lattice inside the surfaces and on them."""
        grids = [surface.grid(GRID)[0] for surface in surfaces.values()]
        return cls(np.concatenate([lattice_inside(box, list(surfaces.values()), LATTICE), *grids]), weight)

    def lowest(self, box: ControlBox) -> float:
        """The smallest determinant at the places."""
        return float(self._determinants(box).min())

    def equations(self, box: ControlBox) -> NormalEquations:
        """The pressure, linear about a box, in the displacement of the control points from rest."""
        determinants = self._determinants(box)
        low = determinants < FLOOR
        rows = determinant_rows(box, self.places[low]) if low.any() else np.empty((0, box.control_points.size))
        wanted = FLOOR - determinants[low] + rows @ (box.control_points - box.rest).ravel()
        return NormalEquations.of_rows(rows, wanted, self.weight)

    def cost(self, box: ControlBox) -> float:
        """The pressure itself."""
        return self.weight * float((np.maximum(FLOOR - self._determinants(box), 0) ** 2).sum())

    def harder(self) -> "Floor":
        """With more weight."""
        return replace(self, weight=HARDER * self.weight)

    def with_places(self, places: Array) -> "Floor":
        """Watched at more places (m, 3)."""
        return replace(self, places=np.concatenate([self.places, places]))

    def _determinants(self, box: ControlBox) -> Array:
        return box.stretch(self.places)


def fair_price(refined: Refined) -> float:
    """The noise at which a cure is worse than the fold."""
    return max(PRICE * refined.solution.noise, CHEAP)


def least_regularised(rounds: Rounds, refined: Refined, surfaces: dict[str, Superquadric]) -> Refined | None:
    """The certified refinement of least noise on the way from an affine map to the strength of a folded refinement.

    For points that are no surface, such as those of a filled volume: their folded fit is useless at any noise. The
    search begins at the undeformed superquadrics, at a strength under which no map but an affine one is left, and ends
    before the first fold. None where the undeformed superquadrics cross.
    """
    unfolded, best = _at_rest(refined), None
    floor = Floor.under(refined.box, surfaces, _first_weight(refined))
    decades = int(np.ceil(np.log10(AFFINE / refined.solution.strength)))
    for strength in np.geomspace(AFFINE, refined.solution.strength, max(decades, 0) + 1):
        unfolded, above = _lifted(rounds, rounds.weighed(unfolded), floor, float(strength))
        if not above or not certified(unfolded.box, surfaces):
            break
        if best is None or unfolded.solution.noise < best.solution.noise:
            best = _copied(unfolded)
    return best


def cures(rounds: Rounds, refined: Refined, surfaces: dict[str, Superquadric], most: float) -> Iterator[Refined]:
    """What is certified not to fold inside the surfaces, with a noise of at most `most`.

    The given refinement itself if that is so; else with its folds pressed out, from where it is and from rest: the rest
    first where it is tangled, for then its foot points lead astray.
    """
    floor = Floor.under(refined.box, surfaces, _first_weight(refined))
    fair = refined.solution.noise <= most
    if fair and floor.lowest(refined.box) > NEAR_FLOOR and certified(refined.box, surfaces):
        yield refined
    ways = (_at_rest, _copied) if refined.tangled else (_copied, _at_rest)
    for way in ways:
        cured = _descended(rounds, way(refined), floor, surfaces, most)
        if cured is not None:
            yield cured


def _first_weight(refined: Refined) -> float:
    """Weight of the Jacobian penalty at a place in the first round."""
    return FIRST_PRESS * sum(len(sheet.points) for sheet in refined.sheets) * (refined.solution.noise / FLOOR) ** 2


def _descended(
    rounds: Rounds, refined: Refined, floor: Floor, surfaces: dict[str, Superquadric], most: float
) -> Refined | None:
    """From a strength under which nothing folds down to the wanted one, the floor always held.

    Where the wanted one is too weak, pressure tears the surface off the data: then the weakest on the way that is
    certified will do. None without success.
    """
    strength, found = refined.solution.strength, None
    for harder in np.geomspace(STRONGEST, 1, DESCENT):
        refined, unfolded = _lifted(rounds, refined, floor, harder * strength)
        if unfolded and refined.solution.noise <= most and certified(refined.box, surfaces):
            found = _copied(refined)
        if harder == STRONGEST:
            most = min(most, refined.solution.noise)
    for _ in range(MOST_PRESSES):
        if refined.solution.noise > most:
            break
        if floor.lowest(refined.box) > NEAR_FLOOR:
            if certified(refined.box, surfaces):
                return refined
            floor = floor.with_places(low_places(refined.box, surfaces))
        pressed = rounds.pressed(refined, floor, strength)
        if pressed is None:
            break
        refined, floor = pressed, floor.harder()
    return found


def _lifted(rounds: Rounds, refined: Refined, floor: Floor, strength: float) -> tuple[Refined, bool]:
    """The refinement after a few rounds under pressure at one strength, and whether it is above the floor then."""
    for _ in range(PRESSES):
        pressed = rounds.pressed(refined, floor, strength)
        if pressed is None:
            return refined, False
        refined = pressed
        if floor.lowest(refined.box) > NEAR_FLOOR:
            return refined, True
    return refined, False


def _copied(refined: Refined) -> Refined:
    """The same with sheets whose foot points can slide without those of the given ones."""
    return replace(refined, sheets=tuple(copy(sheet) for sheet in refined.sheets))


def _at_rest(refined: Refined) -> Refined:
    """The undeformed box, and the foot points of the undeformed surfaces."""
    rest = _copied(replace(refined, box=refined.box.with_control_points(refined.box.rest)))
    for sheet in rest.sheets:
        sheet.origins = closest_on(sheet.superquadric, rest.box, sheet.points).origins
    return rest


def certified(box: ControlBox, surfaces: Mapping[str, Superquadric]) -> bool:
    """Whether the map provably does not fold inside the surfaces and no mesh of them crosses."""
    return never_folds(box, surfaces.values()) and not DeformableModel(dict(surfaces), box).crossings()


def low_places(box: ControlBox, surfaces: Mapping[str, Superquadric]) -> Array:
    """More places to be watched: low ones of finer lattices, and some around the lowest that the proof met."""
    inside = [lattice_inside(box, list(surfaces.values()), FINE_LATTICE)]
    fine = np.concatenate([*inside, *(surface.grid(FINE_GRID)[0] for surface in surfaces.values())])
    low = fine[box.stretch(fine) < NEAR_FLOOR]
    steps = np.linspace(-1, 1, 5) / FINE_LATTICE
    cluster = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3) @ box.edges
    return np.concatenate([jacobian_bound(box, surfaces.values()).where + cluster, low])
