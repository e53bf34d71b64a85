"""Whole reports: of a fit, of a moving model, of a model alone."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from quadriform.fitting.result import Fit
from quadriform.heart.measures_table import Measures
from quadriform.imaging.volume import Volume
from quadriform.motion.track import Track
from quadriform.points import Array
from quadriform.report import sections
from quadriform.report.fields import residual_field, thickness_field, uncertainty_field
from quadriform.report.heart_sections import heart_sections
from quadriform.report.page import Section, page, report_text, source
from quadriform.report.slices import planes_section
from quadriform.report.viewer import Scene, viewer
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.record import remarks, remarks_of

WALLS = {"endo", "epi"}
Clouds = Mapping[str, Array]
AnyModel = DeformableModel | MovingModel


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
    model, unit = fit.model, _unit(fit.model)
    residuals, before = _by_name(fit.residuals, clouds), _by_name(fit.superquadric_residuals, clouds)
    # the longest side: an error below half of it is below what the image resolves
    voxel = None if image is None else float(image.spacing.max())
    sentence = report_text("fit", "summary", fit=fit, unit=unit, support=_support_text(fit))
    points = {name: [cloud] for name, cloud in clouds.items()}
    signed = {name: [values] for name, values in residuals.items()}
    fields = [residual_field([model], points, signed)]
    if fit.enriched is not None:
        fields.append(uncertainty_field(fit))
    parts = [
        sections.summary(sentence, fit.status, remarks(fit.warnings, fit.notes)),
        _shown(model, [model], Scene(title, points, signed, [fit.rms], fields), measures),
        sections.errors(residuals, before, unit, voxel),
    ]
    if image is not None:
        parts.append(planes_section(image, {name: model.mesh(name) for name in model.surfaces}, title))
    parts += heart_sections(measures)
    parts += [sections.convergence(fit.history, unit), sections.parameters(model, fit.n_points)]
    method = report_text("fit", _method(fit))
    words = report_text("fit", "methods", fit=fit, method=method, **_model_words(model))
    return _page(title, [*parts, sections.description(words), sections.configuration(record)])


def _method(fit: Fit) -> str:
    if fit.enriched is None:
        return "paper"
    return "tangent" if fit.prior_distance is None else "prior"


def _support_text(fit: Fit) -> str:
    """A phrase with the share of each surface that data supports, and the volumes with their extrapolated share."""
    texts = []
    for name, each in fit.support.items():
        about = f"of {name}" if len(fit.support) > 1 else "of the surface"
        texts.append(f"{100 * each.area:.0f} % of the area {about} (volume {fit.volume(name)})")
    return ", ".join(texts)


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
    model: AnyModel = found.models[0] if found.moving is None else found.moving
    unit = _unit(model)
    # frames that were fitted alone have no common motion to play; the first stands for them
    count = 1 if found.moving is None else len(found.models)
    points = {name: [frame[name] for frame in clouds[:count]] for name in model.surfaces}
    signed = {name: [frame[name] for frame in found.residuals[:count]] for name in model.surfaces}
    models = found.models[:count]
    scene = Scene(title, points, signed, found.frame_rms[:count].tolist(), [residual_field(models, points, signed)])
    worst = int(found.frame_rms.argmax())
    words = {"frames": len(found.models), "worst": worst, "worst_rms": found.frame_rms[worst], "unit": unit}
    together = {name: np.concatenate([frame[name] for frame in found.residuals]) for name in model.surfaces}
    parts = [
        sections.summary(
            report_text("track", "summary", track=found, **words), found.status, remarks(found.warnings, found.notes)
        ),
        _shown(model, models, scene, measures),
        *heart_sections(measures),
        sections.errors(together, None, unit, None),
        *sections.slice_motions(found.moves, unit),
        sections.parameters(model, sum(map(len, together.values()))),
        sections.description(_track_words(found)),
        sections.configuration(record),
    ]
    return _page(title, parts)


def model_report(model: AnyModel, *, title: str, record: Mapping[str, Any], measures: Measures | None = None) -> bytes:
    """The page of a model without the data it was fitted to.

    Args:
        model: a model or a moving model.
        title: plain text.
        record: where it comes from.
        measures: of a ventricle.
    """
    moving = isinstance(model, MovingModel)
    models = [model.at(t) for t in model.frame_times] if isinstance(model, MovingModel) else [model]
    sentence = report_text("model", "summary", model=model, moving="moving " if moving else "")
    fit = model.record
    status, found = (fit.status, remarks_of(fit)) if measures is None else (measures.status, measures.remarks)
    parts = [
        sections.summary(sentence, status, found),
        _shown(model, models, Scene(title, errors=[None] * len(models)), measures),
        *heart_sections(measures),
        sections.parameters(model, None),
        sections.configuration(record),
    ]
    return _page(title, parts)


def _page(title: str, parts: Sequence[Section]) -> bytes:
    return page(title, report_text("page", "lead"), parts, source("viewer/viewer.css"))


def _shown(model: AnyModel, models: Sequence[DeformableModel], scene: Scene, measures: Measures | None) -> Section:
    """The viewer; of a ventricle with the thickness of its wall, and the base that its volumes are below."""
    walls = [thickness_field(models)] if model.surfaces.keys() >= WALLS else []
    bases = [plane for plane in (() if measures is None else measures.planes) if plane is not None]
    # without a base the surface is closed
    planes = [(plane.point, plane.direction) for plane in bases] or None
    return Section("Model", viewer(model, replace(scene, fields=[*scene.fields, *walls], planes=planes)))


def _by_name(residuals: Array | dict[str, Array], clouds: Clouds) -> dict[str, Array]:
    return residuals if isinstance(residuals, dict) else {next(iter(clouds)): residuals}


def _unit(model: AnyModel) -> str:
    return model.unit.replace("unknown", "units")


def _track_words(found: Track) -> str:
    moves = report_text("track", "moves", count=len(found.moves)) if found.moves else ""
    words = {"frames": len(found.models), "strengths": ", ".join(f"{strength:.3g}" for strength in found.strengths)}
    return report_text("track", "methods", track=found, moves=moves, **words, **_model_words(found.models[0]))


def _model_words(model: DeformableModel) -> dict[str, str]:
    box = " x ".join(str(count) for count in model.box.control_points.shape[:3])
    named = [f"{name} ({surface.kind})" for name, surface in model.surfaces.items()]
    one = f"a superquadric ({next(iter(model.surfaces.values())).kind})"
    surfaces = f"superquadrics for {', '.join(named)}" if len(named) > 1 else one
    return {"surfaces": surfaces, "box": box, "unit": _unit(model)}
