"""Drawings of a report: histogram, curves, and the bullseye of the seventeen segments."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from quadriform.fitting.result import Iteration
from quadriform.points import Array
from quadriform.report.parts import legend, svg
from quadriform.report.slices import COLOURS

GREY = "#57606a"
RINGS = ((0, 6, 60.0), (6, 6, 60.0), (12, 4, 45.0), (16, 1, 0.0))
"""Rings from base to apex (Cerqueira et al. 2002): index of the first segment, number of segments, and the angle where
the first begins, in degrees."""


def _axes(**labels: str) -> Any:
    """Axes that are as wide as a phone, so that their text is never drawn smaller than it is."""
    from matplotlib.figure import Figure

    axes = Figure(figsize=(3.8, 2.6)).subplots()
    axes.set(**labels)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def histogram(residuals: Mapping[str, Array], unit: str, voxel: float | None) -> Markup:
    """Signed distances of the data points, surface by surface, with half a voxel to either side where there is one."""
    axes = _axes(xlabel=f"signed distance, {unit} (negative: inside)", ylabel="points")
    # one far outlier would leave all other distances in a single bin
    most = float(np.percentile(np.abs(np.concatenate(list(residuals.values()))), 99.5)) or 1.0
    bins = np.linspace(-most, most, 41)  # outliers are clipped into the outermost bins
    for colour, values in zip(COLOURS, residuals.values()):
        axes.hist(np.clip(values, -most, most), bins.tolist(), histtype="stepfilled", alpha=0.55, color=colour)
    entries = list(zip(residuals, COLOURS))
    if voxel is not None:
        entries.append(("dashed: half a voxel", GREY))
        for side in (-voxel / 2, voxel / 2):
            axes.axvline(side, color=GREY, ls="--", lw=1)
    return svg(axes.figure, f"Histogram of the signed distances of the data points in {unit}") + legend(entries)


def convergence(history: Sequence[Iteration], unit: str) -> Markup:
    """Error, motion of the surface and displacement of the box over the iterations."""
    axes = _axes(xlabel="iteration", ylabel=unit, yscale="log")
    numbers = np.arange(1, len(history) + 1)
    names = ("error", "surface_motion", "box_displacement")
    for colour, name in zip(COLOURS, names):
        values = np.array([getattr(one, name) for one in history])
        # a step of zero length has no logarithm
        axes.plot(numbers, np.maximum(values, 1e-12), color=colour)
    key = legend((name.replace("_", " "), colour) for name, colour in zip(names, COLOURS))
    return svg(axes.figure, "Error, surface motion and box displacement over the iterations") + key


def curve(
    times: Array, values: Array, quantity: str, unit: str, labels: Mapping[str, int], sd: Array | None = None
) -> Markup:
    """A quantity over the cycle, with frames labelled by name, and with error bars of two standard deviations."""
    axes = _axes(xlabel="time", ylabel=unit)
    axes.set_title(quantity, fontsize=10)
    axes.plot(times, values, color="#0550ae", marker=".")
    if sd is not None:
        axes.errorbar(times, values, 2 * sd, fmt="none", ecolor="#0550ae", elinewidth=1, capsize=2)
    for name, frame in labels.items():
        position = (float(times[frame]), float(values[frame]))
        axes.annotate(name, position, xytext=(0, 6), textcoords="offset points", ha="center")
    # room for the names of the frames above the curve
    axes.margins(y=0.2)
    bars = "" if sd is None else f", with error bars of two standard deviations, up to {2 * sd.max():.2g} {unit}"
    return svg(axes.figure, f"{quantity} over the cycle, from {values.min():.4g} to {values.max():.4g} {unit}{bars}")


def bullseye(values: Mapping[int, float], quantity: str, unit: str) -> Markup:
    """The seventeen segments, 1 to 17, as rings from base (outside) to apex; segments without a value stay white."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    axes: Any = Figure(figsize=(3.4, 3.6)).add_subplot(projection="polar")
    low, high = min(values.values()), max(values.values())
    scale = colormaps["cividis"]
    # ring 0, the base, is outermost: the disc is the ventricle seen from its apex
    for ring, (first, count, start) in enumerate(RINGS):
        inner, width = 3 - ring, 2 * np.pi / count
        for k in range(count):
            # angles run counter-clockwise from the right: 60 degrees is where the anterior segment begins
            left, value = np.radians(start) + k * width, values.get(first + k + 1, np.nan)
            fraction = (value - low) / ((high - low) or 1.0)
            tone = scale(fraction) if np.isfinite(fraction) else "#fff"
            edge = "white" if count > 1 else "none"
            axes.bar(left, 1, width, inner, align="edge", edgecolor=edge, color=tone)
            if np.isfinite(fraction):
                at = (left + width / 2, inner + 0.5) if count > 1 else (0.0, 0.0)
                # the colour map is dark below, so that the text must be white there
                ink = "#fff" if fraction < 0.55 else "#000"
                axes.text(*at, f"{value:.3g}", ha="center", va="center", fontsize=9, color=ink)
    axes.set_axis_off()
    axes.set_title(f"{quantity}, {unit}", fontsize=10)
    words = ", ".join(f"segment {number} {value:.3g}" for number, value in sorted(values.items()))
    return svg(axes.figure, f"Bullseye of {quantity} in {unit}: {words}")
