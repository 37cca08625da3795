"""The notebooks: their structure, and (``-m notebooks``) their execution with and without real data.

The build of the documentation executes each of them once; the marked tests are for work on the notebooks.
"""

import os
import re
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="pip install nbformat")

FOLDER = Path(__file__).parents[1] / "notebooks"
PATHS = sorted(FOLDER.glob("*.ipynb"))
SECONDS = 240  # after which a cell is taken to hang
LINES = 18  # of code in a cell
WORDS = re.compile(r"[a-z]+(-[a-z0-9]+)*")  # not the eight random digits that some tools write
SENTENCE = 40  # words

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning:jupyter_client")


@pytest.fixture(params=PATHS, ids=lambda path: path.stem)
def notebook(request):
    return nbformat.read(request.param, as_version=4)


def code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def prose(notebook):
    return [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]


def test_there_are_six_in_their_order():
    assert [path.name[0] for path in PATHS] == list("123456")


def test_it_is_a_valid_notebook(notebook):
    nbformat.validate(notebook)
    assert (notebook.nbformat, notebook.nbformat_minor) == (4, 5)


def test_no_outputs_are_stored(notebook):
    for cell in code(notebook):
        assert (cell.outputs, cell.execution_count) == ([], None), cell.id


def test_metadata_contain_only_the_kernel(notebook):
    assert notebook.metadata == {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    assert all(cell.metadata == {} for cell in notebook.cells)


def test_cell_ids_are_words(notebook):
    ids = [cell.id for cell in notebook.cells]
    assert len(set(ids)) == len(ids)
    for one in ids:
        assert WORDS.fullmatch(one), one


def test_first_and_last_sections_are_present(notebook):
    first, last = prose(notebook)[0], prose(notebook)[-1]
    assert notebook.cells[0].source == first
    assert notebook.cells[-1].source == last
    assert re.match(r"# \d\. ", first)
    assert "**What you learn:**" in first
    assert "## What to do next" in last
    assert "## What this does not show" in last


def test_the_introduction_states_whether_data_are_simulated(notebook):
    assert re.search(r"\bsimulated\b", prose(notebook)[0])


def test_it_has_one_title(notebook):
    assert sum(len(re.findall(r"(?m)^# ", text)) for text in prose(notebook)) == 1


def test_cells_are_short(notebook):
    for cell in code(notebook):
        assert len([line for line in cell.source.splitlines() if line.strip()]) <= LINES, cell.id


def test_sentences_are_short(notebook):
    for text in prose(notebook):
        for sentence in re.split(r"[.:?!]\s|\n\n|\n- ", re.sub(r"`[^`]*`", "code", text)):
            assert len(sentence.split()) <= SENTENCE, sentence


def test_no_paths_or_shell_commands(notebook):
    for cell in notebook.cells:
        assert not re.search(r"(?<![\w.:/])(/[a-z]\w*/|~/|[A-Z]:\\)", cell.source), f"{cell.id}: an absolute path"
    for cell in code(notebook):
        assert ".show(" not in cell.source, f"{cell.id}: plots are displayed without show"
        assert not re.search(r"(?m)^[!]", cell.source), f"{cell.id}: a shell command"


def test_no_private_names(notebook):
    for cell in code(notebook):
        assert not re.search(r"fitmodels\.[\w.]*\._|\b\w+\._[a-z]", cell.source), cell.id


def executed(path, folder, data):
    """The executed notebook; one thread, with or without real data."""
    nbclient = pytest.importorskip("nbclient", reason="pip install nbclient ipykernel")
    pytest.importorskip("ipykernel", reason="pip install nbclient ipykernel")
    env = {name: value for name, value in os.environ.items() if name != "FITMODELS_DATA"}
    env |= {"OMP_NUM_THREADS": "1"} | ({"FITMODELS_DATA": data} if data else no_network(folder))
    notebook = nbformat.read(path, as_version=4)
    where = {"metadata": {"path": str(folder)}}
    client = nbclient.NotebookClient(
        notebook, timeout=SECONDS, kernel_name="python3", resources=where, allow_errors=True
    )
    client.execute(env=env)
    for cell, out in outputs(notebook):
        assert out.output_type != "error", f"{cell.id}: {out.ename}: {out.evalue}"
        assert not data or out.get("name") != "stderr", (
            f"{cell.id}: {out.text}"
        )  # a download reports its progress there
    return notebook


def no_network(folder):
    """An empty cache and a proxy address without a server, so that nothing can be downloaded."""
    unreachable = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), "http://127.0.0.1:9")
    return unreachable | {"XDG_CACHE_HOME": str(folder), "no_proxy": "", "NO_PROXY": ""}


def outputs(notebook):
    return [(cell, out) for cell in code(notebook) for out in cell.outputs]


def printed(notebook):
    return "".join(out.text for _, out in outputs(notebook) if out.output_type == "stream")


def figures(notebook):
    return [out for _, out in outputs(notebook) if "image/png" in out.get("data", {})]


@pytest.mark.notebooks
@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_it_runs_and_shows_its_figures(path, tmp_path):
    notebook = executed(path, tmp_path, os.environ.get("FITMODELS_DATA"))
    assert len(figures(notebook)) >= 2


@pytest.mark.notebooks
def test_missing_real_data_are_skipped_with_a_reason(tmp_path):
    notebook = executed(FOLDER / "6_real_data.ipynb", tmp_path, None)
    text = printed(notebook)
    assert text.count("skipped: ") == 3
    assert "available: none" in text
    assert len(figures(notebook)) == 2  # of the bundled sets
    assert all(cell.outputs for cell in code(notebook)[:8])
