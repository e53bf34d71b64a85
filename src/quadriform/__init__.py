"""From unstructured 3D points to a compact, smooth, volumetric model.

The public names are listed in __init__.pyi; each is imported when it is first used, so that `import quadriform` stays
fast.
"""

import sys
from importlib import import_module

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

_DISPLAYED = "shapes.model.DeformableModel fitting.result.Fit shapes.moving_model.MovingModel motion.track.Track"


def _show_in_notebooks() -> None:
    """Register how a notebook displays models and fits; their own layers import no pictures."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is None:
        return
    formatter = shell.display_formatter.formatters["text/html"]
    for path in _DISPLAYED.split():
        module, _, name = f"quadriform.{path}".rpartition(".")
        formatter.for_type_by_name(module, name, lambda x: import_module("quadriform.report.notebook").as_html(x))


_show_in_notebooks()
