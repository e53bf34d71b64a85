"""Models show themselves in a real notebook kernel, without being asked."""

from dataclasses import replace
from html import unescape

import numpy as np
import pytest

from quadriform.errors import WarningKind
from quadriform.report.notebook import as_html
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.record import NOT_RECORDED, ModelRecord
from quadriform.shapes.superquadric import Superquadric

CODE = """
import numpy as np
import quadriform as qf
surface = qf.Superquadric(semi_axes=np.array([3.0, 2.0, 1.0]))
qf.DeformableModel({"surface": surface}, qf.ControlBox.around(surface))
"""


def test_a_model_at_the_end_of_a_cell_is_a_viewer():
    client = pytest.importorskip("nbclient", reason="nbclient is not installed: no notebook was run")
    formats = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed: no notebook was run")
    notebook = formats.v4.new_notebook(cells=[formats.v4.new_code_cell(CODE)])
    client.NotebookClient(notebook, timeout=60, kernel_name="python3").execute()
    shown = notebook.cells[0].outputs[0]["data"]
    assert shown["text/html"].startswith("<iframe") and "DeformableModel" in shown["text/plain"]


def test_the_warnings_of_a_model_are_shown_with_it():
    surface = Superquadric(semi_axes=np.array([3.0, 2.0, 1.0]))
    record = ModelRecord("warned", {WarningKind.POOR_FIT: "a <b>bad</b> one"}, ("a remark",))
    model = DeformableModel({"surface": surface}, ControlBox.around(surface), record=record)
    text = unescape(as_html(model))
    for shown in ("warned", "POOR_FIT", "a &lt;b&gt;bad&lt;/b&gt; one", "a remark"):
        assert shown in text
    assert NOT_RECORDED in unescape(as_html(replace(model, record=ModelRecord())))
