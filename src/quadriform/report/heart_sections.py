"""Sections of a report about a ventricle: function with the differences between readers, bullseyes, curves."""

import re
from collections.abc import Mapping

from markupsafe import Markup

from quadriform.heart.measures_table import Measures, Row
from quadriform.report import charts
from quadriform.report.page import Section, report_text, texts
from quadriform.report.parts import figure, table

SEGMENT = re.compile(r"(?:unanchored )?segment (\d+), [^:]*: (.*)")
UNITS = {"cavity volume": "ml", "wall thickness": "mm", "twist angle": "degrees"}


def heart_sections(measures: Measures | None) -> list[Section]:
    """Function, wall and curves, where they were measured."""
    if measures is None:
        return []
    sections = [Section("Function", _function(measures))]
    if bullseyes := _bullseyes(measures):
        sections.append(Section("Segments", bullseyes))
    if len(measures.times) > 1:
        sections.append(Section("Curves over the cycle", _curves(measures)))
    rows = [
        [row.quantity, row.number, row.unit, row.how] for row in measures.rows if not SEGMENT.fullmatch(row.quantity)
    ]
    sections.append(Section("All measures of the whole ventricle", table(("quantity", "value", "unit", "how"), rows)))
    return sections


def _function(measures: Measures) -> Markup:
    readers = texts("reports.toml")["readers"]
    rows = [
        [row.quantity, f"{row.number} {row.unit}", _interval(row), readers.get(row.quantity, ""), row.how]
        for row in measures.rows
        if row.quantity in (*readers, "stroke volume")
    ]
    items = [Markup("<li><strong>{}</strong>: {}</li>").format(*each) for each in measures.own_warnings.items()]
    warnings = Markup("<ul>{}</ul>").format(Markup("").join(items)) if items else Markup("")
    note = Markup('<p class="note">{}</p>').format(report_text("captions", "readers"))
    return warnings + table(("quantity", "value", "95 % interval", "readers", "how"), rows) + note


def _interval(row: Row) -> str:
    """The interval by the standard deviation; empty where this is not known."""
    ends = row.estimate.interval()
    return "" if ends is None else f"{ends[0]:.4g} to {ends[1]:.4g} {row.unit}"


def _bullseyes(measures: Measures) -> Markup:
    found: dict[str, dict[int, float]] = {}
    anchored = True
    units = {}
    for row in measures.rows:
        # a row of a segment is named "segment 7, mid anterior: wall thickness"
        if match := SEGMENT.fullmatch(row.quantity):
            found.setdefault(match[2], {})[int(match[1])] = row.value
            units[match[2]] = row.unit + ("" if row.observed else " (not observed)")
            anchored &= not row.quantity.startswith("unanchored")
    # Green strain is in the table: its rings would look like those of the strain beside them
    drawn = [charts.bullseye(values, name, units[name]) for name, values in found.items() if "Green" not in name]
    if not drawn:
        return Markup("")
    # without insertions of the right ventricle no segment has an anatomical name
    words = report_text("captions", "anchored" if anchored else "unanchored")
    return figure(Markup('<div class="beside">{}</div>').format(Markup("").join(drawn)), words)


def _curves(measures: Measures) -> Markup:
    labels = {"ED": measures.ed} | ({} if measures.es is None else {"ES": measures.es})
    drawn = [
        charts.curve(
            measures.times, values, _title(measures, name), UNITS.get(name, "%"), labels, measures.curves_sd.get(name)
        )
        for name, values in measures.curves.items()
    ]
    return Markup('<div class="beside">{}</div>').format(Markup("").join(drawn))


def _title(measures: Measures, name: str) -> str:
    observed: Mapping[str, bool] = {row.quantity: row.observed for row in measures.rows}
    return name if observed.get(name, True) else f"{name} (not observed)"
