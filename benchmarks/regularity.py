"""The paper's Figs. 11, 12 and 22 on a synthetic ventricle: what each regularity costs; docs/figures/regularity.png.

python benchmarks/regularity.py
"""

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import quadriform as qf
from quadriform.examples import ventricle

COUNTS = (90, 64, 40, 20)
STRENGTHS = (1e-8, 1e-6, 1e-4, 1e-2)
OUTPUT = Path(__file__).resolve().parents[1] / "docs" / "figures" / "regularity.png"


def run(regularity: str, settings: tuple[float, ...]) -> list[qf.Fit]:
    points = ventricle()
    return [qf.fit(points, method="paper", regularity=regularity, strength=value) for value in settings]


def main() -> None:
    results = {"singular values kept": run("svd", COUNTS), "springs on the displacement": run("springs", STRENGTHS)}
    figure = Figure(figsize=(13, 3.8))
    error, motion, both, history = figure.subplots(1, 4)
    for (name, fits), settings in zip(results.items(), (COUNTS, STRENGTHS)):
        errors = [fit.rms for fit in fits]
        moved = [fit.history[-1].box_displacement for fit in fits]
        print(f"\n| {name} | error RMS, mm | box moved, mm |\n| --- | --- | --- |")
        for value, e, m in zip(settings, errors, moved):
            print(f"| {value:g} | {e:.3f} | {m:.1f} |")
        error.semilogy(range(1, 5), errors, "o-", label=name)
        motion.semilogy(range(1, 5), moved, "o-", label=name)
        both.loglog(errors, moved, "o-", label=name)
        history.semilogy([record.surface_motion for record in fits[1].history], label=name)
    for axes, title, x, y in (
        (error, "Fig. 11 left", "setting, weak to strong", "error RMS, mm"),
        (motion, "Fig. 11 right", "setting, weak to strong", "box moved RMS, mm"),
        (both, "Fig. 12", "error RMS, mm", "box moved RMS, mm"),
        (history, "Fig. 22, second setting", "iteration", "surface motion RMS, mm"),
    ):
        axes.set(title=title, xlabel=x, ylabel=y)
        axes.grid(alpha=0.3)
    both.xaxis.set_minor_formatter(NullFormatter())
    error.yaxis.set_minor_formatter(NullFormatter())
    error.legend(fontsize=8)
    figure.tight_layout()
    OUTPUT.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(OUTPUT, dpi=80)


if __name__ == "__main__":
    main()
