"""The tutorials run from top to bottom. Their last cells, which the documentation hides, assert what the text says."""

from __future__ import annotations

from pathlib import Path

import pytest
from myst_nb.core.read import read_myst_markdown_notebook
from nbclient import NotebookClient

pytestmark = pytest.mark.slow

DOCS = Path(__file__).parent.parent / "docs"
TUTORIALS = sorted((DOCS / "tutorials").glob("*.md"))


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_runs_and_learns_what_it_says(page: Path, tmp_path: Path) -> None:
    notebook = read_myst_markdown_notebook(page.read_text())
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert "\nassert " in f"\n{code[-1].source}"
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert any("image/png" in output.get("data", {}) for cell in code for output in cell.outputs)


def test_every_tutorial_is_in_the_contents() -> None:
    contents = (DOCS / "index.md").read_text()
    assert TUTORIALS
    assert [page.stem for page in TUTORIALS if f"\ntutorials/{page.stem}\n" not in contents] == []
