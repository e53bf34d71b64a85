"""The gallery: a picture of what each example computes, docs/figures/gallery/*.png, and the page that shows them.

python docs/gallery_figures.py
"""

import ast
import contextlib
import io
import re
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import quadriform as qf

DOCS = Path(__file__).resolve().parent
EXAMPLES = DOCS.parent / "examples"
PAGE = DOCS / "gallery.md"
PICTURES = DOCS / "figures" / "gallery"
LEAD = """# Gallery

Short programs, each complete and run by `make docs`, with what they print. `make docs-figures` draws the pictures and
writes this page.
"""
ORDER = (
    "which_results_to_use",
    "ellipsoid_from_points",
    "mask_to_model",
    "mesh_to_model",
    "two_surfaces",
    "cycle_and_ejection_fraction",
    "outliers",
    "open_cavity",
    "save_and_load",
    "deform_inner_points",
    "shape_modes",
    "paper_method",
)


def run(name: str) -> tuple[dict[str, Any], str]:
    """The variables that an example leaves, and what it prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        names = runpy.run_path(str(EXAMPLES / f"{name}.py"))
    return names, printed.getvalue()


def printed_on_page() -> dict[str, str]:
    """What each example prints, by its name, as the page has it."""
    found = re.findall(r"^```text\n(.*?)```\n\n`examples/(\w+)\.py`$", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    return {name: text for text, name in found}


def page(printed: dict[str, str]) -> str:
    """The page, from the examples, what they print, and the pictures' names."""
    parts = [LEAD]
    for name in ORDER:
        code = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
        title, _, text = (ast.get_docstring(ast.parse(code)) or "").partition(".\n\n")
        body = code.split('"""\n\n', 1)[1].strip()
        picture = f"![{title}](figures/gallery/{name}.png)"
        shown = f"```python\n{body}\n```\n\n```text\n{printed[name]}```"
        parts.append(f"## {title}\n\n{text}\n\n{picture}\n\n{shown}\n\n`examples/{name}.py`\n")
    return "\n".join(parts)


def panels(count: int) -> tuple[Figure, list[Any]]:
    """A figure with so many three-dimensional axes side by side."""
    figure = Figure(figsize=(3.6 * count, 3.2))
    axes = [figure.add_axes((k / count, 0.0, 1 / count, 0.92), projection="3d") for k in range(count)]
    return figure, axes


def finish(axes: list[Any], titles: list[str]) -> None:
    """Titles, and the same scale in all axes, without ticks."""
    limits = [np.array([axis.get_xlim(), axis.get_ylim(), axis.get_zlim()]) for axis in axes]
    low, high = np.min(limits, axis=0)[:, 0], np.max(limits, axis=0)[:, 1]
    for axis, title in zip(axes, titles):
        axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axis.set_aspect("equal")
        axis.set_axis_off()
        axis.set_box_aspect(axis.get_box_aspect(), zoom=1.1)  # more would cut what is in the corners
        axis.set_title(title, fontsize=10)


def points_and_model(points: str, model: Callable[[dict[str, Any]], Any]) -> Callable[[dict[str, Any]], Figure]:
    """A picture of points beside the model of them."""

    def draw(names: dict[str, Any]) -> Figure:
        figure, axes = panels(2)
        cloud = names[points]
        axes[0].scatter(*cloud.T, s=2, c="black")
        qf.plot(model(names), axes[1])
        finish(axes, [f"{len(cloud)} points", "model"])
        return figure

    return draw


def several(models: Callable[[dict[str, Any]], dict[str, Any]], **options: Any) -> Callable[[dict[str, Any]], Figure]:
    """A picture of models side by side, each under its title."""

    def draw(names: dict[str, Any]) -> Figure:
        shown = models(names)
        figure, axes = panels(len(shown))
        for axis, model in zip(axes, shown.values()):
            qf.plot(model, axis, **options)
        finish(axes, list(shown))
        return figure

    return draw


def outliers(names: dict[str, Any]) -> Figure:
    figure, axes = panels(2)
    points, inlier = names["points"], names["fit"].inliers >= 0.5
    axes[0].scatter(*points[inlier].T, s=2, c="black")
    axes[0].scatter(*points[~inlier].T, s=8, c="#d55e00")
    qf.plot(names["fit"], axes[1])
    finish(axes, ["inliers, and outliers in orange", "model"])
    return figure


def statuses(names: dict[str, Any]) -> Figure:
    fits, clouds = names["fits"], names["clouds"]
    figure, axes = panels(len(fits))
    for axis, name in zip(axes, fits):
        qf.plot(fits[name], axis, points=clouds[name][::8])
    finish(axes, [f'{name}: "{fit.status}"' for name, fit in fits.items()])
    return figure


def carried(names: dict[str, Any]) -> Figure:
    figure, axes = panels(2)
    qf.plot(names["model"].superquadric().mesh(16), axes[0], points=names["inner"])
    qf.plot(names["model"], axes[1], points=names["moved"])
    finish(axes, ["superquadric, inner points", "model, moved points"])
    return figure


def modes(names: dict[str, Any]) -> Figure:
    found = names["found"]
    shown = found.reconstruct(np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]]))
    titles = ("first mode, -1 sigma", "mean", "+1 sigma")
    return several(lambda _: dict(zip(titles, shown)))(names)


def both_methods(names: dict[str, Any]) -> Figure:
    points = names["points"]
    fits = {f'method="{method}"': qf.fit(points, method=method) for method in ("paper", "tangent")}
    return several(lambda _: fits)(names)


DRAW: dict[str, Callable[[dict[str, Any]], Figure]] = {
    "which_results_to_use": statuses,
    "ellipsoid_from_points": points_and_model("points", lambda names: names["found"].superquadric.mesh(24)),
    "mask_to_model": lambda n: points_and_model("points", lambda _: n["fit"])({"points": n["cloud"].points}),
    "mesh_to_model": several(
        lambda n: {"mesh": qf.Mesh(np.array(n["mesh"].vertices), np.array(n["mesh"].faces)), "model": n["fit"]}
    ),
    "two_surfaces": several(lambda n: {"both surfaces": n["fit"]}),
    "cycle_and_ejection_fraction": several(
        lambda n: {"end diastole": n["found"].moving.at(0.0), "end systole": n["found"].moving.at(0.5)}
    ),
    "outliers": outliers,
    "open_cavity": points_and_model("open_cloud", lambda names: names["fit"]),
    "save_and_load": several(lambda n: {"loaded again": n["again"]}),
    "deform_inner_points": carried,
    "shape_modes": modes,
    "paper_method": both_methods,
}


def main() -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    printed = {}
    for name in ORDER:
        names, printed[name] = run(name)
        DRAW[name](names).savefig(PICTURES / f"{name}.png", dpi=80)
        print(name)
    PAGE.write_text(page(printed), encoding="utf-8")


if __name__ == "__main__":
    main()
