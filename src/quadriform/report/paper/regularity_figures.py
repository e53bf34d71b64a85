"""Figs. 10 to 12, and outliers: regularity and its cost, and robustness."""

from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup

from quadriform.report.paper import drawing
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, NOT, Remake, beside, listed, mm, shown
from quadriform.report.paper.subjects import SYNTHETIC
from quadriform.report.paper.trade_off import FOUR, Curve, TradeOff, moved, ratios, turning
from quadriform.report.parts import table

EQUIVALENT = 1.25
"""Two regularities are called equivalent when at equal errors their motions differ by less than this factor."""
NEAR = 1.6
"""The second picture of Fig. 12 ends at this multiple of the error at the estimated strength."""
P9 = "springs, P9 as printed"
OURS = "springs on the displacement, our variation"
TRUNCATION = "truncated SVD, P8"
CURVES = (
    (TRUNCATION, "svd", "o-", drawing.BY_PAPER),
    (P9, "springs_paper", "^-", drawing.ORANGE),
    (OURS, "springs", "v:", drawing.PINK),
    ("bending, default", "bending", "s--", drawing.BY_DEFAULT),
)


def _kept(trade: TradeOff) -> list[str]:
    """Names of the four settings."""
    counts = trade.svd.take(FOUR).settings
    return [f"all {counts[0]:.0f} above rounding", *(f"{count:.0f}" for count in counts[1:])]


def four_boxes(material: Material) -> Remake:
    """Fig. 10."""
    trade = material.trade_off
    settings = [f"singular values: {kept}" for kept in _kept(trade)]
    pictures = []
    for fit, name in zip((*trade.four, trade.auto), (*settings, "default")):
        colour = drawing.BY_DEFAULT if name == "default" else drawing.BY_PAPER
        mesh = drawing.mesh(fit.model.mesh(resolution=drawing.RESOLUTION), colour, 0.7)
        window = fit.model.box.control_points.reshape(-1, 3)
        pictures.append((name, drawing.in_space(window, name, mesh, drawing.box(fit.model.box), zoom=1.0)))
    words = "Control boxes of a synthetic ventricle and the models in them; each picture has its own scale."
    motions = [moved(fit) for fit in trade.four]
    falling = all(one > other for one, other in pairwise(motions))
    rows = [(f"box moved RMS, {name}", NONE, mm(motion), NOT) for name, motion in zip(settings, motions)]
    return Remake(
        "Fig. 10",
        "regularization with SVD",
        "p. 46",
        "boxes of 5 x 5 x 5 control points, the number of diagonal terms (singular values kept) decreasing from left "
        "to right and top to bottom; the model's size differs only by the scale of the pictures. The first box is very "
        "irregular.",
        [shown(drawing.tiles(pictures), words, SYNTHETIC)],
        [*rows, (f"box moved RMS, strength estimated: {trade.auto.strength:.1e}", NONE, NOT, mm(moved(trade.auto)))],
        f"the first box is {'the most irregular' if motions[0] == max(motions) else 'not the most irregular'}: its "
        f"control points moved {mm(motions[0])}. With fewer singular values they moved "
        f"{listed([mm(m) for m in motions[1:]])}, "
        f"{'less each time' if falling else 'not less each time'}. The default regularises by bending energy with a "
        f"strength estimated from the data: {mm(moved(trade.auto))}.",
    )


def _error_and_motion_curves(four: Curve, bending: Curve) -> list[tuple[str, Markup]]:
    def draw(quantity: str) -> Any:
        def curves(axes: Any) -> None:
            for each, style, colour in ((four, "o-", drawing.BY_PAPER), (bending, "s--", drawing.BY_DEFAULT)):
                axes.plot(np.arange(1, len(each.settings) + 1), getattr(each, quantity), style, color=colour)
            axes.set(xticks=np.arange(1, len(four.settings) + 1))

        return curves

    labels = {"error": "error RMS, mm", "moved": "box moved RMS, mm"}
    scales = {"error": "linear", "moved": "log"}
    return [
        (label, drawing.chart(draw(name), label, "setting, weak to strong", label, yscale=scales[name]))
        for name, label in labels.items()
    ]


def error_and_motion(material: Material) -> Remake:
    """Fig. 11."""
    trade = material.trade_off
    four, bending = trade.svd.take(FOUR), trade.bending
    key = drawing.legend([(TRUNCATION, drawing.BY_PAPER), ("bending, default", drawing.BY_DEFAULT)])
    words = f"Settings: {listed(_kept(trade))} singular values; bending of strength {_numbers(bending.settings)}."
    return Remake(
        "Fig. 11",
        "approximation error and deformation of the box",
        "p. 47",
        "left the approximation error between the models and the data, right the deformation of the box of control "
        "points, in mm, with a decreasing number of diagonal terms: the four settings of Fig. 10.",
        [shown(drawing.tiles(_error_and_motion_curves(four, bending), "charts") + key, words, SYNTHETIC)],
        [
            ("error RMS in mm, weak to strong", "curve", _numbers(four.error), _numbers(bending.error)),
            ("box moved RMS in mm, weak to strong", "curve", _numbers(four.moved), _numbers(bending.moved)),
        ],
        _monotone(four),
    )


def _numbers(values: Any) -> str:
    return ", ".join(f"{value:,.0f}" if value >= 1000 else f"{value:.3g}" for value in values)


def _monotone(four: Curve) -> str:
    grows, calms = bool((np.diff(four.error) > 0).all()), bool((np.diff(four.moved) < 0).all())
    return (
        f"with fewer singular values the error {'grows' if grows else 'does not always grow'}, in all by a factor of "
        f"{four.error[-1] / four.error[0]:.2f}, and the deformation of the box "
        f"{'falls' if calms else 'does not always fall'}, "
        f"in all by a factor of {four.moved[0] / four.moved[-1]:,.0f}."
    )


def _both_curves(trade: TradeOff) -> list[tuple[str, Markup]]:
    """The curves of all settings, and their part of small errors."""

    def draw(axes: Any) -> None:
        for _, attribute, style, colour in CURVES:
            each = getattr(trade, attribute)
            axes.plot(each.error, each.moved, style, color=colour, markersize=4)
        axes.plot(trade.auto.rms, moved(trade.auto), "*", color=drawing.GREY, markersize=11)

    def draw_near(axes: Any) -> None:
        draw(axes)
        axes.set(xlim=(0.9 * trade.auto.rms, NEAR * trade.auto.rms))

    labels = ("error RMS, mm", "box moved RMS, mm")
    return [
        ("all settings", drawing.chart(draw, "motion of the box against the error", *labels, "log")),
        ("the same, small errors", drawing.chart(draw_near, "motion of the box against small errors", *labels)),
    ]


def both_regularities(material: Material) -> Remake:
    """Fig. 12."""
    trade = material.trade_off
    key = [(name, colour) for name, _, _, colour in CURVES] + [("star: default, strength estimated", drawing.GREY)]
    words = "Motion of the box against the error for each regularity; the noise of the data is 0.5 mm."
    found = ratios(trade.svd, trade.springs_paper)
    header = ("regularity", "setting", "error RMS, mm", "box moved RMS, mm")
    listing = [
        (name, f"{setting:g}", f"{error:.3f}", f"{motion:,.2f}")
        for name, attribute, _, _ in CURVES[:2]
        for setting, error, motion in _points(getattr(trade, attribute))
    ]
    low, high = (f"{found.min():.2f}", f"{found.max():.2f}") if len(found) else (NOT, NOT)
    return Remake(
        "Fig. 12",
        "both regularizations against each other",
        "p. 47",
        "the norm of the deformation of the box against the least-squares approximation error, a curve for "
        "regularization with SVD and one with a regularizing term (P9). The two methods are called equivalent.",
        [shown(drawing.tiles(_both_curves(trade), "charts") + drawing.legend(key), words, SYNTHETIC)],
        [
            ("motion with P9 over motion with SVD, at equal errors, least", "equivalent", low, NOT),
            ("motion with P9 over motion with SVD, at equal errors, most", "equivalent", high, NOT),
            ("error RMS at the estimated strength", NONE, NOT, mm(trade.auto.rms)),
        ],
        _equivalent(trade, found),
        [table(header, listing)],
    )


def _points(curve: Curve) -> list[tuple[float, float, float]]:
    return list(zip(curve.settings, curve.error.tolist(), curve.moved.tolist()))


def _equivalent(trade: TradeOff, found: Any) -> str:
    """The verdict on the claim, and where the curve of P9 turns back."""
    printed = trade.springs_paper
    k, last = turning(printed), len(printed.settings) - 1
    comparison = (
        f"P9 as printed contracts the control points: beyond a strength of {printed.settings[k]:g}, with a motion "
        f"of {mm(printed.moved[k])} at an error of {mm(printed.error[k])}, its curve turns back, and at "
        f"{printed.settings[last]:g} the box has moved {mm(printed.moved[last])} with an error of "
        f"{mm(printed.error[last])}."
        if k < last
        else f"The curve of P9 does not turn back up to a strength of {printed.settings[last]:g}."
    )
    if not len(found):
        return f"the curves have no error in common, so the claim cannot be judged. {comparison}"
    mean, low, high = np.exp(np.log(found).mean()), found.min(), found.max()
    equal = low >= 1 / EQUIVALENT and high <= EQUIVALENT
    return (
        f"called equivalent here when at equal errors the motions differ by less than a factor of {EQUIVALENT}: "
        f"they are "
        f"{'' if equal else 'not '}equivalent. Up to the turn the box moves with P9 {low:.2f} to {high:.2f} "
        f"times as far "
        f"as with truncation, in the geometric mean {mean:.2f} times. {comparison}"
    )


def outliers(material: Material) -> Remake:
    """What the paper claims and does not measure."""
    found = material.robustness
    percent = 100 * np.array(found.ratios)

    def draw(axes: Any) -> None:
        axes.plot(percent, found.paper, "o-", color=drawing.BY_PAPER)
        axes.plot(percent, found.default, "s--", color=drawing.BY_DEFAULT)

    label = "error of the true surface RMS, mm"
    picture = drawing.chart(draw, label, "outliers, % of the points", label)
    key = drawing.legend([('method="paper"', drawing.BY_PAPER), ("default", drawing.BY_DEFAULT)])
    words = f"Error of the true surface of a synthetic ventricle from {found.count:,} points with noise of "
    words += "0.5 mm, some of which were moved anywhere in a box half as large again."
    rows = [
        (f"error with {ratio:.0%} outliers", "claimed, not measured", mm(paper), mm(default))
        for ratio, paper, default in zip(found.ratios, found.paper, found.default)
    ]
    grown = [errors[-1] / errors[0] for errors in (found.paper, found.default)]
    return Remake(
        "Section 6",
        "robustness to outliers",
        "p. 49",
        "the robustness of the fit, even in the presence of outliers or sparse data, is named as a main advantage; no "
        "experiment measures it for outliers.",
        [shown(drawing.tiles([(label, picture)], "charts") + key, words, SYNTHETIC)],
        rows,
        f"with {found.ratios[-1]:.0%} outliers the error of the paper's method is {grown[0]:.1f} times that "
        f"without any, "
        f"that of the default, which detects outliers, {grown[1]:.1f} times; it is then "
        f"{beside(found.default[-1], found.paper[-1])} than the paper's.",
    )
