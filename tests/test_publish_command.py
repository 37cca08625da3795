"""``fitmodels publish`` and ``fitmodels card``: exit codes, sentences, and nothing half-written."""

import importlib
import json

import pytest
from fitmodels import parameters
from fitmodels.cli import _guarded
from fitmodels.parameters.sections.law import EXAMPLE

TOML = """license = "CC-BY-4.0"
authors = ["Doe, Jane"]
contact = "jane.doe@example.org"
machine = "a lathe"
setup = "dry"
no_sensors = "read by eye"
iso513 = "P20"
"""


def command(name, capsys, *words):
    """Exit code, standard output and standard error of a command."""
    module = importlib.import_module(f"fitmodels.cli.{name}")
    try:
        code = _guarded(module.run, module.parser().parse_args([str(word) for word in words]))
    except SystemExit as stop:
        code = stop.code
    out, err = capsys.readouterr()
    return code, " ".join(out.split()), err


def add(folder, name, work="709M40", toml=TOML, **changed):
    home = folder / name
    home.mkdir(parents=True)
    pf = parameters.collect(
        tool="GC435", work=work, limits={"power": 7}, data_sha256="a" * 64, simulated=True, **changed
    )
    parameters.write(pf, home / "params.json")
    if toml is not None:
        (home / "card.toml").write_text(toml, encoding="utf-8")
    return home


@pytest.fixture
def pairs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    add(tmp_path / "pairs", "one")
    add(tmp_path / "pairs", "two", work="Ti-6Al-4V")
    return tmp_path / "pairs"


def content(top):
    return {path.relative_to(top).as_posix(): path.read_bytes() for path in sorted(top.rglob("*")) if path.is_file()}


# --- publish


def test_a_site_is_written_and_said(pairs, capsys, tmp_path):
    assert command("publish", capsys, "pairs", "--site", "site") == (0, "wrote site/index.html, 2 pairs", "")
    assert (tmp_path / "site" / "cards" / "gc435-709m40" / "index.html").is_file()
    assert command("publish", capsys, "pairs", "--site", "site") == (0, "site: unchanged, 2 pairs", "")


def test_another_site_needs_force(pairs, capsys, tmp_path):
    command("publish", capsys, "pairs", "--site", "site")
    add(pairs, "three", work="GGG40")
    code, out, err = command("publish", capsys, "pairs", "--site", "site")
    assert (code, out) == (2, "")
    assert err == "fitmodels: site: holds another site; replace it with --force, or choose another --site.\n"
    assert command("publish", capsys, "pairs", "--site", "site", "--force")[0] == 0
    assert len(list((tmp_path / "site" / "cards").iterdir())) == 3


@pytest.mark.parametrize("options", [("--check",), ("--site", "site"), ("--site", "site", "--check", "--jobs", "2")])
def test_what_lacks_is_listed_in_one_go_with_5_and_asked_for_in_a_template(pairs, capsys, tmp_path, options):
    add(pairs, "bare", work="S45C", toml=None)
    add(pairs, "half", work="C45", toml='license = "CC0-1.0"')
    code, out, err = command("publish", capsys, "pairs", *options)
    assert (code, err) == (5, "")
    assert (
        "FAIL bare: missing: license, authors, contact, machine, iso513, setup, sensors; add them in card.toml." in out
    )
    assert "FAIL half: missing: authors, contact, machine, iso513, setup, sensors; add them in card.toml." in out
    assert "wrote pairs/bare/card.toml: fill it in" in out
    assert out.endswith("2 of 4 pairs cannot be published; no site was written.")
    assert 'license = ""' in (pairs / "bare" / "card.toml").read_text("utf-8")
    assert (pairs / "half" / "card.toml").read_text() == 'license = "CC0-1.0"'
    assert not (tmp_path / "site").exists()


def test_a_template_that_is_filled_in_opens_the_gate(pairs, capsys):
    home = add(pairs, "bare", work="S45C", toml=None)
    assert command("publish", capsys, "pairs", "--check")[0] == 5
    (home / "card.toml").write_text(TOML, encoding="utf-8")
    assert command("publish", capsys, "pairs", "--check") == (
        0, "3 pairs, ready to publish.", ""
    )  # fmt: skip


def test_a_shut_gate_of_a_posterior_is_refused_and_the_old_site_stays(pairs, capsys, tmp_path):
    command("publish", capsys, "pairs", "--site", "site")
    before = content(tmp_path / "site")
    data = json.loads((pairs / "one" / "params.json").read_text("utf-8"))
    drawn = {"method": "exact", "draws": 4000, "r_hat": 1.2, "ess": 4000.0}
    shut = parameters.ParameterFile.model_validate({
        **data, "laws": {"AW": EXAMPLE}, "posterior": {"seed": 1, "laws": {"AW": drawn}}
    })  # fmt: skip
    parameters.write(shut, pairs / "one" / "params.json", force=True)
    code, out, _ = command("publish", capsys, "pairs", "--site", "site", "--force")
    assert code == 5
    assert "FAIL one: posterior.AW: R-hat 1.2 is above 1.01; draw again." in out
    assert content(tmp_path / "site") == before


def test_the_same_facts_as_json(pairs, capsys):
    add(pairs, "bare", work="S45C", toml=None)
    module = importlib.import_module("fitmodels.cli.publish")
    assert module.run(module.parser().parse_args(["pairs", "--check", "--json"])) == 5
    facts = json.loads(capsys.readouterr().out)
    assert facts["schema"] == "fitmodels.publish/1"
    assert (facts["ok"], facts["found"], facts["site"]) == (False, 3, None)
    assert facts["problems"][0]["folder"] == "bare"
    assert facts["problems"][0]["fields"][0] == "license"
    assert facts["templates"] == ["pairs/bare/card.toml"]


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (["pairs"], 2, "--site: give the folder of the site"),
        (["nowhere", "--site", "site"], 2, "nowhere: is no folder"),
        ([".hidden", "--site", "site"], 3, ".hidden: holds no params.json; fit first"),
        (["pairs", "--site", "pairs"], 2, "the site would be inside the folder of its pairs"),
        (["pairs", "--site", "site", "--jobs", "0"], 2, "0 is not a number of processes"),
        (["pairs", "--site", "site", "--title", " "], 2, "--title: is empty"),
        (["pairs", "--sit", "site"], 2, "did you mean --site?"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(pairs, capsys, tmp_path, words, code, sentence):
    (tmp_path / ".hidden").mkdir()
    found, out, err = command("publish", capsys, *words)
    assert (found, out) == (code, "")
    assert sentence in err
    assert "Traceback" not in err
    assert not (tmp_path / "site").exists()


# --- card


def test_a_card_is_written_beside_its_file_and_then_unchanged(pairs, capsys):
    file = "pairs/one/params.json"
    code, out, err = command("card", capsys, file)
    assert (code, err) == (0, "")
    assert out == "wrote pairs/one/README.md wrote pairs/one/card.json wrote pairs/one/card.html"
    card = json.loads((pairs / "one" / "card.json").read_text("utf-8"))
    assert card["publication"]["license"] == "CC-BY-4.0"
    assert card["identity"]["machine"] == "a lathe"
    assert command("card", capsys, file) == (0, "unchanged: README.md, card.json, card.html", "")


def test_what_a_card_does_not_tell_is_said(pairs, capsys):
    add(pairs, "bare", toml=None)
    out = command("card", capsys, "pairs/bare/params.json")[1]
    fields = "license, authors, contact, machine, iso513, setup, sensors"
    assert out.endswith(f"missing: {fields}; fitmodels publish asks for it in card.toml")


def test_a_card_that_tells_something_else_is_replaced_by_force_alone(pairs, capsys):
    command("card", capsys, "pairs/one/params.json")
    (pairs / "one" / "README.md").write_text("my own words")
    before = content(pairs)
    other = pairs.parent / "other.toml"
    other.write_text(TOML.replace("a lathe", "another lathe"), encoding="utf-8")
    code, out, err = command("card", capsys, "pairs/one/params.json", "--toml", other)
    assert (code, out) == (2, "")
    assert "README.md, card.json, card.html would be changed; replace with --force" in err
    assert content(pairs) == before
    assert command("card", capsys, "pairs/one/params.json", "--toml", other, "--force")[0] == 0
    assert "another lathe" in (pairs / "one" / "card.html").read_text("utf-8")


def test_citation_and_zenodo_on_request(pairs, capsys):
    out = command("card", capsys, "pairs/one/params.json", "--citation", "--zenodo")[1]
    assert "wrote pairs/one/CITATION.cff wrote pairs/one/.zenodo.json" in out
    assert json.loads((pairs / "one" / ".zenodo.json").read_text("utf-8"))["creators"] == [{"name": "Doe, Jane"}]


def test_a_citation_without_an_author_writes_nothing(pairs, capsys):
    home = add(pairs, "bare", toml=None)
    before = content(home)
    code, _, err = command("card", capsys, "pairs/bare/params.json", "--citation")
    assert code == 2
    assert "no author is given" in err
    assert content(home) == before


def test_json_prints_the_card_and_writes_nothing(pairs, capsys):
    before = content(pairs)
    module = importlib.import_module("fitmodels.cli.card")
    assert module.run(module.parser().parse_args(["pairs/one/params.json", "--json"])) == 0
    assert json.loads(capsys.readouterr().out)["schema"] == "fitmodels.card/5"
    assert content(pairs) == before


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (["nowhere.json"], 3, "nowhere.json: the file does not exist"),
        (["pairs/one/params.json", "--toml", "nowhere.toml"], 3, "nowhere.toml: cannot be read"),
        (["pairs/one/card.toml"], 3, "is not JSON"),
        (["pairs/one/params.json", "--citaton"], 2, "did you mean --citation?"),
    ],
)
def test_what_has_no_card_is_one_sentence(pairs, capsys, words, code, sentence):
    found, out, err = command("card", capsys, *words)
    assert (found, out) == (code, "")
    assert sentence in err


@pytest.mark.parametrize("name", ["card", "publish"])
def test_help_leads_with_an_example(name, capsys):
    assert command(name, capsys, "--help")[1].startswith(f"example: fitmodels {name} ")
