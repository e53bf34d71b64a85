"""Whole reports: of a fit, of a moving model, of a model alone."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from quadriform.fitting.result import Fit
from quadriform.heart.measures_table import Measures
from quadriform.imaging.volume import Volume
from quadriform.motion.tracking import Track
from quadriform.points import Array
from quadriform.report import sections
from quadriform.report.fields import residual_field, thickness_field, uncertainty_field
from quadriform.report.heart_sections import heart_sections
from quadriform.report.page import Section, page, report_text, source
from quadriform.report.slices import planes_section
from quadriform.report.viewer import Plane, ScalarField, Scene, viewer
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.record import remarks, remarks_of

WALLS = {"endo", "epi"}
Clouds = Mapping[str, Array]


def fit_report(
    fit: Fit,
    clouds: Clouds,
    *,
    title: str,
    record: Mapping[str, Any],
    image: Volume | None = None,
    measures: Measures | None = None,
) -> bytes:
    """The page of one fit.

    Args:
        fit: with its model in the frame of `clouds`.
        clouds: surface -> data points (n, 3).
        title: what was fitted, plain text.
        record: options and results, for the end of the page.
        image: from which the points came, in the same frame; its slices are shown with the model's contours.
        measures: of a ventricle.

    Returns:
        HTML, UTF-8.
    """
    model, unit = fit.model, fit.model.unit.replace("unknown", "units")
    residuals, before = _by_name(fit.residuals, clouds), _by_name(fit.superquadric_residuals, clouds)
    # the longest side: an error below half of it is below what the image resolves
    voxel = None if image is None else float(image.spacing.max())
    parts = [
        sections.summary(
            report_text("fit", "summary", fit=fit, unit=unit, support=_support_text(fit)),
            fit.status,
            remarks(fit.warnings, fit.notes),
        ),
        Section("Model", viewer(model, replace(_fit_scene(fit, clouds, residuals, title), planes=_planes(measures)))),
        sections.errors(residuals, before, unit, voxel),
    ]
    if image is not None:
        parts.append(planes_section(image, {name: model.mesh(name) for name in model.surfaces}, title))
    parts += [] if measures is None else heart_sections(measures)
    parts += [sections.convergence(fit.history, unit), sections.parameters(model, fit.n_points)]
    return _page(title, [*parts, *sections.methods(_fit_words(fit), record)])


def _support_text(fit: Fit) -> str:
    """A phrase with the share of each surface that data supports, and the volumes with their extrapolated share."""
    texts = []
    for name, each in fit.support.items():
        about = f"of {name}" if len(fit.support) > 1 else "of the surface"
        texts.append(f"{100 * each.area:.0f} % of the area {about} (volume {fit.volume(name)})")
    return ", ".join(texts)


def _fit_scene(fit: Fit, clouds: Clouds, residuals: Clouds, title: str) -> Scene:
    each = {name: [cloud] for name, cloud in clouds.items()}
    signed = {name: [values] for name, values in residuals.items()}
    fields = [residual_field([fit.model], each, signed)]
    if fit.enriched is not None:
        fields.append(uncertainty_field(fit))
    fields += _thickness([fit.model])
    return Scene(title, each, signed, [fit.rms], fields, _cavity(fit.model))


def track_report(
    found: Track, clouds: Sequence[Clouds], *, title: str, record: Mapping[str, Any], measures: Measures | None = None
) -> bytes:
    """The page of a moving model; of frames that were fitted alone, that of their models without the viewer's slider.

    Args:
        found: with its models in the frame of `clouds`.
        clouds: for each frame surface -> data points (n, 3).
        title: what was tracked, plain text.
        record: options and results, for the end of the page.
        measures: of a ventricle.
    """
    model: MovingModel | DeformableModel = found.models[0] if found.moving is None else found.moving
    unit = model.unit.replace("unknown", "units")
    # frames that were fitted alone have no common motion to play; the first stands for them
    shown = range(len(found.models) if found.moving is not None else 1)
    each = {name: [clouds[k][name] for k in shown] for name in model.surfaces}
    signed = {name: [found.residuals[k][name] for k in shown] for name in model.surfaces}
    models = [found.models[k] for k in shown]
    fields = [residual_field(models, each, signed), *_thickness(models)]
    errors, planes = found.frame_rms[list(shown)].tolist(), _planes(measures)
    scene = Scene(title, each, signed, errors, fields, _cavity(model), planes)
    worst = int(found.frame_rms.argmax())
    words = {"frames": len(found.models), "worst": worst, "worst_rms": found.frame_rms[worst], "unit": unit}
    sentence = report_text("track", "summary", track=found, **words)
    together = {name: np.concatenate([frame[name] for frame in found.residuals]) for name in model.surfaces}
    parts = [
        sections.summary(sentence, found.status, remarks(found.warnings, found.notes)),
        Section("Model", viewer(model, scene)),
        *([] if measures is None else heart_sections(measures)),
        sections.errors(together, None, unit, None),
        sections.parameters(model, sum(map(len, together.values()))),
    ]
    return _page(title, [*parts, *sections.methods(_track_words(found), record)])


def model_report(
    model: DeformableModel | MovingModel,
    *,
    title: str,
    record: Mapping[str, Any],
    measures: Measures | None = None,
) -> bytes:
    """The page of a model without the data it was fitted to.

    Args:
        model: a model or a moving model.
        title: plain text.
        record: where it comes from.
        measures: of a ventricle.
    """
    moving = isinstance(model, MovingModel)
    models = [model.at(t) for t in model.frame_times] if isinstance(model, MovingModel) else [model]
    unknown, planes = [None] * len(models), _planes(measures)
    scene = Scene(title, errors=unknown, fields=_thickness(models), cavity=_cavity(model), planes=planes)
    sentence = report_text("model", "summary", model=model, moving="moving " if moving else "")
    fit = model.record
    status, found = (fit.status, remarks_of(fit)) if measures is None else (measures.status, measures.remarks)
    parts = [
        sections.summary(sentence, status, found),
        Section("Model", viewer(model, scene)),
        *([] if measures is None else heart_sections(measures)),
        sections.parameters(model, None),
        sections.methods("", record)[1],
    ]
    return _page(title, parts)


def _page(title: str, parts: Sequence[Section]) -> bytes:
    return page(title, report_text("page", "lead"), parts, source("viewer/viewer.css"))


def _by_name(residuals: Array | dict[str, Array], clouds: Clouds) -> dict[str, Array]:
    return residuals if isinstance(residuals, dict) else {next(iter(clouds)): residuals}


def _thickness(models: Sequence[DeformableModel]) -> list[ScalarField]:
    return [thickness_field(models)] if models[0].surfaces.keys() >= WALLS else []


def _cavity(model: DeformableModel | MovingModel) -> str:
    return "endo" if "endo" in model.surfaces else next(iter(model.surfaces))


def _planes(measures: Measures | None) -> list[Plane] | None:
    """The base of each frame, where the cavity of the viewer's volumes ends; None where a surface is closed."""
    found = [plane for plane in (() if measures is None else measures.planes) if plane is not None]
    return [(plane.point, plane.direction) for plane in found] or None


def _fit_words(fit: Fit) -> str:
    method = report_text("fit", "paper" if fit.enriched is None else "tangent")
    return report_text("fit", "methods", fit=fit, method=method, **_model_words(fit.model))


def _track_words(found: Track) -> str:
    shifts = report_text("track", "shifts", count=len(found.shifts)) if found.shifts else ""
    words = {"frames": len(found.models), "strengths": ", ".join(f"{strength:.3g}" for strength in found.strengths)}
    return report_text("track", "methods", track=found, shifts=shifts, **words, **_model_words(found.models[0]))


def _model_words(model: DeformableModel) -> dict[str, str]:
    box = " x ".join(str(count) for count in model.box.control_points.shape[:3])
    return {"surfaces": _surfaces(model), "box": box, "unit": model.unit.replace("unknown", "units")}


def _surfaces(model: DeformableModel) -> str:
    kinds = ", ".join(f"{name} ({surface.kind})" for name, surface in model.surfaces.items())
    return f"superquadrics for {kinds}" if len(model.surfaces) > 1 else f"a superquadric ({kinds.split('(')[1]}"
