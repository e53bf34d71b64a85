"""The loops over points, compiled; arrays are contiguous float64, those that are filled come after the points."""

import numpy as np
from numpy.typing import NDArray

from quadriform.points import Array

class Box:
    def __init__(self, origin: Array, to_local: Array, control_points: Array) -> None: ...

class Surface:
    def __init__(
        self,
        kind: NDArray[np.int32],
        semi_axes: Array,
        exponents: Array,
        rotation: Array,
        translation: Array,
        hole: float,
    ) -> None: ...

def deform(box: Box, points: Array, carried: Array, threads: int) -> None: ...
def jacobian(box: Box, points: Array, result: Array, threads: int) -> None: ...
def normals(box: Box, surface: Surface, origins: Array, points: Array, normals: Array, threads: int) -> None: ...
def update_foot_points(
    box: Box, surface: Surface, diagonal: float, targets: Array, origins: Array, steps: int, threads: int
) -> None: ...
def converge_foot_points(
    box: Box,
    surface: Surface,
    diagonal: float,
    targets: Array,
    origins: Array,
    points: Array,
    least: Array,
    weak: Array,
    steps: int,
    threads: int,
) -> None: ...
def distances(
    kind: NDArray[np.int32],
    semi_axes: Array,
    exponents: Array,
    rotations: Array,
    translations: Array,
    holes: Array,
    points: Array,
    result: Array,
    derivatives: Array,
) -> None: ...
