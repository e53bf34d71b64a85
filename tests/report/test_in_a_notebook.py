"""Models show themselves in a real notebook kernel, without being asked."""

import pytest

CODE = """
import numpy as np
import quadriform as qf
surface = qf.Superquadric(semi_axes=np.array([3.0, 2.0, 1.0]))
qf.DeformableModel({"surface": surface}, qf.ControlBox.around(surface))
"""


@pytest.mark.slow
def test_a_model_at_the_end_of_a_cell_is_a_viewer():
    client = pytest.importorskip("nbclient", reason="nbclient is not installed: no notebook was run")
    formats = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed: no notebook was run")
    notebook = formats.v4.new_notebook(cells=[formats.v4.new_code_cell(CODE)])
    client.NotebookClient(notebook, timeout=60, kernel_name="python3").execute()
    shown = notebook.cells[0].outputs[0]["data"]
    assert shown["text/html"].startswith("<iframe") and "DeformableModel" in shown["text/plain"]
