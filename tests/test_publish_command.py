"""``fitmodels publish`` and ``fitmodels card``: exit codes, sentences, and nothing half-written."""

import base64
import contextlib
import hashlib
import importlib
import json
import os
import shutil
import socket
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote, urlsplit

import pytest
import yaml
from fitmodels import cards, datasets, fit, parameters
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


@pytest.mark.parametrize(("times", "code"), [(1, 0), (99, 5)])
def test_a_pair_that_is_replaced_while_it_is_read_is_read_again(pairs, capsys, tmp_path, monkeypatch, times, code):
    """A site once held the card of a former fit with the parameters and figures of the new one."""
    module = importlib.import_module("fitmodels.cards.publishing.pair")
    made, powers = module.compose, iter(range(8, 8 + times))

    def compose(*given, folder, **options):
        card = made(*given, folder=folder, **options)
        if folder.name == "one" and (power := next(powers, None)):
            path, old = folder / "params.json", parameters.read(folder / "params.json")
            new = parameters.collect(
                tool="GC435", work="709M40", limits={"power": power}, data_sha256="a" * 64, simulated=True
            )
            parameters.write(new, path, replaces=old)
        return card

    monkeypatch.setattr(module, "compose", compose)
    found, out, err = command("publish", capsys, "pairs", "--site", "site", "--jobs", "1")
    assert found == code
    if code:
        assert "one: another command keeps replacing its files; try again when it has ended." in out + err
        return
    card = tmp_path / "site" / "cards" / "gc435-709m40"
    now = parameters.read(pairs / "one" / "params.json").content_sha256
    assert json.loads((card / "params.json").read_text())["content_sha256"] == now
    assert f'"content_sha256": "{now}"' in (card / "card.json").read_text()


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
    assert "2 of 4 pairs cannot be published; no site was written." in out
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


# --- draft


def test_a_draft_marks_the_gaps_on_every_page_and_is_replaced_by_the_published_site(pairs, capsys, tmp_path):
    home = add(pairs, "bare", work="S45C", toml=None)
    code, out, _ = command("publish", capsys, "pairs", "--site", "site", "--draft")
    assert code == 0
    assert "gaps in bare: missing: license, authors" in out
    assert out.endswith("wrote site/index.html, draft, 3 pairs, 1 with gaps")
    written = list((tmp_path / "site").rglob("*.html"))
    assert len(written) == 5
    for page in written:
        text = page.read_text("utf-8")
        assert '<meta name="robots" content="noindex">\n<title>Draft: ' in text
        assert text.count("Draft, not published.") == 1
    fields = "license, authors, contact, machine, iso513, setup, sensors"
    for page in (tmp_path / "site" / "index.html", tmp_path / "site" / "cards" / "gc435-s45c" / "index.html"):
        assert f"issing: {fields}" in page.read_text("utf-8")
    readme = (tmp_path / "site" / "cards" / "gc435-s45c" / "README.md").read_text("utf-8")
    assert f"\n> **Draft, not published.** Missing: {fields}" in readme
    listed = json.loads((tmp_path / "site" / "cards.json").read_text("utf-8"))
    assert (listed["draft"], [bool(card["gaps"]) for card in listed["cards"]]) == (True, [False, True, False])
    assert "<title>Draft: Model cards" in (tmp_path / "site" / "atom.xml").read_text("utf-8")
    (home / "card.toml").write_text(TOML, encoding="utf-8")
    assert command("publish", capsys, "pairs", "--site", "site")[:2] == (0, "wrote site/index.html, 3 pairs")
    assert b"Draft" not in b"".join(content(tmp_path / "site").values())


def test_a_draft_never_replaces_a_published_site(pairs, capsys, tmp_path):
    command("publish", capsys, "pairs", "--site", "site")
    before = content(tmp_path / "site")
    code, _, err = command("publish", capsys, "pairs", "--site", "site", "--draft", "--force")
    assert (code, content(tmp_path / "site") == before) == (2, True)
    assert "holds a published site, which a draft does not replace" in err


def test_a_draft_lists_pairs_without_a_card(pairs, capsys, tmp_path):
    (add(pairs, "broken", work="S45C") / "params.json").write_text("{")
    same = pairs / "three"
    same.mkdir()
    (same / "params.json").write_bytes((pairs / "one" / "params.json").read_bytes())
    (same / "card.toml").write_text(TOML, encoding="utf-8")
    assert command("publish", capsys, "pairs", "--site", "site", "--draft")[0] == 0
    index = (tmp_path / "site" / "index.html").read_text("utf-8")
    assert "<strong>broken</strong>: params.json: is not JSON" in index
    assert "<strong>three</strong>: same content as one" in index
    assert {path.name for path in (tmp_path / "site" / "cards").iterdir()} == {"gc435-709m40", "gc435-ti-6al-4v"}
    only = add(tmp_path / "wrong", "one")
    (only / "params.json").write_text("{")
    code, _, _ = command("publish", capsys, "wrong", "--site", "other", "--draft")
    assert (code, (tmp_path / "other").exists()) == (5, False)


def test_what_is_to_be_typed_fills_the_gaps(pairs, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")  # what is to be copied is not folded
    home = add(pairs, "bare", work="S45C", toml=None)
    module = importlib.import_module("fitmodels.cli.publish")
    module.run(module.parser().parse_args(["pairs", "--check"]))
    out = capsys.readouterr().out
    assert "Type into pairs/bare/card.toml," in out
    assert "\n  fitmodels publish pairs --site site --draft\n" in out
    lines = [line for line in out.splitlines() if line.startswith("  ") and " = " in line]
    (home / "card.toml").write_text("\n".join(lines))
    assert command("publish", capsys, "pairs", "--check")[:2] == (0, "3 pairs, ready to publish.")


# --- model repository of the hub


class Hub(BaseHTTPRequestHandler):
    """The part of the hub's HTTP interface that an upload and a download use, with faults on demand."""

    protocol_version = "HTTP/1.1"
    TOKEN = "hf_OnlyForTheTestOfThisFile"  # noqa: S105  of no account

    def log_message(self, *words):
        pass

    def reply(self, status, facts=None, headers=(), body=None):
        body = json.dumps(facts or {}).encode() if body is None else body
        self.send_response(status)
        for name, value in {"Content-Length": len(body), **dict(headers)}.items():
            self.send_header(name, str(value))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def handle_one_request(self):
        with contextlib.suppress(ConnectionError):
            super().handle_one_request()

    def do_any(self):
        state = self.server.state
        path = urlsplit(self.path).path
        sent = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        state["heard"].append(f"{self.command} {path}")
        if not path.startswith("/lfs/") and self.headers.get("Authorization") != f"Bearer {self.TOKEN}":
            return self.reply(401, {"error": "Invalid credentials"})
        fault = next((fault for part, fault in state["faults"].items() if part in path), None)
        if fault == "drop":
            self.connection.shutdown(socket.SHUT_RDWR)
            self.close_connection = True
            return None
        if fault:
            return self.reply(fault, {"error": f"made to fail with {fault}"})
        return self.answer(state, path, sent)

    do_GET = do_POST = do_PUT = do_HEAD = do_any

    def answer(self, state, path, sent):
        if path == "/api/repos/create":
            new = json.loads(sent)
            if state["repo"] is not None:
                return self.reply(409, {"error": "You already created this model repo"})
            hidden = bool(new.get("private")) or new.get("visibility") == "private"
            files = {".gitattributes": b"*.npz filter=lfs\n"}
            state["repo"] = {
                "private": hidden,
                "files": {".gitattributes": b"*.npz filter=lfs\n"},
                "sha": "0" * 40,
            }
            return self.reply(200, {"url": f"{state['url']}/{new['organization']}/{new['name']}"})
        if path == "/api/validate-yaml":
            wrong = faults_of_front_matter(json.loads(sent)["content"])
            return self.reply(
                400 if wrong else 200, {"errors": [{"message": words} for words in wrong], "warnings": []}
            )
        if state["repo"] is None:
            return self.reply(404, {"error": "Repository not found"}, [("X-Error-Code", "RepoNotFound")])
        files = state["repo"]["files"]
        if path in ("/api/models/lab/pair", "/api/models/lab/pair/revision/main"):
            head = yaml.safe_load(files["README.md"].split(b"---\n")[1]) if "README.md" in files else None
            return self.reply(200, {"id": "lab/pair", "sha": state["repo"]["sha"], "private": state["repo"]["private"],
                                    "siblings": [{"rfilename": name} for name in files], "cardData": head})  # fmt: skip
        if "/preupload/" in path:
            names = [one["path"] for one in json.loads(sent)["files"]]
            modes = [{"path": name, "uploadMode": "lfs" if name.endswith(".npz") else "regular", "shouldIgnore": False,
                      "oid": oid(name, files.get(name))} for name in names]  # fmt: skip
            return self.reply(200, {"files": modes})
        if path.endswith("/info/lfs/objects/batch"):
            asked = json.loads(sent)["objects"]
            upload = [{**one, "actions": {"upload": {"href": f"{state['url']}/lfs/{one['oid']}"}}} for one in asked]
            return self.reply(200, {"transfer": "basic", "objects": upload})
        if path.startswith("/lfs/"):
            state["lfs"][path.removeprefix("/lfs/")] = sent
            return self.reply(200)
        if "/commit/" in path:
            return self.commit(state, [json.loads(line) for line in sent.splitlines()])
        name = unquote(path.partition("/resolve/")[2].partition("/")[2])
        found = [("ETag", f'"{oid(name, files[name])}"'), ("X-Repo-Commit", state["repo"]["sha"])]
        return self.reply(200, headers=found, body=files[name])

    def commit(self, state, lines):
        head, repo = lines[0]["value"], state["repo"]
        if head.get("parentCommit") not in (None, repo["sha"]):
            return self.reply(412, {"error": "A commit has happened since"})
        for line in lines[1:]:
            value = line["value"]
            if line["key"] == "file":
                repo["files"][value["path"]] = base64.b64decode(value["content"])
            elif line["key"] == "lfsFile":
                repo["files"][value["path"]] = state["lfs"][value["oid"]]
            else:
                del repo["files"][value["path"]]
        repo["sha"] = hashlib.sha1("".join(sorted(map(str, lines))).encode(), usedforsecurity=False).hexdigest()
        state["summary"] = head["summary"]
        url = f"{state['url']}/lab/pair/commit/{repo['sha']}"
        return self.reply(200, {"commitUrl": url, "commitOid": repo["sha"], "pullRequestUrl": None})


def oid(name, blob):
    """Identity of a file on the hub: SHA-256 of one in LFS, else that of git."""
    if blob is None or name.endswith(".npz"):
        return blob and hashlib.sha256(blob).hexdigest()
    return hashlib.sha1(b"blob %d\0%s" % (len(blob), blob), usedforsecurity=False).hexdigest()


def faults_of_front_matter(readme):
    """What the hub's documentation of model cards demands: known licence or its name and link, names in model-index."""
    head = yaml.safe_load(readme.split("---\n")[1])
    wrong = [] if isinstance(head.get("license"), str) else ['"license" must be a string']
    if head["license"] == "other" and not (head.get("license_name") and head.get("license_link")):
        wrong.append('"license_name" and "license_link" are required')
    results = [result for one in head.get("model-index", []) for result in one["results"]]
    named = [(r["task"]["type"], r["dataset"]["type"], r["dataset"]["name"], r["metrics"]) for r in results]
    return wrong if all(map(all, named)) else [*wrong, '"model-index" lacks names']


MINE = TOML.replace("@example.org", "@tu-somewhere.eu")


@pytest.fixture
def hub(tmp_path, monkeypatch):
    """State of a stand-in of the hub, which the library is sent to with a token."""
    from huggingface_hub import constants

    server = ThreadingHTTPServer(("127.0.0.1", 0), Hub)
    server.daemon_threads = True
    url = f"http://127.0.0.1:{server.server_port}"
    server.state = {"repo": None, "lfs": {}, "heard": [], "faults": {}, "url": url, "summary": ""}
    for name in ("ENDPOINT", "HF_TOKEN_PATH", "HF_HUB_CACHE", "AGENT_HARNESSES_PATH"):
        monkeypatch.setattr(constants, name, url if name == "ENDPOINT" else str(tmp_path / name), raising=False)
    monkeypatch.setattr(constants, "HF_HUB_DISABLE_XET", True)
    template = f"{url}/{{repo_id}}/resolve/{{revision}}/{{filename}}"
    monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
    monkeypatch.setenv("HF_TOKEN", Hub.TOKEN)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    yield server.state
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture(scope="session")
def fitted(tmp_path_factory):
    """Folder of a fitted pair with figures and draws."""
    top = tmp_path_factory.mktemp("fitted")
    runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    law = fit.power_law(runs, "AW", ["V", "f", "d", "t"])
    drawn = fit.posterior(law, draws=1000, seed=1)
    pf = parameters.collect(
        tool="GC435", work="709M40", laws=[law], posteriors=[drawn], data_file="data.csv", simulated=False,
        data_sha256=runs.source.sha256,
    )  # fmt: skip
    cards.write(pf, top / "pair", laws=[law], posteriors=[drawn])
    (top / "pair" / "card.toml").write_text(MINE, encoding="utf-8")
    return top


@pytest.fixture
def pair(fitted, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(fitted, tmp_path / "one")
    return tmp_path / "one" / "pair"


@pytest.fixture
def small(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return add(tmp_path / "one", "pair", toml=MINE)


TO_HUB = ("publish", "one", "--to-hub", "lab/pair")


def to_hub(capsys, *options):
    return command(TO_HUB[0], capsys, *TO_HUB[1:], *options)


def test_without_push_the_repository_is_written_and_nothing_is_sent(pair, capsys, hub, tmp_path):
    code, out, err = to_hub(capsys)
    assert (code, err, hub["heard"]) == (0, "", [])
    made = content(tmp_path / "pair-hub")
    assert set(made) == {
        "README.md", "LICENSE", "params.json", "card.json", "draws.npz",
        "figures/observed_predicted.png", "figures/residuals.png", "figures/response_surfaces.png",
    }  # fmt: skip
    assert f"GC435 on 709M40: public model repository lab/pair on {hub['url']}" in out
    assert all(f"{len(made[name]) / 1000:.1f} kB {name}" in out for name in made)
    assert "front matter: valid for huggingface_hub" in out
    assert "The data file data.csv is not among them" in out
    assert out.endswith("Nothing was uploaded. To upload: fitmodels publish one --to-hub lab/pair --push")
    assert made["params.json"] == (pair / "params.json").read_bytes()
    assert made["LICENSE"].startswith(b"SPDX-License-Identifier: CC-BY-4.0\n")
    assert "unchanged: pair-hub" in to_hub(capsys)[1]


def test_the_front_matter_is_valid_for_the_library(pair, capsys, tmp_path):
    from huggingface_hub import ModelCard, ModelCardData

    to_hub(capsys)
    card = ModelCard.load(tmp_path / "pair-hub" / "README.md")
    assert isinstance(card.data, ModelCardData)
    assert (card.data.license, card.data.library_name, card.data.pipeline_tag) == (
        "cc-by-4.0", "fitmodels", "tabular-regression"
    )  # fmt: skip
    assert {r.metric_type for r in card.data.eval_results} == {"r_squared", "residual_standard_error"}
    assert card.data.datasets is None  # a file of ours is no dataset of the hub
    assert faults_of_front_matter(card.content) == []


def test_a_push_and_a_download_give_the_parameter_file_back(pair, capsys, hub, tmp_path):
    from huggingface_hub import hf_hub_download

    code, out, err = to_hub(capsys, "--push", "--private")
    assert (code, err) == (0, "")
    assert f"uploaded: {hub['url']}/lab/pair/commit/" in out
    assert hub["repo"]["private"]
    files = {name: content for name, content in hub["repo"]["files"].items() if name != ".gitattributes"}
    assert files == content(tmp_path / "pair-hub")
    assert hub["summary"] == "Parameters and model card of GC435 on 709M40"
    sent = parameters.read(hf_hub_download("lab/pair", "params.json", cache_dir=tmp_path / "cache"))
    assert sent == parameters.read(pair / "params.json")
    assert Hub.TOKEN not in out + err + "".join(map(str, content(tmp_path / "pair-hub").values()))


def test_a_repository_is_replaced_by_force_alone_and_only_one_of_ours(pair, capsys, hub):
    assert to_hub(capsys, "--push")[0] == 0
    code, _, err = to_hub(capsys, "--push")
    assert (code, "exists on" in err, "--force" in err) == (2, True, True)
    assert "unchanged on the hub" in to_hub(capsys, "--push", "--force")[1]
    hub["repo"]["files"]["figures/former.png"] = hub["repo"]["files"]["notes.txt"] = b"x"
    (pair / "card.toml").write_text(MINE.replace("a lathe", "another lathe"), encoding="utf-8")
    code, out, _ = to_hub(capsys, "--push", "--force")
    assert (code, "removed figures/former.png" in out) == (0, True)
    assert b"another lathe" in hub["repo"]["files"]["README.md"]
    assert "notes.txt" in hub["repo"]["files"]
    hub["repo"]["files"]["README.md"] = b"---\nlibrary_name: other\n---\n"
    before = dict(hub["repo"]["files"])
    code, _, err = to_hub(capsys, "--push", "--force")
    assert (code, hub["repo"]["files"] == before) == (2, True)
    assert "lab/pair exists and was not written by fitmodels" in err
    code, _, err = to_hub(capsys, "--push", "--force", "--private")
    assert (code, "exists and is public" in err) == (2, True)


@pytest.mark.parametrize(
    ("part", "fault", "sentence"),
    [
        ("/api/repos/create", 401, "the token was rejected; log in again with: hf auth login"),
        ("/api/repos/create", 403, "not allowed to write there; use one with write access to lab/pair"),
        ("/api/repos/create", 404, "check the name lab/pair"),
        ("/commit/", 409, "another change of the repository is in progress"),
        ("/commit/", 412, "the repository changed during the upload"),
        ("/commit/", 500, "the hub failed: made to fail with 500; run again later (HTTP 500)"),
        ("/commit/", "drop", "the connection failed"),
        ("/api/repos/create", "drop", "the connection failed"),
        ("/preupload/", 403, "not allowed to write there"),
        ("/api/validate-yaml", 400, "Invalid metadata in README.md"),
    ],
)
def test_a_failed_upload_is_one_sentence_and_can_be_repeated(small, capsys, hub, part, fault, sentence):
    hub["faults"][part] = fault
    code, _, err = to_hub(capsys, "--push")
    assert (code, err.count("\n")) == (1, 1)
    assert sentence in err
    assert Hub.TOKEN not in err
    hub["faults"].clear()
    assert to_hub(capsys, "--push")[0] == 0
    assert "params.json" in hub["repo"]["files"]


def test_without_a_token_or_a_valid_one_nothing_is_uploaded(small, capsys, hub, monkeypatch):
    monkeypatch.setenv("HF_TOKEN", "hf_ARejectedTokenOfThisTest")
    code, out, err = to_hub(capsys, "--push")
    assert (code, "the token was rejected" in err, "hf_ARejected" in out + err) == (1, True, False)
    monkeypatch.delenv("HF_TOKEN")
    hub["heard"].clear()
    code, _, err = to_hub(capsys, "--push")
    assert (code, hub["heard"]) == (2, [])
    assert err == f"fitmodels: no token for {hub['url']}; log in with: hf auth login, or set HF_TOKEN.\n"
    assert hub["repo"] is None


def test_simulated_numbers_are_marked_wherever_the_hub_shows_them(pair, capsys, hub, tmp_path):
    data = json.loads((pair / "params.json").read_text("utf-8"))
    data["identity"]["simulated"] = True
    pf = parameters.ParameterFile.model_validate(
        {name: value for name, value in data.items() if name != "content_sha256"}
    )
    parameters.write(pf, pair / "params.json", force=True)
    code, out, _ = to_hub(capsys, "--push")
    assert (code, "Simulated, not measured" in out) == (0, True)
    assert hub["summary"].startswith("Simulated: ")
    readme = hub["repo"]["files"]["README.md"].decode()
    head = yaml.safe_load(readme.split("---\n")[1])
    assert (head["simulated"], "simulated" in head["tags"], "> **Not measured.**" in readme) == (True, True, True)
    shown = [head["model-index"][0]["name"], *(r["dataset"]["name"] for r in head["model-index"][0]["results"])]
    assert all(name.endswith("(simulated, not measured)") for name in shown)


def test_data_are_added_on_request_and_only_those_that_were_fitted(pair, capsys, tmp_path):
    data = datasets.bundled("gc435_709m40")
    assert to_hub(capsys, "--data", data)[0] == 0
    assert (tmp_path / "pair-hub" / "data" / "data.csv").read_bytes() == data.read_bytes()
    (tmp_path / "other.csv").write_text("V,f\n1,2\n")
    code, _, err = to_hub(capsys, "--data", "other.csv")
    assert (code, "is not the file that was fitted" in err) == (3, True)


@pytest.mark.parametrize(
    ("spdx", "file", "sentence"),
    [
        ("CC-BY4.0", None, "(did you mean cc-by-4.0?)"),
        ("LicenseRef-Ours", None, "does not know license LicenseRef-Ours"),
        ("LicenseRef-Ours", "our terms", None),
        ("CC-BY-4.0", None, None),
    ],
)
def test_a_licence_has_a_text(small, capsys, hub, spdx, file, sentence):
    (small / "card.toml").write_text(MINE.replace("CC-BY-4.0", spdx), encoding="utf-8")
    if file:
        (small / "LICENSE").write_text(file)
    code, out, _ = to_hub(capsys)
    assert (code, sentence is None or f"not to be uploaded: {sentence}" in out or sentence in out) == (0, True)
    code = to_hub(capsys, "--push")[0]
    assert (code, hub["repo"] is None) == ((0, False) if sentence is None else (5, True))
    if file:
        assert hub["repo"]["files"]["LICENSE"] == b"our terms"
        assert b'license_link: "LICENSE"' in hub["repo"]["files"]["README.md"]


def test_the_contact_of_the_template_is_not_uploaded(small, capsys, hub):
    (small / "card.toml").write_text(TOML, encoding="utf-8")
    code, _, err = to_hub(capsys, "--push")
    assert (code, hub["heard"]) == (5, [])
    assert "contact jane.doe@example.org is the address of an example" in err


def test_the_gate_of_the_site_holds_for_the_hub(small, capsys, hub, tmp_path):
    (small / "card.toml").unlink()
    code, out, _ = to_hub(capsys, "--push")
    assert (code, hub["heard"]) == (5, [])
    assert "FAIL pair: missing: license" in out
    assert not (tmp_path / "pair-hub").exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["one", "--to-hub", "pair"], "should be ORG/NAME"),
        (["one", "--to-hub", "lab/-a"], "should be ORG/NAME"),
        (["one", "--to-hub", "lab/pair.git"], "should be ORG/NAME"),
        (["one", "--push"], "--push: belongs to a model repository; give its name with --to-hub ORG/NAME"),
        (["one", "--to-hub", "lab/pair", "--draft"], "a model repository is no site; leave one of them out"),
        (["one", "--check", "--draft"], "--check writes nothing"),
        (["one", "--to-hub", "lab/pair", "--out", "taken"], "taken: holds mine.txt, which is no file of a model"),
    ],
)
def test_what_no_repository_is_made_of_is_one_sentence(small, capsys, tmp_path, words, sentence):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "mine.txt").write_text("x")
    code, _, err = command("publish", capsys, *words)
    assert (code, err.count("\n")) == (2, 1)
    assert sentence in err
    assert [path.name for path in (tmp_path / "taken").iterdir()] == ["mine.txt"]


def test_two_pairs_are_no_repository(pairs, capsys):
    code, _, err = command("publish", capsys, "pairs", "--to-hub", "lab/pair")
    assert (code, "holds 2 pairs, a repository holds one; give one of pairs/one, pairs/two" in err) == (2, True)


def test_the_command_itself_is_sent_to_the_hub_of_the_environment(pair, hub, tmp_path):
    environment = {
        **os.environ,
        "HF_ENDPOINT": hub["url"],
        "HF_HUB_DISABLE_XET": "1",
        "HF_HOME": str(tmp_path / "home"),
    }
    words = [sys.executable, "-m", "fitmodels", *TO_HUB, "--push", "--quiet"]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"pair-hub\n{hub['url']}/lab/pair/commit/{hub['repo']['sha']}\n"
    (tmp_path / "home").mkdir(exist_ok=True)


def test_without_the_library_there_is_a_repository_and_no_push(small, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    code, out, _ = to_hub(capsys)
    assert (code, "front matter: not checked; for a check: pip install 'fitmodels[hub]'" in out) == (0, True)
    code, _, err = to_hub(capsys, "--push")
    assert (code, "install it with: pip install 'fitmodels[hub]'" in err) == (2, True)


def test_the_repository_as_json(small, capsys):
    module = importlib.import_module("fitmodels.cli.publish")
    assert module.run(module.parser().parse_args([*TO_HUB[1:], "--json"])) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["schema"], facts["repository"], facts["commit"]) == ("fitmodels.hub/1", "lab/pair", None)
    assert facts["files"]["LICENSE"] > 100


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
    assert out.endswith(f"Not stated, and needed to publish the card: {fields}; state it in card.toml.")


def test_a_card_with_other_content_is_replaced_by_force_alone(pairs, capsys):
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
    assert json.loads(capsys.readouterr().out)["schema"] == "fitmodels.card/8"
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
