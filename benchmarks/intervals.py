"""Whether the intervals of clinical measures contain the truth as often as they state: hearts with known walls.

python benchmarks/intervals.py [kinds...] [--hearts N] [--cases]

Contours of both phases of hearts that no prior is learned from (bench/hearts), by `track` with slices; the kind
`three`, long axes alone, by `fit` of each phase. Kinds that end in `-prior` are fitted by `track` with a prior of other
hearts. Volumes and mass are compared below planes that all of the true walls reach, with those of the true walls; the
thickness of the wall with that by `measure` of a model of many points of the true walls without noise. It depends on
the lines that it is measured along, which no surface shows, so that this model's own standard deviation counts too.
"""

import argparse
import os
from collections.abc import Iterator, Mapping, Sequence
from types import ModuleType
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from common import SHARED, table
from generalisation.learned import learned_prior
from generalisation.rows import Missing, bench_module, present

import quadriform as qf
from quadriform.heart.volumes import DENSITY, volume_below
from quadriform.points import unit_vectors
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.record import Estimate

PHASES, WALLS = ("ed", "es"), ("endo", "epi")
PRIOR = "-prior"
KINDS = ("aligned", "moved", "three", "moved-prior", "three-prior", "two-prior")
SUBJECTS = range(500, 1000)
HEARTS = 20
LEVEL = 0.95
QUANTITIES = ("ejection fraction", "end-diastolic volume", "myocardial mass", "wall thickness, end diastole")
ALONG_EDGES = (1 / 6, 1 / 2, 5 / 6)
"""Where on the edges of the true walls the points of the model without noise are."""


class Error(NamedTuple):
    """The error of a measure of one heart, and its standard deviation.

    Attributes:
        subject: number of the heart.
        quantity: of the measures.
        error: estimate minus truth.
        sd: stated, and that of a truth by a model.
        covered: whether the interval contains the truth.
    """

    subject: int
    quantity: str
    error: float
    sd: float
    covered: bool


Walls = Mapping[str, tuple[np.ndarray, np.ndarray]]
"""Name -> vertices and faces of a wall."""


def base_plane(bench: ModuleType, subject: int, phase: str) -> BasePlane:
    """The plane along the true base below which both walls are whole."""
    point, direction = bench.base(subject, phase)
    walls = bench.heart(subject, phase).values()
    rims = np.concatenate([vertices[np.unique(bench.rim(faces))] for vertices, faces in walls])
    return BasePlane(point + ((rims - point) @ direction).min() * direction, direction)


def true_volume(vertices: np.ndarray, faces: np.ndarray, plane: BasePlane) -> float:
    """Volume in ml, below a plane, of the surface that points on the edges of a mesh are on.

    The contours are cut from the edges of flat triangles. These lie inside the smooth surface through the vertices,
    and the points on the edges between both: with edges of the length h and the curvature c, triangles lie c h^2 / 8
    below it in the mean, edges c h^2 / 12. So a third of the volume between triangles and smooth surface counts, and
    the mesh whose edges are halved along that surface has three quarters of it.
    """
    flat, halved = (
        abs(volume_below(mesh, plane)) for mesh in (qf.Mesh(vertices, faces), halved_edges(vertices, faces))
    )
    return (flat + (halved - flat) * 4 / 9) / 1000


def halved_edges(vertices: np.ndarray, faces: np.ndarray) -> qf.Mesh:
    """Four triangles for each, whose new vertices lie on cubic curves along the edges that the normals determine.

    Vlachos et al., Curved PN triangles, Proc. Symposium on Interactive 3D Graphics 2001: 159-166.
    """
    vectors = np.zeros_like(vertices)
    np.add.at(vectors, faces.ravel(), np.repeat(qf.Mesh(vertices, faces).area_vectors(), 3, axis=0))
    normals = unit_vectors(vectors)
    every = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, index = np.unique(np.sort(every, axis=1), axis=0, return_inverse=True)
    (a, b), (at_a, at_b) = vertices[edges.T], normals[edges.T]
    bulge = np.einsum("ij,ij->i", b - a, at_a)[:, None] * at_a - np.einsum("ij,ij->i", b - a, at_b)[:, None] * at_b
    middle = index.reshape(-1, 3) + len(vertices)
    corners = [np.stack([faces[:, k], middle[:, k], middle[:, k - 1]], axis=1) for k in range(3)]
    return qf.Mesh(np.concatenate([vertices, (a + b) / 2 - bulge / 8]), np.concatenate([*corners, middle]))


def points_on_edges(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Points (n, 3) on all edges of a mesh."""
    every = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    a, b = vertices[np.unique(np.sort(every, axis=1), axis=0).T]
    return np.concatenate([a + part * (b - a) for part in ALONG_EDGES])


def true_measures(bench: ModuleType, subject: int, planes: Sequence[BasePlane]) -> dict[str, Estimate]:
    """Quantity -> its value for the true walls."""
    hearts = [bench.heart(subject, phase) for phase in PHASES]
    volumes = [{name: true_volume(*heart[name], plane) for name in WALLS} for heart, plane in zip(hearts, planes)]
    before, after = (each["endo"] for each in volumes)
    exact = qf.track([{name: points_on_edges(*heart[name]) for name in WALLS} for heart in hearts])
    return {
        "ejection fraction": Estimate(100 * (1 - after / before), "%", sd=0.0),
        "end-diastolic volume": Estimate(before, "ml", sd=0.0),
        "myocardial mass": Estimate(DENSITY * (volumes[0]["epi"] - before), "g", sd=0.0),
        "wall thickness, end diastole": measured(exact.models, planes).estimate("wall thickness, end diastole"),
    }


def fitted(bench: ModuleType, kind: str, cases: Sequence[Any]) -> Sequence[qf.DeformableModel]:
    """The models of both phases."""
    points = [each.points for each in cases]
    if kind == "three":
        return [qf.fit(each).with_estimates().model for each in points]
    slices = None if kind.startswith(("two", "three")) else [each.slices for each in cases]
    return qf.track(points, slices=slices, prior=learned_prior(bench) if kind.endswith(PRIOR) else None).models


def measured(models: Sequence[qf.DeformableModel], planes: Sequence[BasePlane]) -> qf.Measures:
    """The measures below planes."""
    return qf.measure(models, base=[on_plane(plane) for plane in planes], ed=0)


def on_plane(plane: BasePlane) -> np.ndarray:
    """Four points (4, 3) around the point of a plane."""
    one = unit_vectors(np.cross(plane.direction, np.eye(3)[np.abs(plane.direction).argmin()]))
    other = np.cross(plane.direction, one)
    return plane.point + 30 * np.stack([one, other, -one, -other])


def errors(bench: ModuleType, kind: str, subject: int) -> list[Error]:
    """The errors of one heart."""
    cases = [bench.case(subject, phase, kind.removesuffix(PRIOR)) for phase in PHASES]
    planes = [base_plane(bench, subject, phase) for phase in PHASES]
    found, truth = measured(fitted(bench, kind, cases), planes), true_measures(bench, subject, planes)
    result = []
    for quantity in QUANTITIES:
        each, true = found.estimate(quantity), truth[quantity]
        error = Estimate(each.value - true.value, each.unit, sd=float(np.hypot(each.sd, true.sd)))
        low, high = error.interval(LEVEL)
        result.append(Error(subject, quantity, error.value, error.sd, low <= 0 <= high))
    return result


def lines(kind: str, every: Sequence[Error]) -> Iterator[tuple[str, ...]]:
    """For each quantity: hearts, mean and spread of the error, stated deviation, z = error / sd, and coverage."""
    for quantity in QUANTITIES:
        found = [each for each in every if each.quantity == quantity]
        error, sd = (np.array([getattr(each, name) for each in found]) for name in ("error", "sd"))
        z, stated = error / sd, np.sqrt((sd**2).mean())
        covered = 100 * np.mean([each.covered for each in found])
        numbers = (f"{error.mean():+.2f}", f"{error.std():.2f}", f"{stated:.2f}", f"{z.mean():+.2f}", f"{z.std():.2f}")
        yield kind, quantity, str(len(found)), *numbers, f"{covered:.0f}"


HEADER = ("kind", "measure", "hearts", "mean error", "SD of error", "stated SD", "mean z", "SD of z", "covered %")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", help=f"of {', '.join(KINDS)}; all unless given")
    parser.add_argument("--hearts", type=int, default=HEARTS, help="number of each kind")
    parser.add_argument("--cases", action="store_true", help="a table of all hearts as well")
    given = parser.parse_intermixed_args()
    try:
        bench = bench_module(SHARED, "hearts", "make_cases")
        present(bench.ATLAS)
    except Missing as reason:
        print(f"skipped: {reason}")
        return
    subjects = SUBJECTS[:: len(SUBJECTS) // given.hearts][: given.hearts]
    every = {kind: [each for s in subjects for each in errors(bench, kind, s)] for kind in given.kinds or KINDS}
    print(f"## Coverage of {100 * LEVEL:.0f} % intervals: volumes in ml, mass in g, thickness in mm, fractions in %\n")
    table(HEADER, [line for kind, found in every.items() for line in lines(kind, found)])
    if given.cases:
        print()
        cases = [(kind, *each) for kind, found in every.items() for each in found]
        table(("kind", *Error._fields), [(k, s, q, f"{e:+.2f}", f"{sd:.2f}", c) for k, s, q, e, sd, c in cases])


if __name__ == "__main__":
    main()
