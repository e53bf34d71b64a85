"""A beating human ventricle, both surfaces in one box: three ways to follow it, and contours that they have not seen.

python benchmarks/cycle.py

Each short-axis slice is left out in turn, in all frames; the distance of its points to the surfaces that the others
give is what counts. A left-out slice has no shift of its own.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from common import SHARED, rms, table

from quadriform.files.guide_points import read_guide_point_frames
from quadriform.heart.measure import measure
from quadriform.motion.track import Track
from quadriform.motion.tracking import track

FOLDER = SHARED / "data" / "human_lv_guidepoints"
SAX = range(2, 7)
WAYS = {"alone": ("alone", False), "previous": ("previous", False), "cycle": ("cycle", False)}
WAYS |= {"cycle, slices shifted": ("cycle", True)}
Frame = dict[str, np.ndarray]


def contours() -> tuple[list[Frame], list[Frame]]:
    """Endo- and epicardial points of all frames, LPS mm, and the slice number of each."""
    points, slices = [], []
    for path in sorted((FOLDER / "frames").glob("GPFile_*.txt")):
        fields = [line.split("\t") for line in path.read_text().splitlines()[1:] if line.strip()]
        chosen = {name: [f for f in fields if f"LV_{name.upper()}CARDIAL" in f[3]] for name in ("endo", "epi")}
        points.append({name: np.array([f[:3] for f in found], dtype=float) for name, found in chosen.items()})
        slices.append({name: np.array([int(f[4]) for f in found]) for name, found in chosen.items()})
    return points, slices


def followed(way: str, without: int | None = None, box: int = 5) -> Track:
    points, slices = contours()
    if without is not None:
        kept = [{name: numbers != without for name, numbers in frame.items()} for frame in slices]
        points = [{n: cloud[keep[n]] for n, cloud in frame.items()} for frame, keep in zip(points, kept)]
        slices = [{n: numbers[keep[n]] for n, numbers in frame.items()} for frame, keep in zip(slices, kept)]
    strategy, shifted = WAYS[way]
    return track(points, strategy=strategy, slices=slices if shifted else None, box=(box, box, box))


def whole(way: str, box: int = 5) -> tuple:
    found, (points, _) = followed(way, box=box), contours()
    by_name = {name: rms(np.concatenate([frame[name] for frame in found.residuals])) for name in ("endo", "epi")}
    bounds = [model.min_jacobian() for model in found.models]
    crossed = sum(bool(model.crossings()) for model in found.models)
    still = [rms(model.distance(points[0][name], name)) for model in found.models[:1] for name in ("endo", "epi")]
    largest = max((np.linalg.norm(shift) for shift in found.shifts.values()), default=0.0)
    return (
        f"{way}, {box} x {box} x {box}",
        f"{found.rms:.3f}",
        f"{by_name['endo']:.2f}",
        f"{by_name['epi']:.2f}",
        f"{found.frame_rms.max():.2f}",
        " ".join(f"{value:.2f}" for value in still),
        f"{min(bounds):.3f}",
        crossed,
        f"{largest:.1f}",
        ", ".join(found.warnings) or "ok",
    )


def left_out(way_and_slice: tuple[str, int]) -> np.ndarray:
    """Mean squared distance of the unseen points of a slice, and their number, frame by frame (F, 2)."""
    way, number = way_and_slice
    found, (points, slices) = followed(way, number), contours()
    result = []
    for model, frame, numbers in zip(found.models, points, slices):
        unseen = [model.distance(frame[n][numbers[n] == number], n) for n in frame if (numbers[n] == number).any()]
        squares = np.concatenate([*unseen, np.zeros(0)]) ** 2
        result.append((squares.sum(), len(squares)))
    return np.array(result)


def ejection(way: str) -> tuple:
    """Ejection fractions with each frame's own mitral plane and with that of frame 9, and what a table tells."""
    found = followed(way)
    rings = [read.mitral for read in read_guide_point_frames(FOLDER / "frames")]
    own, fixed = measure(found.models, base=rings), measure(found.models, base=rings[9])
    volumes = own.curves["cavity volume"]
    return (
        way,
        f"{own['ejection fraction']:.1f}",
        f"{fixed['ejection fraction']:.1f}",
        f"{volumes.max():.0f}, {volumes.min():.0f}",
        f"{own.ed}, {own.es}",
        ", ".join(own.warnings) or "ok",
    )


def predictions(pool: ProcessPoolExecutor, ways: Sequence[str]) -> Iterator[tuple]:
    jobs = [(way, number) for way in ways for number in SAX]
    sums = dict(zip(jobs, pool.map(left_out, jobs)))
    for way in ways:
        each = [np.sqrt(sums[way, n][:, 0].sum() / sums[way, n][:, 1].sum()) for n in SAX]
        by_frame = sum(sums[way, n] for n in SAX)
        total = np.sqrt(by_frame[:, 0].sum() / by_frame[:, 1].sum())
        at = np.sqrt(by_frame[:, 0] / np.maximum(by_frame[:, 1], 1))
        yield (way, f"{total:.2f}", f"{at[0]:.2f}", f"{at[9]:.2f}", " ".join(f"{value:.2f}" for value in each))


def main() -> None:
    if not FOLDER.is_dir():
        print("skipped: the contours of the human ventricle are not beside this repository")
        return
    with ProcessPoolExecutor(2) as pool:
        print("## Whole cycle, RMS to all endo- and epicardial points, mm (required 1.15 without shifts)\n")
        header = ("strategy", "RMS", "endo", "epi", "worst frame", "frame 0, unshifted")
        jobs = [*((way, 5) for way in WAYS), ("cycle", 7)]
        table(
            (*header, "least bound of det J", "frames crossed", "largest shift", "warnings"),
            pool.map(whole, *zip(*jobs)),
        )
        print("\n## Ejection fraction, % (reference surfaces: 59.7 with own planes, 54.3 with that of frame 9)\n")
        header = ("strategy", "own mitral planes", "plane of frame 9", "EDV, ESV ml", "ED, ES frame", "warnings")
        table(header, pool.map(ejection, WAYS))
        print("\n## Left-out short-axis slices, RMS of their points, mm (required 2.2 over the cycle)\n")
        header = ("strategy", "over the cycle", "frame 0", "frame 9", f"slices {SAX[0]} to {SAX[-1]}")
        table(header, predictions(pool, [way for way in WAYS if way != "previous"]))


if __name__ == "__main__":
    main()
