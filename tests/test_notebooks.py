"""The notebooks: text and notebook file in step, one question each, public names alone, and each one runs and holds.

A notebook asserts its own conclusion in its last cell; running it here is what keeps that conclusion true.
"""

from __future__ import annotations

import ast
import os
import re
from collections.abc import Iterator
from pathlib import Path

import jupytext
import nbformat
import pytest
from jupyter_client.manager import KernelManager
from nbclient import NotebookClient
from nbformat import NotebookNode

import insgnss

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "notebooks"
GALLERY = (ROOT / "docs" / "notebooks.md").read_text(encoding="utf-8")
NAMES = sorted(path.stem for path in FOLDER.glob("*.py"))
# "**Question.** ...?" is the second paragraph, below the title, which carries the file's number
OPENING = re.compile(r"\A# (?P<number>\d\d) .+\n\n\*\*Question\.\*\* (?P<question>[^?]+\?)")
# a room is open to everybody if the gallery's last paragraph names it
OPEN_ROOMS = set(re.findall(r"`(insgnss(?:\.\w+)+)`", GALLERY))
CELL_LIMIT_S = 300

each_notebook = pytest.mark.parametrize("name", NAMES)


def text_of(name: str) -> NotebookNode:
    """Return the notebook as its text file tells it."""
    return jupytext.read(FOLDER / f"{name}.py")


def stored(name: str) -> NotebookNode:
    """Return the notebook as its notebook file tells it."""
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def statements(name: str) -> Iterator[ast.AST]:
    """Yield every node of the code of a notebook."""
    for cell in text_of(name).cells:
        if cell.cell_type == "code":
            yield from ast.walk(ast.parse(cell.source))


def imported(name: str) -> Iterator[tuple[str, str]]:
    """Yield module and name ('' for the module itself) of everything a notebook imports from the package."""
    for node in statements(name):
        if isinstance(node, ast.Import):
            yield from ((a.name, "") for a in node.names if a.name.split(".")[0] == "insgnss")
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "insgnss":
            yield from ((node.module or "", a.name) for a in node.names)


def is_open(module: str, name: str) -> bool:
    """Return whether a name is the package's own public one, or of a room that the gallery names."""
    if module == "insgnss" and name in ("", *insgnss.__all__):
        return True
    return any(f"{module}.{name}.".startswith(f"{room}.") for room in OPEN_ROOMS if room != "insgnss")


def test_there_are_notebooks_and_each_number_stands_once() -> None:
    numbers = [name[:2] for name in NAMES]

    assert NAMES
    assert [n for n in NAMES if not re.fullmatch(r"\d\d_[a-z0-9_]+", n)] == []
    assert len(set(numbers)) == len(numbers)


def test_every_text_has_its_notebook_file_and_the_other_way_round() -> None:
    assert NAMES == sorted(path.stem for path in FOLDER.glob("*.ipynb"))


@each_notebook
def test_notebook_file_is_in_step_with_its_text(name: str) -> None:
    def cells(notebook: NotebookNode) -> list[tuple[str, str]]:
        return [(cell.cell_type, cell.source) for cell in notebook.cells]

    assert cells(stored(name)) == cells(text_of(name)), "run: make pair"


@each_notebook
def test_notebook_file_has_no_outputs_and_every_cell_its_own_id(name: str) -> None:
    cells = stored(name).cells

    assert [c.id for c in cells if c.cell_type == "code" and (c.outputs or c.execution_count)] == []
    assert len({c.id for c in cells}) == len(cells)


@each_notebook
def test_notebook_begins_with_its_question_which_the_gallery_repeats(name: str) -> None:
    opening = OPENING.match(text_of(name).cells[0].source)

    assert opening is not None
    assert opening["number"] == name[:2]
    row = re.search(rf"^\| \[{name}\]\(\.\./notebooks/{name}\.ipynb\) \| (.+?) \|", GALLERY, re.MULTILINE)
    assert row is not None, "the gallery has no such row"
    assert row[1] == " ".join(opening["question"].split())


@each_notebook
def test_notebook_ends_by_asserting_its_answer_and_printing_it(name: str) -> None:
    last = text_of(name).cells[-1]
    kinds = [type(node).__name__ for node in ast.parse(last.source).body]

    assert last.cell_type == "code"
    assert "Assert" in kinds
    assert re.match(r"print\(f['\"]Answer: ", ast.unparse(ast.parse(last.source).body[-1]))


@each_notebook
def test_notebook_imports_only_what_is_open_to_everybody(name: str) -> None:
    hidden = {
        getattr(node, field)
        for node in statements(name)
        for field in ("id", "attr", "name")
        if re.match(r"_[a-z]", str(getattr(node, field, "")))
    }

    assert [f"{module}: {what}" for module, what in imported(name) if not is_open(module, what)] == []
    assert hidden == set()


def pictures_drawn(name: str) -> int:
    """Return how many figures a notebook draws: by pyplot, or by a function of the package at the end of a cell."""
    by_pyplot = sum(isinstance(n, ast.Attribute) and n.attr == "subplots" for n in statements(name))
    cells = [ast.parse(cell.source).body for cell in text_of(name).cells if cell.cell_type == "code"]
    last = [ast.unparse(body[-1].value.func) for body in cells if is_call(body)]
    return by_pyplot + sum(bool(re.search(r"figure(s\.\w+)?$", function)) for function in last)


def is_call(body: list[ast.stmt]) -> bool:
    """Return whether a cell ends with a call whose value is shown."""
    return bool(body) and isinstance(body[-1], ast.Expr) and isinstance(body[-1].value, ast.Call)


@pytest.fixture(scope="module")
def kernel() -> Iterator[KernelManager]:
    """Return a kernel for all notebooks: to start one and import the libraries takes as long as many a notebook."""
    manager = KernelManager(kernel_name="python3")
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    manager.start_kernel(env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)}, cwd=str(FOLDER))
    yield manager
    manager.shutdown_kernel(now=True)


# what a notebook would find in a kernel of its own: no name, no open figure, no changed setting, its own folder
AS_NEW = f"""
import os, matplotlib.pyplot
os.chdir({str(FOLDER)!r})
matplotlib.pyplot.close("all")
matplotlib.rcdefaults()
%reset_selective -f .
"""


@each_notebook
def test_notebook_takes_no_module_that_it_does_not_import(name: str) -> None:
    """Another notebook's import would hide it in a kernel that they share."""
    read = {
        node.attr
        for node in statements(name)
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "insgnss"
    }

    assert read <= set(insgnss.__all__)


@each_notebook
def test_notebook_runs_and_its_conclusion_holds(name: str, kernel: KernelManager) -> None:
    """Run it in its own folder, as somebody would who opened it."""
    notebook = stored(name)
    notebook.cells.insert(0, nbformat.v4.new_code_cell(AS_NEW))
    client = NotebookClient(notebook, km=kernel, timeout=CELL_LIMIT_S)

    try:
        client.execute()
    finally:
        if client.kc is not None:  # the kernel goes on, what was said to it does not
            client.kc.stop_channels()

    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert [output.text for output in outputs if output.get("name") == "stderr"] == []
    shown = [output.data for output in outputs if output.output_type in ("display_data", "execute_result")]
    assert sum("image/png" in data for data in shown) == pictures_drawn(name)
    assert [
        data for data in shown if "<Figure" in data.get("text/plain", "") and "image/png" not in data
    ] == []
    # a busy kernel may send one line in two pieces
    told = "".join(output.text for output in outputs if output.get("name") == "stdout")
    assert re.match(r"Answer: .*\d", told.splitlines()[-1])
