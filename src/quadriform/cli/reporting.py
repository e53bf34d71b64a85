"""Pages of `fit` and `track`: points and image in the frame of the model, measures of a ventricle."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from inspect import signature
from typing import Any

import numpy as np

from quadriform.cli.screen import note
from quadriform.errors import QuadriformError
from quadriform.fitting.options import options_for
from quadriform.fitting.population.checks import OF_PRIOR
from quadriform.fitting.result import Fit
from quadriform.heart.measure import measure
from quadriform.heart.measures_table import Measures
from quadriform.imaging.frame_series import FrameSeries
from quadriform.imaging.volume import Volume
from quadriform.motion.track import Track
from quadriform.motion.tracking import track
from quadriform.points import Array
from quadriform.report.reports import fit_report, track_report
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.prior import ShapePrior
from quadriform.shapes.spaces import rotation_between

Record = Mapping[str, Any]
REPORT = "report.html"
NOT_SHOWN = ("progress", "slices")


def fit_options(given: Mapping[str, Any]) -> dict[str, Any]:
    """All options of a fit: those given, and the defaults of the others."""
    others = {"method": "tangent", "kind": "ellipsoid"} | dict(given)
    first = {name: others.pop(name) for name in ("method", "kind")}
    of_points = {name: others.pop(name) for name in ("noise", "viewpoint", "support") if name in others}
    if "prior" not in others:
        return {"options": first | asdict(options_for(str(first["method"]), others)) | of_points}
    prior = _words_of(others.pop("prior"))
    chosen = asdict(options_for(str(first["method"]), others))
    kept = {name: value for name, value in (first | chosen).items() if name not in ("kind", *OF_PRIOR)}
    return {"options": kept | of_points | {"prior": prior}}


def track_options(given: Mapping[str, Any]) -> dict[str, Any]:
    """All options of a cycle: those given, and the defaults of the others."""
    defaults = {name: p.default for name, p in signature(track).parameters.items() if p.default is not p.empty}
    chosen = {name: given.get(name, value) for name, value in defaults.items() if name not in NOT_SHOWN}
    prior = chosen.pop("prior")
    if prior is None:
        return {"options": chosen}
    kept = {name: value for name, value in chosen.items() if name not in OF_PRIOR}
    return {"options": kept | {"prior": _words_of(prior)}}


def _words_of(prior: ShapePrior) -> str:
    return f"of {prior.n_models} shapes"


def page_of_fit(
    fit: Fit,
    clouds: Mapping[str, Array],
    image: Volume | None,
    space: str,
    title: str,
    record: Record,
) -> bytes:
    """The page of a fit.

    Args:
        fit: in the frame that was asked for.
        clouds: surface -> points, in `space`.
        image: from which they came, likewise, or None.
        space: frame of the input.
        title: of the page.
        record: what the terminal shows.
    """
    rotation = rotation_between(space, fit.model.space)
    rotated = {name: cloud @ rotation.T for name, cloud in clouds.items()}
    if image is not None:
        # the image rotates with its points: its voxels stay, their places in the world change
        affine = np.vstack([rotation @ image.world_from_voxel[:3], image.world_from_voxel[3:]])
        image = replace(image, world_from_voxel=affine, space=fit.model.space)
    found = measures_of([fit.model], None)
    return fit_report(fit, rotated, title=title, record=record, image=image, measures=found)


def page_of_track(found: Track, frames: FrameSeries, title: str, record: Record, measures: Measures | None) -> bytes:
    """The page of a moving model; points are shown where their slices move them.

    Args:
        found: in the frame that was asked for.
        frames: the points.
        title: of the page.
        record: what the terminal shows.
        measures: of a ventricle.
    """
    rotation = rotation_between(frames.space_and_unit[0], found.models[0].space)
    shown = []
    for number, frame in enumerate(frames.clouds):
        rotated = {name: cloud @ rotation.T for name, cloud in frame.items()}
        for name, which in (frames.slice_of_point[number] if found.moves else {}).items():
            for slice_number, move in found.moves.items():  # a slice that was not moved has no entry
                rotated[name][which == slice_number] = move.apply(rotated[name][which == slice_number])
        shown.append(rotated)
    return track_report(found, shown, title=title, record=record, measures=measures)


def measures_of(models: Sequence[DeformableModel], times: Array | None) -> Measures | None:
    """The measures of models with a surface "endo"; None, with a note, where they cannot be measured."""
    if "endo" not in models[0].surfaces:
        return None
    try:
        return measure(models, times)
    except QuadriformError as error:
        note(f"the report has no measures of the ventricle: {error}")
        return None
