"""Rate against distortion: RMS of points to the surface against the parameters stored, a table and a plot.

python benchmarks/rate_distortion.py

Ours with 3, 5 and 7 control points a side, spherical harmonics, decimated Poisson meshes. The egg is fitted to
6,000 noisy points and judged by its clean ones; kidney and brain are judged by the points that they were fitted to.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from common import REPOSITORY, SHARED, bench_data, one_thread, rms, table
from comparing import baselines
from comparing.harness import Missing

import quadriform as qf
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.reading import example_volume
from quadriform.shapes.directions import sphere_grid
from quadriform.shapes.mesh import split_quads

SIDES, DEGREES, FACES = (3, 5, 7), (2, 4, 6, 9, 12, 16, 20), (50, 100, 250, 700, 2_000, 6_000)
FIGURE = REPOSITORY / "docs" / "figures" / "rate_distortion.png"
HEADER = ("body", "way", "parameters stored", "RMS")
Measured = tuple[str, str, int, float]


def bodies() -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Name, points to fit, points to judge by; what is not there is said and skipped."""
    folder = bench_data("surfaces")
    if folder is not None:
        egg = np.load(folder / "data" / "egg.npz")
        yield "egg, % of its length", egg["p6000"], egg["true_dense"]
    kidney = SHARED / "data" / "organs" / "VH_F_kidney_capsule_L_mm.ply"
    if kidney.is_file():
        points = qf.read_points(kidney)
        yield "kidney, mm", points, points
    else:
        print("skipped: the kidney is not beside this repository")
    points = points_from_image(example_volume(), select="otsu", closing=2, border="close").points
    yield "brain, mm", points, points


def off(judge: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> float:
    """RMS distance of points to a mesh."""
    squares = baselines.load("igl").point_mesh_squared_distance(
        judge, np.ascontiguousarray(vertices), faces.astype(np.int64)
    )
    return rms(np.sqrt(squares[0]))


def ours(name: str, points: np.ndarray, judge: np.ndarray) -> Iterator[Measured]:
    for side in SIDES:
        with one_thread():
            model = qf.fit(points, box=(side,) * 3).model
        mesh = model.mesh(resolution=64)
        yield name, f"quadriform, {side} a side", model.n_parameters, off(judge, mesh.vertices, mesh.faces)


def harmonics(name: str, points: np.ndarray, judge: np.ndarray) -> Iterator[Measured]:
    directions, quads = sphere_grid(64)
    for degree in DEGREES:
        vertices = baselines.harmonics(points, degree, directions)
        error = off(judge, vertices, split_quads(quads, vertices))
        yield name, f"spherical harmonics, degree {degree}", (degree + 1) ** 2 + 3, error


def decimated(name: str, points: np.ndarray, judge: np.ndarray) -> Iterator[Measured]:
    try:
        surface = baselines.poisson(points)
        for faces in FACES:
            vertices, kept = baselines.decimated(surface, faces)
            yield name, f"decimated Poisson mesh, {len(kept):,} faces", vertices.size, off(judge, vertices, kept)
    except Missing as error:
        print(f"skipped: decimated meshes of {name}: {error}")


def printed() -> list[Measured]:
    """All ways of all bodies, printed as they come."""
    found: list[Measured] = []

    def rows_coming() -> Iterator[tuple[str, ...]]:
        for body in bodies():
            for way in (ours, harmonics, decimated):
                for measured in way(*body):
                    found.append(measured)
                    yield from rows([measured])

    print("\n## Rate against distortion\n")
    try:
        table(HEADER, rows_coming())
    except Missing as error:
        print(f"skipped: {error}")
    return found


def rows(found: Iterable[Measured]) -> Iterator[tuple[str, ...]]:
    """Cells of the table."""
    return ((body, way, f"{numbers:,}", f"{error:.3g}") for body, way, numbers, error in found)


def measured(cells: Iterable[Iterable[str]]) -> list[Measured]:
    """The rows of a table as they were measured, to three digits."""
    return [(body, way, int(count.replace(",", "")), float(error)) for body, way, count, error in cells]


def draw(found: list[Measured], path: Path = FIGURE) -> None:
    """One panel a body, one line a way."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(body for body, *_ in found))
    figure = Figure(figsize=(4 * len(names), 3.6), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names):
        for way, marker in (("quadriform", "o"), ("spherical harmonics", "s"), ("decimated Poisson mesh", "^")):
            points = [(n, error) for body, label, n, error in found if body == name and label.startswith(way)]
            if points:
                axes.loglog(*zip(*points), marker=marker, label=way)
        axes.set(title=name, xlabel="parameters stored", ylabel="RMS to the surface")
        axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize="small")
    figure.savefig(path, dpi=110)


def main() -> None:
    found = printed()
    if found:
        draw(found)


if __name__ == "__main__":
    main()
