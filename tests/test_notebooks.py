"""The notebooks run from top to bottom, store small outputs, and hold no logic that belongs into the package."""

import ast
import json
import re
import runpy
import sys
from pathlib import Path
from typing import Any

import pytest
from matplotlib import pyplot

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


def code_cells(path: Path) -> list[dict[str, Any]]:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def test_there_are_notebooks() -> None:
    assert NOTEBOOKS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The cells are plain Python, so they need no kernel, whose sockets would be one more thing to go wrong.
    script = tmp_path / "notebook.py"
    script.write_text("\n\n".join("".join(cell["source"]) for cell in code_cells(path)), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [str(tmp_path), *sys.path])
    # A notebook begins without another one's figures.
    pyplot.close("all")
    with pyplot.rc_context():
        runpy.run_path(str(script), run_name="__main__")
    pyplot.close("all")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_it_stores_reads_well_and_is_small(path: Path) -> None:
    cells = code_cells(path)
    counts = [cell["execution_count"] for cell in cells if "page" not in cell["metadata"].get("tags", [])]
    assert counts == sorted(counts)
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert {output["output_type"] for output in outputs} <= {"stream", "display_data", "execute_result"}
    assert path.stat().st_size < 400_000
    text = json.dumps(outputs)
    assert not re.search(r"/root/|/home/|/tmp/|/work/|Warning", text)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_shows_its_hypothesis_as_a_picture_and_as_a_page(path: Path) -> None:
    cells = code_cells(path)
    tables = [
        "".join(output["data"].get("text/html", "")) for cell in cells for output in cell["outputs"] if "data" in output
    ]
    assert any("<table>" in table and "data:image/png;base64" in table for table in tables)
    pages = [cell for cell in cells if "page" in cell["metadata"].get("tags", [])]
    assert pages
    assert all("".join(cell["source"]).endswith(".show()") and not cell["outputs"] for cell in pages)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_defines_nothing_large(path: Path) -> None:
    trees = [ast.parse("".join(cell["source"])) for cell in code_cells(path)]
    definitions = [
        node for tree in trees for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.ClassDef))
    ]
    for node in definitions:
        assert isinstance(node, ast.FunctionDef), f"the class {node.name} belongs into the package"
        assert node.end_lineno - node.lineno < 10, f"{node.name} belongs into the package"
