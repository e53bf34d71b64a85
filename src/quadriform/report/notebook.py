"""Pages of models and fits for notebooks and browsers."""

from __future__ import annotations

import tempfile
import webbrowser
from pathlib import Path

from markupsafe import Markup, escape

from quadriform.errors import OptionError
from quadriform.fitting.result import Fit
from quadriform.motion.track import Track
from quadriform.report.fields import uncertainty_field
from quadriform.report.page import Section, page, source
from quadriform.report.parts import table
from quadriform.report.viewer import Scene, viewer
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel
from quadriform.shapes.record import remarks_of

Shown = DeformableModel | MovingModel | Fit | Track
HEIGHT = 760
"""Height of the frame in a notebook, in pixels."""


def show(thing: Shown) -> Path:
    """The page with the model, opened in the browser.

    Args:
        thing: a model, a moving model, or what `fit` or `track` returned.

    Returns:
        The page, a temporary file.

    Raises:
        OptionError: something else, or frames that were tracked alone and so are no moving model.
    """
    # not deleted when it is closed: the browser reads it after that
    with tempfile.NamedTemporaryFile(suffix=".html", prefix="quadriform-", delete=False) as file:
        file.write(_page(thing))
    path = Path(file.name)
    webbrowser.open(path.as_uri())
    return path


def as_html(thing: Shown) -> str:
    """The page as an inline frame for a notebook, sandboxed: its script has no access to the notebook."""
    # srcdoc is an attribute: the page in it is escaped a second time
    text = escape(_page(thing).decode())
    frame = '<iframe sandbox="allow-scripts" style="width: 100%; height: {}px; border: 0" srcdoc="{}"></iframe>'
    return str(Markup(frame).format(HEIGHT, text))


def _page(thing: Shown) -> bytes:
    model, scene, rows = _parts(thing)
    remarks = [(remark.kind or "note", remark.text) for remark in remarks_of(model.record)]
    facts = [("status", model.status), *remarks, ("parameters", str(model.n_parameters)), *rows]
    return page("model", "", [Section("Model", viewer(model, scene) + table((), facts))], source("viewer/viewer.css"))


def _parts(thing: Shown) -> tuple[DeformableModel | MovingModel, Scene, list[tuple[str, str]]]:
    if isinstance(thing, Fit):
        rows = [("points", str(thing.n_points))]
        # only the default method computes a covariance
        fields = [] if thing.enriched is None else [uncertainty_field(thing)]
        return thing.model, Scene(errors=[thing.rms], fields=fields), rows
    if isinstance(thing, Track):
        if thing.moving is None:
            raise OptionError("show: frames that were tracked alone are no moving model; show one of their models")
        return thing.moving, Scene(errors=thing.frame_rms.tolist()), []
    if isinstance(thing, MovingModel):
        return thing, Scene(errors=[None] * len(thing.frame_times)), []
    if isinstance(thing, DeformableModel):
        return thing, Scene(), []
    raise OptionError(f"show: expected a model, a fit or a track, found {type(thing).__name__}")
