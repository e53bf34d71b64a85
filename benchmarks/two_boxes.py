"""Both walls of a human ventricle in one control box against a box each: how many numbers, how far from the points.

python benchmarks/two_boxes.py
"""

from collections.abc import Iterator

from common import rms, table
from ventricles import FOLDER, SOURCE, contours

import quadriform as qf

FRAMES = (0, 9)
"""End of diastole, and about the end of systole."""


METHODS = {
    "default": {},
    "default at one strength, all points counted": {"strength": 1e-6, "robust": False},
    'method="paper"': {"method": "paper"},
}
"""The default estimates a strength and the outliers of each fit, so that its fits minimise different sums."""


def rows() -> Iterator[tuple]:
    for frame in FRAMES:
        points = contours(frame)
        for method, options in METHODS.items():
            together = qf.fit(points, **options)
            alone = {name: qf.fit(cloud, **options) for name, cloud in points.items()}
            errors = {name: rms(values) for name, values in together.residuals.items()}
            strengths = [together.strength] * 2, [alone[name].strength for name in ("endo", "epi")]
            yield row(frame, method, "one box", together.model.n_parameters, errors, strengths[0])
            count = sum(fit.model.n_parameters for fit in alone.values())
            errors = {name: rms(fit.residuals) for name, fit in alone.items()}
            yield row(frame, method, "a box each", count, errors, strengths[1])


def row(frame: int, method: str, boxes: str, count: int, errors: dict[str, float], strengths: list[float]) -> tuple:
    held = "" if "paper" in method else ", ".join(f"{strength:.1e}" for strength in dict.fromkeys(strengths))
    return frame, method, boxes, count, f"{errors['endo']:.3f}", f"{errors['epi']:.3f}", held


def main() -> None:
    if not FOLDER.is_dir():
        print("skipped: the contours of the human ventricle are not beside this repository")
        return
    print(
        f"## Two boxes against one (paper 3.4.2)\n\nHuman ventricle, one box for both walls and a box each. {SOURCE}\n"
    )
    table(("frame", "method", "boxes", "parameters", "endo RMS mm", "epi RMS mm", "strength"), rows())


if __name__ == "__main__":
    main()
