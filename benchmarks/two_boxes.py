"""Both walls of a human ventricle in one control box against a box each: how many numbers, how far from the points.

python benchmarks/two_boxes.py
"""

from collections.abc import Iterator

from common import rms, table
from ventricles import FOLDER, SOURCE, contours

import quadriform as qf

FRAMES = (0, 9)
"""End of diastole, and about the end of systole."""


def rows() -> Iterator[tuple]:
    for frame in FRAMES:
        points = contours(frame)
        together = qf.fit(points)
        alone = {name: qf.fit(cloud) for name, cloud in points.items()}
        errors = {name: rms(values) for name, values in together.residuals.items()}
        yield row(frame, "one box", together.model.n_parameters, errors)
        count = sum(fit.model.n_parameters for fit in alone.values())
        yield row(frame, "a box each", count, {name: rms(fit.residuals) for name, fit in alone.items()})


def row(frame: int, boxes: str, count: int, errors: dict[str, float]) -> tuple:
    return frame, boxes, count, f"{errors['endo']:.3f}", f"{errors['epi']:.3f}"


def main() -> None:
    if not FOLDER.is_dir():
        print("skipped: the contours of the human ventricle are not beside this repository")
        return
    print(f"## Human ventricle, one box for both walls and a box each. {SOURCE}\n")
    table(("frame", "boxes", "numbers", "endo RMS mm", "epi RMS mm"), rows())


if __name__ == "__main__":
    main()
