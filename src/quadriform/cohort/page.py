"""The page of a cohort: summary, mean and modes of shape in the viewer, and a sortable table of subjects."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from quadriform.cohort import failures
from quadriform.cohort.layout import Layout
from quadriform.cohort.measures import SD
from quadriform.cohort.modes import Modes
from quadriform.cohort.overview import SHOWN, Overview, SubjectSummary, overview
from quadriform.files.atomic import write_bytes
from quadriform.report.page import Section, page, rendered, report_text, source
from quadriform.report.parts import table
from quadriform.report.viewer import Scene, packed, viewer
from quadriform.shapes.record import with_deviation

NAME = "cohort.html"
MOST_SUBJECTS = 2000
"""On the page: those with most warnings. All are in the table of measures."""
MOST_FAILURES = 200


def write_page(results: Path, layout: Layout, modes: Modes | None) -> None:
    """Write the page into the folder of the results.

    Raises:
        InputError, OutputError: a part of the table cannot be read, or the page cannot be written.
    """
    found = overview(results, MOST_SUBJECTS)
    parts = [_summary(results, layout, found)]
    if modes is not None:
        parts.append(_shape(modes, found.warned))
    parts += [_subjects(found, layout), _failed(results)]
    style = source("viewer/viewer.css") + source("cohort/cohort.css")
    write_bytes(results / NAME, page("Cohort", report_text("cohort", "lead"), parts, style), force=True)


def _summary(results: Path, layout: Layout, found: Overview) -> Section:
    done, failed = len(found.rms), len(failures.rows(results / failures.TABLE))
    median = report_text("cohort", "median", rms=np.median(found.rms), unit=_unit(layout)) if done else ""
    counts = {"done": done, "subjects": layout.subjects, "failed": failed, "warned": found.warned}
    sentence = report_text("cohort", "summary", **counts, median=median)
    status = "warned" if failed or found.warned else "ok"
    body = Markup('<div class="summary {}"><p>{}</p></div>').format(status, sentence)
    if found.kinds:
        counted = [(kind, count, f"{100 * count / done:.1f} %") for kind, count in found.kinds.most_common()]
        body += table(("warning", "subjects", "share"), counted)
    return Section("Summary", body)


def _unit(layout: Layout) -> str:
    return layout.unit.replace("unknown", "units")


# --- shape -------------------------------------------------------------------------------------------------------


def _shape(modes: Modes, warned: int) -> Section:
    found, mean = modes.found, modes.found.mean
    unit = mean.unit.replace("unknown", "units")
    words = [
        report_text("cohort", "mode", sigma=sigma, unit=unit, percent=100 * ratio)
        for sigma, ratio in zip(found.deviations, found.variance_ratios)
    ]
    data = {
        "modes": packed(modes.displacements.astype("<f4")),
        "variances": found.variance_ratios.tolist(),
    }
    body = rendered(
        "cohort/modes.html.j2",
        modes=words,
        viewer=viewer(mean, Scene("mean shape")),
        payload=Markup(json.dumps(data, separators=(",", ":"))),
        script=source("cohort/modes.js"),
    )
    among = report_text("cohort", "warned") if warned else ""
    text = report_text("cohort", "shape", count=modes.subjects, warned=among)
    return Section("Shape", Markup('<p class="note">{}</p>').format(text) + body)


# --- subjects ----------------------------------------------------------------------------------------------------


def _subjects(found: Overview, layout: Layout) -> Section:
    shown = [name for name in SHOWN if any(name in subject.values for subject in found.worst)]
    header = ["subject", "status", "warnings", "frames"]
    header += [f"{name} {_of(found, name)}".rstrip() for name in shown]
    header += [f"volume {name} {end} {_unit(layout)}^3" for name in layout.surfaces for end in ("from", "to")]
    rows = [(subject, _cells(subject, shown, layout.surfaces)) for subject in found.worst]
    numeric = [False, False, False, *[True] * (len(header) - 3)]
    body = rendered(
        "cohort/subjects.html.j2", header=header, rows=rows, numeric=numeric, script=source("cohort/subjects.js")
    )
    others = len(found.rms) - len(found.worst)
    if others:
        text = report_text("cohort", "others", shown=len(found.worst), others=others)
        body = Markup('<p class="note">{}</p>').format(text) + body
    return Section("Subjects", body)


def _of(found: Overview, quantity: str) -> str:
    return found.units.get(quantity, "").replace("unknown", "units").removeprefix("1")


def _cells(subject: SubjectSummary, shown: Sequence[str], surfaces: Sequence[str]) -> list[tuple[str, Any]]:
    """The numbers of a subject, as text and as what the table sorts by."""
    cells: list[tuple[str, Any]] = [(str(subject.frames), subject.frames)]
    cells += [_number(subject.values.get(name), subject.values.get(f"{name}{SD}")) for name in shown]
    return cells + [_number(end) for name in surfaces for end in subject.volumes.get(name, (None, None))]


def _number(value: float | None, sd: float | None = None) -> tuple[str, Any]:
    return ("", "") if value is None else (with_deviation(value, sd), repr(value))


def _failed(results: Path) -> Section:
    rows = failures.rows(results / failures.TABLE)
    if not rows:
        return Section("Failures", Markup("<p>None.</p>"))
    body = table(failures.HEADER, rows[:MOST_FAILURES])
    if len(rows) > MOST_FAILURES:
        body += Markup("<p>{}</p>").format(
            report_text("cohort", "failures", most=MOST_FAILURES, count=len(rows), table=failures.TABLE)
        )
    return Section("Failures", body)
