"""How the site is made: `make docs`, or sphinx-build -W --keep-going -b html docs out/docs. It needs no network."""

import json
import sys
from pathlib import Path
from typing import Any

from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx

import quadriform

sys.path.insert(0, str(Path(__file__).parent))
from equation_lines import with_lines

project = "quadriform"
author = "The quadriform developers"
version = release = quadriform.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
highlight_language = "text"  # of blocks that name none, such as commands
default_role = "code"  # docstrings write `name`, as Markdown does
napoleon_use_ivar = True  # attributes are documented in the text of their class
napoleon_attr_annotations = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the texts say shapes and units, which types cannot
autodoc_preserve_defaults = True
myst_heading_anchors = 3

html_theme = "furo"
html_title = f"quadriform {version}"
html_show_copyright = False
html_copy_source = False


class Notebook(MystParser):
    """Cells of a notebook as a page: Markdown as it is, code without outputs, of which the repository keeps none."""

    supported = ("ipynb",)

    def parse(self, inputstring: str, document: Any) -> None:
        """Fill `document` from the JSON of a notebook."""
        cells = json.loads(inputstring)["cells"]
        super().parse("\n\n".join(_markdown(cell["cell_type"], "".join(cell["source"])) for cell in cells), document)


def _markdown(kind: str, text: str) -> str:
    return text if kind == "markdown" else f"```ipython\n{text}\n```"


def _lines(app: Sphinx, page: str, source: list[str]) -> None:
    if page == "equations":
        source[0] = with_lines(source[0])


def setup(app: Sphinx) -> None:
    """Let pages be notebooks, and put file and line into the table of equations."""
    app.connect("source-read", _lines)
    app.add_source_suffix(".ipynb", "ipynb")
    app.add_source_parser(Notebook)
