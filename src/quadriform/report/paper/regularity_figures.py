"""Figs. 10 to 12, and outliers: regularity and its cost, and robustness."""

from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup

from quadriform.report.paper import drawing
from quadriform.report.paper.material import Material
from quadriform.report.paper.remake import NONE, NOT, Remake, Row, beside, in_mm, listed, mm, shown, text
from quadriform.report.paper.subjects import SYNTHETIC
from quadriform.report.paper.trade_off import FOUR, Curve, TradeOff, moved, ratios, turning
from quadriform.report.parts import legend, table, tiles

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
        pictures.append(drawing.in_space(name, window, mesh, drawing.box(fit.model.box), zoom=1.0))
    motions, default = [moved(fit) for fit in trade.four], mm(moved(trade.auto))
    rows: list[Row] = [(f"box moved RMS, {name}", NONE, mm(motion), NOT) for name, motion in zip(settings, motions)]
    rows.append((f"box moved RMS, strength estimated: {trade.auto.strength:.1e}", NONE, NOT, default))
    falling = all(one > other for one, other in pairwise(motions))
    words: dict[str, object] = {
        "first": "the most" if motions[0] == max(motions) else "not the most",
        "moved": [mm(motion) for motion in motions],
        "others": listed([mm(motion) for motion in motions[1:]]),
        "falling": "less" if falling else "not less",
        "default": default,
    }
    return Remake("10", words, [shown("10", tiles(pictures), SYNTHETIC)], rows)


def _error_and_motion_curves(four: Curve, bending: Curve) -> list[tuple[str, Markup]]:
    def draw(axes: Any, quantity: str) -> None:
        """Draw a curve for each regularity over its settings."""
        for each, style, colour in ((four, "o-", drawing.BY_PAPER), (bending, "s--", drawing.BY_DEFAULT)):
            axes.plot(np.arange(1, len(each.settings) + 1), getattr(each, quantity), style, color=colour)
        axes.set(xticks=np.arange(1, len(four.settings) + 1))

    quantities = (("error", "error RMS, mm", "linear"), ("moved", "box moved RMS, mm", "log"))
    return [
        (label, drawing.chart(partial(draw, quantity=name), label, "setting, weak to strong", label, yscale=scale))
        for name, label, scale in quantities
    ]


def error_and_motion(material: Material) -> Remake:
    """Fig. 11."""
    trade = material.trade_off
    four, bending = trade.svd.take(FOUR), trade.bending
    key = legend([(TRUNCATION, drawing.BY_PAPER), ("bending, default", drawing.BY_DEFAULT)])
    picture = tiles(_error_and_motion_curves(four, bending), "charts") + key
    settings = {"kept": listed(_kept(trade)), "strengths": _numbers(bending.settings)}
    return Remake(
        "11",
        _monotone(four),
        [shown("11", picture, SYNTHETIC, **settings)],
        [
            ("error RMS in mm, weak to strong", "curve", _numbers(four.error), _numbers(bending.error)),
            ("box moved RMS in mm, weak to strong", "curve", _numbers(four.moved), _numbers(bending.moved)),
        ],
    )


def _numbers(values: Any) -> str:
    return ", ".join(f"{value:,.0f}" if value >= 1000 else f"{value:.3g}" for value in values)


def _monotone(four: Curve) -> dict[str, object]:
    grows, calms = bool((np.diff(four.error) > 0).all()), bool((np.diff(four.moved) < 0).all())
    return {
        "grows": "grows" if grows else "does not always grow",
        "error": four.error[-1] / four.error[0],
        "falls": "falls" if calms else "does not always fall",
        "moved": four.moved[0] / four.moved[-1],
    }


def _both_curves(trade: TradeOff) -> list[tuple[str, Markup]]:
    """The curves of all settings, and their part of small errors."""

    def draw(axes: Any) -> None:
        """Draw a curve for each regularity."""
        for _, attribute, style, colour in CURVES:
            each = getattr(trade, attribute)
            axes.plot(each.error, each.moved, style, color=colour, markersize=4)
        axes.plot(trade.auto.rms, moved(trade.auto), "*", color=drawing.GREY, markersize=11)

    def draw_near(axes: Any) -> None:
        """Draw the same near the error of the automatic strength."""
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
    found = ratios(trade.svd, trade.springs_paper)
    header = ("regularity", "setting", "error RMS, mm", "box moved RMS, mm")
    listing = [
        (name, f"{setting:g}", f"{error:.3f}", f"{motion:,.2f}")
        for name, curve in ((TRUNCATION, trade.svd), (P9, trade.springs_paper))
        for setting, error, motion in zip(curve.settings, curve.error, curve.moved)
    ]
    low, high = (f"{found.min():.2f}", f"{found.max():.2f}") if len(found) else (NOT, NOT)
    rows: list[Row] = [
        ("motion with P9 over motion with SVD, at equal errors, least", "equivalent", low, NOT),
        ("motion with P9 over motion with SVD, at equal errors, most", "equivalent", high, NOT),
        ("error RMS at the estimated strength", NONE, NOT, mm(trade.auto.rms)),
    ]
    words: dict[str, object] = {"compared": _equivalent(found), "turn": _curve_of_p9(trade.springs_paper)}
    picture = tiles(_both_curves(trade), "charts") + legend(key)
    return Remake("12", words, [shown("12", picture, SYNTHETIC)], rows, [table(header, listing)])


def _equivalent(found: Any) -> str:
    """A sentence on whether the claim is confirmed, from motions with P9 over those with truncation at equal errors."""
    if not len(found):
        return text("12", "not_comparable")
    mean, low, high = np.exp(np.log(found).mean()), found.min(), found.max()
    answer = "" if low >= 1 / EQUIVALENT and high <= EQUIVALENT else "not "
    return text("12", "comparable", equivalent=EQUIVALENT, answer=answer, low=low, high=high, mean=mean)


def _curve_of_p9(printed: Curve) -> str:
    """Where the curve of P9 turns back: springs of zero length contract the box when they are strong."""
    k, last = turning(printed), len(printed.settings) - 1
    if k == last:
        return text("12", "not_turning", last=printed.settings[last])
    words = {
        "strength": printed.settings[k],
        "moved": mm(printed.moved[k]),
        "error": mm(printed.error[k]),
        "last": printed.settings[last],
        "last_moved": mm(printed.moved[last]),
        "last_error": mm(printed.error[last]),
    }
    return text("12", "turning", **words)


def outliers(material: Material) -> Remake:
    """What the paper claims and does not measure."""
    found = material.robustness
    percent = 100 * np.array(found.ratios)

    def draw(axes: Any) -> None:
        """Draw the errors of both methods."""
        axes.plot(percent, found.paper, "o-", color=drawing.BY_PAPER)
        axes.plot(percent, found.default, "s--", color=drawing.BY_DEFAULT)

    label = "error of the true surface RMS, mm"
    picture = drawing.chart(draw, label, "outliers, % of the points", label)
    key = legend([('method="paper"', drawing.BY_PAPER), ("default", drawing.BY_DEFAULT)])
    rows = [
        in_mm(f"error with {ratio:.0%} outliers", both, "claimed, not measured")
        for ratio, *both in zip(found.ratios, found.paper, found.default)
    ]
    words: dict[str, object] = {
        "most": found.ratios[-1],
        "paper": found.paper[-1] / found.paper[0],
        "default": found.default[-1] / found.default[0],
        "compared": beside(found.default[-1], found.paper[-1]),
    }
    shown_ = shown("outliers", tiles([(label, picture)], "charts") + key, SYNTHETIC, count=found.count)
    return Remake("outliers", words, [shown_], rows)
