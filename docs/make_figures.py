"""The tutorials' pictures, drawn from what their own code computes; docs/figures/*.png.

python docs/make_figures.py
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import quadriform as qf
from quadriform.report.slices import slices_png
from quadriform.shapes.mesh import Mesh

DOCS = Path(__file__).resolve().parent
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def run(page: Path) -> dict:
    """Run the Python of a page from its beginning to its end; the names that it leaves."""
    names: dict = {}
    code = "\n".join(BLOCK.findall(page.read_text(encoding="utf-8")))
    exec(compile(code, page.name, "exec"), names)  # noqa: S102  our own pages
    return names


def without_axes(axes: Any, title: str) -> None:
    """The body alone, filling its axes."""
    axes.set_title(title)
    axes.set_axis_off()
    axes.set_box_aspect(axes.get_box_aspect(), zoom=1.3)


def points_to_model(names: dict) -> bytes | Figure:
    fit, points, sigma = names["fit"], names["points"], names["sigma"]
    figure = Figure(figsize=(12, 4.2))
    axes = [figure.add_axes((0.3 * k, 0.04, 0.29, 0.86), projection="3d") for k in range(3)]
    axes[0].scatter(*points.T, s=1, c="black")
    qf.plot(fit.model.superquadric().mesh(32), axes[1])
    qf.plot(fit, axes[2], colour=sigma, resolution=16)
    for one in axes[:2]:
        one.set(xlim=axes[2].get_xlim(), ylim=axes[2].get_ylim(), zlim=axes[2].get_zlim(), aspect="equal")
    titles = (f"{len(points)} points", "superquadric, 11 parameters", f"model, {fit.model.n_parameters} parameters")
    for one, title in zip(axes, titles):
        without_axes(one, title)
    colours = figure.colorbar(axes[2].collections[-1], cax=figure.add_axes((0.92, 0.2, 0.012, 0.6)))
    colours.set_label("one sigma")
    return figure


def image_to_ventricle(names: dict) -> bytes | Figure:
    volume, model = names["volume"], names["fit"].model
    outlines: dict[str, Mesh] = {name: model.mesh(name, 48) for name in model.surfaces}
    shades = np.array([0.0, 1.0, 0.3])[volume.values]
    return slices_png(shades, volume.world_from_voxel, outlines, "synthetic ventricle", count=8)


def beating_heart(names: dict) -> bytes | Figure:
    heart, moving, times = names["heart"], names["found"].moving, names["times"]
    figure = Figure(figsize=(12, 4.2))
    first, second = (figure.add_axes((0.32 * k, 0.02, 0.29, 0.86), projection="3d") for k in range(2))
    qf.plot(moving, first, time=0.0)
    qf.plot(moving, second, time=0.5)
    second.set(xlim=first.get_xlim(), ylim=first.get_ylim(), zlim=first.get_zlim(), aspect="equal")
    without_axes(first, "end diastole")
    without_axes(second, "end systole")
    curve = figure.add_axes((0.71, 0.16, 0.27, 0.72))
    fine = np.linspace(0, 1, 25)
    for source, style, label in ((moving.at, "-", "moving model"), (heart.model, "k--", "truth")):
        curve.plot(fine, [source(time).volume("endo") / 1000 for time in fine], style, label=label)
    curve.plot(times, [moving.at(time).volume("endo") / 1000 for time in times], "o", label="frames", color="C0")
    curve.set(xlabel="time, cycles", ylabel="cavity, ml", title="volume")
    curve.legend(frameon=False)
    return figure


def main() -> None:
    for draw in (points_to_model, image_to_ventricle, beating_heart):
        picture = draw(run(DOCS / "tutorials" / f"{draw.__name__}.md"))
        target = DOCS / "figures" / f"{draw.__name__}.png"
        if isinstance(picture, Figure):
            picture.savefig(target, dpi=70)
        else:
            target.write_bytes(picture)
        print(target)


if __name__ == "__main__":
    main()
