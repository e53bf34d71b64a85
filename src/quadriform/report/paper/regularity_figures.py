"""Figs. 10 to 12, and what they leave out: regularity and its cost, and outliers."""

import numpy as np
from matplotlib.figure import Figure

from quadriform.points import Array
from quadriform.report.paper import drawing
from quadriform.report.paper.remake import NONE, NOT, Remake, beside, mm, shown
from quadriform.report.paper.results import Results
from quadriform.report.paper.subjects import SYNTHETIC
from quadriform.report.paper.trade_off import TradeOff, errors_and_motions
from quadriform.report.parts import svg


def four_boxes(results: Results) -> Remake:
    """Fig. 10."""
    trade = results.trade_off
    figure, places = drawing.scene(len(trade.svd) + 1, width=2.4)
    for axes, fit, count in zip(places, (*trade.svd, trade.auto), (*trade.counts, None)):
        drawing.draw_box(axes, fit.model.box)
        drawing.draw_mesh(axes, fit.model.mesh(resolution=drawing.RESOLUTION), _colour(count), 0.7)
        drawing.look_at([axes], fit.model.box.control_points.reshape(-1, 3), 1.0)
        axes.set_title("default" if count is None else f"{count:.0f} singular values", fontsize=8)
    words = "The box of a synthetic ventricle with fewer and fewer singular values, and the default's; scales differ."
    _, moved = errors_and_motions((*trade.svd, trade.auto))
    rows = [(f"box moved RMS, {count:.0f} singular values", NONE, mm(m), NOT) for count, m in zip(trade.counts, moved)]
    return Remake(
        "Fig. 10",
        "boxes with fewer singular values",
        "p. 46",
        "a box of 5 x 5 x 5 control points, very irregular at first, is more regular the fewer singular values are "
        "kept; four boxes.",
        [shown(drawing.picture(figure, words), words, SYNTHETIC)],
        [*rows, (f"box moved RMS, strength found {trade.auto.strength:.1e}", NONE, NOT, mm(moved[-1]))],
        f"the box moves {mm(moved[0])} with most of them, {mm(moved[-2])} with fewest. By default a bending energy "
        f"holds it, and the evidence of the data says how strongly: {mm(moved[-1])}.",
    )


def _colour(count: float | None) -> str:
    return drawing.BY_DEFAULT if count is None else drawing.BY_PAPER


def error_and_motion(results: Results) -> Remake:
    """Fig. 11."""
    trade = results.trade_off
    curves = _curves(trade)
    figure = Figure(figsize=(9, 3.2))
    for axes, k, label in zip(figure.subplots(1, 2), (0, 1), ("error RMS, mm", "box moved RMS, mm")):
        index = np.arange(1, len(trade.counts) + 1)
        axes.semilogy(index, curves["singular values"][k], "o-", color=drawing.BY_PAPER, label="singular values")
        axes.semilogy(index, curves["bending, default"][k], "s--", color=drawing.BY_DEFAULT, label="bending, default")
        axes.set(xlabel="setting, weak to strong", ylabel=label, xticks=index)
        axes.grid(alpha=0.3, which="both")
        drawing.plain(axes)
    figure.legend(*axes.get_legend_handles_labels(), loc="upper center", ncols=2, frameon=False, fontsize=8)
    (error, moved), (by_default, moved_too) = curves["singular values"], curves["bending, default"]
    words = f"Error and motion of the box with {_listed(trade.counts)} singular values, and with bending of strength "
    words += f"{_listed(trade.strengths)}."
    return Remake(
        "Fig. 11",
        "error and motion of the box",
        "p. 47",
        "error and deformation of the box, in mm, against a falling number of singular values; four settings, curves "
        "without a table.",
        [shown(svg(figure, words), words, SYNTHETIC)],
        [
            ("error RMS, weakest to strongest", NONE, _listed(error), _listed(by_default)),
            ("box moved RMS, weakest to strongest", NONE, _listed(moved), _listed(moved_too)),
        ],
        _monotone(error, moved),
    )


def _monotone(error: Array, moved: Array) -> str:
    holds = bool((np.diff(error) > 0).all() and (np.diff(moved) < 0).all())
    seen = f"{'each' if holds else 'not each'} truncation costs error and calms the box"
    return (
        f"{seen}. From the weakest to the strongest truncation the error grows {error[-1] / error[0]:.2f} times, and "
        f"the box moves {moved[0] / moved[-1]:.0f} times less. The default is not truncated; its curve is for fixed "
        "strengths."
    )


def _listed(values: object) -> str:
    return ", ".join(f"{value:.3g}" for value in values)  # type: ignore[attr-defined]


def _curves(trade: TradeOff) -> dict[str, tuple[Array, Array]]:
    return {
        "singular values": errors_and_motions(trade.svd),
        "springs": errors_and_motions(trade.springs),
        "bending, default": errors_and_motions(trade.bending),
    }


def both_regularities(results: Results) -> Remake:
    """Fig. 12."""
    trade = results.trade_off
    curves = _curves(trade)
    figure = Figure(figsize=(6, 3.6))
    axes = figure.subplots()
    for (name, (errors, moved)), style, colour in zip(
        curves.items(), ("o-", "^-", "s--"), (drawing.BY_PAPER, drawing.ORANGE, drawing.BY_DEFAULT)
    ):
        axes.loglog(errors, moved, style, color=colour, label=name)
    error, moved = errors_and_motions((trade.auto,))
    axes.loglog(error, moved, "*", color=drawing.GREY, markersize=11, label="default, strength found")
    axes.set(xlabel="error RMS, mm", ylabel="box moved RMS, mm")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3, which="both")
    drawing.plain(axes)
    words = "Motion of the box against the error for each regularity; the noise of the data is 0.5 mm."
    ratio = _at_equal_error(curves["singular values"], curves["springs"])
    far = f"{ratio:.2f}" if np.isfinite(ratio) else "no common error"
    return Remake(
        "Fig. 12",
        "both regularities against each other",
        "p. 47",
        "truncation and springs are called equivalent: motion of the box against the error, a curve for each.",
        [shown(svg(figure, words), words, SYNTHETIC)],
        [
            ("motion with springs over motion with truncation, at equal error", "about 1", far, NOT),
            ("error RMS at the strength found", NONE, NOT, mm(float(error[0]))),
        ],
        f"at the same error the box with springs moves {far} times as far as the truncated one (geometric mean over "
        "the common errors; 1 is equivalent). Bending leaves affine motion free, so the default's curve ends level; "
        "its strength needs no choice.",
    )


def _at_equal_error(one: tuple[Array, Array], other: tuple[Array, Array]) -> float:
    """Geometric mean of the ratio of motions, other over one, where both curves have the same error; NaN where none."""
    low, high = max(one[0].min(), other[0].min()), min(one[0].max(), other[0].max())
    if low >= high:
        return float("nan")
    errors = np.linspace(np.log(low), np.log(high), 50)
    motions = []
    for error, motion in (one, other):
        order = np.argsort(error)
        motions.append(np.interp(errors, np.log(error)[order], np.log(motion)[order]))
    return float(np.exp(np.mean(motions[1] - motions[0])))


def outliers(results: Results) -> Remake:
    """What the paper claims and never measured."""
    found = results.robustness
    figure = Figure(figsize=(6, 3.4))
    axes = figure.subplots()
    for name, errors, style, colour in (
        ('method="paper"', found.paper, "o-", drawing.BY_PAPER),
        ("default", found.default, "s--", drawing.BY_DEFAULT),
    ):
        axes.semilogy(100 * np.array(found.shares), errors, style, color=colour, label=name)
    axes.set(xlabel="strangers, % of the points", ylabel="error of the true surface RMS, mm")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3, which="both")
    drawing.plain(axes)
    words = (
        f"Error of the true surface of a synthetic ventricle, 100 mm long, from {len(found.points)} points with noise "
    )
    words += "of 0.5 mm, of which a share was put anywhere in a box half as large again."
    rows = [
        (f"error with {share:.0%} strangers", "claimed, not measured", mm(paper), mm(default))
        for share, paper, default in zip(found.shares, found.paper, found.default)
    ]
    return Remake(
        "No figure",
        "robustness to outliers",
        "p. 49",
        "robustness, in the presence of outliers too, is named as a main advantage; no experiment measures it.",
        [shown(svg(figure, words), words, SYNTHETIC)],
        rows,
        f"with {found.shares[-1]:.0%} strangers the error of the paper's method is {_times(found.paper)} times that "
        f"without any, that of the default, which tells strangers from inliers, {_times(found.default)} times. Beside "
        f"the paper's it is {beside(found.default[-1], found.paper[-1])} then.",
    )


def _times(errors: tuple[float, ...]) -> str:
    return f"{errors[-1] / errors[0]:.1f}"
