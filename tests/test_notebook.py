"""The notebook of the documentation runs."""

from pathlib import Path

import nbformat
import pytest

pytestmark = pytest.mark.slow
NOTEBOOK = Path(__file__).parents[1] / "docs" / "notebook.ipynb"


@pytest.mark.filterwarnings("ignore")  # of Jupyter's own
def test_the_notebook_runs(tmp_path):
    from nbclient import NotebookClient  # noqa: PLC0415

    book = nbformat.read(NOTEBOOK, as_version=4)
    NotebookClient(book, timeout=200, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown, figures, states, gradient = (cell.outputs for cell in book.cells if cell.cell_type == "code")
    assert "<iframe" in shown[-1]["data"]["text/html"]
    assert "(400, 400, 3)" in figures[-1]["data"]["text/plain"]
    assert "30 of 30" in "".join(output["text"] for output in states)  # which comes in pieces
    assert "2])" in gradient[-1]["data"]["text/plain"]
    assert not [*tmp_path.iterdir()]
