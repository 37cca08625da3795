"""The page of the app: who is answered, what is kept, and that it gives what its commands give."""

import errno
import gc
import http.client
import io
import json
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fitmodels import cli, datasets, parameters
from fitmodels.app import cells as app_cells
from fitmodels.app import jobs as app_jobs
from fitmodels.app import region, server
from fitmodels.app.cells import Cells, cells_of
from fitmodels.app.command_forms import actions, subject_of
from fitmodels.app.command_words import command
from fitmodels.app.guard import Guard
from fitmodels.app.jobs import Job, Jobs
from fitmodels.app.messages import on_page, places
from fitmodels.app.options import applied, command_of, of_comparison, replaced
from fitmodels.app.project import SUFFIXES, Project, safe_name
from fitmodels.app.reading import assumptions, column_menus, named_rows, offered, option_of_change, role_label, units_of
from fitmodels.app.results import policy_of_card, reading_of, remedies, rows_left_out, suspects, written
from fitmodels.app.stages import filled, older, states, to_repeat
from fitmodels.controllers.region.visible import visible_region
from fitmodels.core.errors import DataError, UsageError
from fitmodels.datasets.corrections import parse_correction
from fitmodels.datasets.tables import Column
from fitmodels.fit.form_choice import CHOICES
from fitmodels.parameters.published import published
from hypothesis import assume, given
from hypothesis import strategies as st
from starlette.datastructures import Headers

sys.path.insert(0, str(Path(__file__).parent))

from app_pages import served, slow_command

sys.path.remove(str(Path(__file__).parent))

BUNDLED = datasets.bundled("gc435_709m40").read_bytes()
HEAD = "edge;vc [m/min];f [mm/rev];ap [mm];t [min];VB [mm]\n"
HOSTILE = "<script>alert(1)</script>"


def wear_table(head=HEAD, wear=1.0):
    """A table of nine edges whose wear follows a power law."""
    rows = [
        f"E{k};{V};{f};2;{t};{wear * 0.004 * V**0.5 * f**0.2 * t**0.4 * (1 + 0.02 * ((k * t) % 3 - 1)):.4f}"
        for k, (V, f) in enumerate((V, f) for V in (100, 150, 200) for f in (0.1, 0.2, 0.3))
        for t in (2, 4, 8, 12)
    ]
    return (head + "\n".join(rows)).replace(".", ",").encode()


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with served(tmp_path_factory.mktemp("project")) as one:
        yield one


# who is answered


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"host": "attacker.example"}, 421),
        ({"host": "attacker.example:80"}, 421),
        ({"cookie": None}, 403),
        ({"cookie": "fitmodels-1=wrong"}, 403),
        ({"cookie": 'fitmodels="; broken'}, 403),
        ({"sec_fetch_site": "cross-site"}, 403),
        ({"sec_fetch_site": "same-site"}, 403),
    ],
)
def test_a_request_that_is_not_of_this_page_is_refused(client, headers, status):
    for method, path in (("GET", "/"), ("GET", "/static/app.js"), ("POST", "/files")):
        assert client.ask(method, path, **headers)[0] == status, (method, path)


def test_a_form_of_another_site_changes_nothing(client):
    before = client.page.project.files
    for origin in ("http://attacker.example", "null", None, "https://127.0.0.1:1"):
        assert client.ask("POST", "/files", b"", origin=origin)[0] == 403
    assert client.page.project.files == before


@pytest.mark.parametrize("token", ["", "wrong", "%00", "a" * 5000])
def test_a_wrong_token_gives_no_cookie(client, token):
    status, headers, _ = client.ask("GET", f"/start/{token}", cookie=None)
    assert status in (403, 414)
    assert "set-cookie" not in headers


def test_the_cookie_is_none_of_scripts_and_other_sites(client):
    status, headers, text = client.ask("GET", f"/start/{client.token}", cookie=None)
    assert (status, headers["location"], text) == (303, "/", "")
    said = headers["set-cookie"].lower()
    assert "httponly" in said
    assert "samesite=strict" in said
    assert headers["referrer-policy"] == "no-referrer"
    assert client.token not in client.get("/")


def test_every_answer_has_a_policy_without_inline_scripts(client):
    for path in ("/", "/static/app.css", "/static/htmx.min.js"):
        _, headers, text = client.ask("GET", path)
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["cache-control"] == "no-store"
        if path == "/":
            assert "<script>" not in text
            assert " style=" not in text
            assert "://" not in text.replace("data:,", "")


def test_htmx_evaluates_nothing_and_adds_no_style(client):
    assert '"allowEval":false' in client.get("/")
    assert '"includeIndicatorStyles":false' in client.get("/")


def test_a_request_that_is_too_large_is_refused_with_and_without_a_length(tmp_path):
    with served(tmp_path, largest=20_000) as one:
        assert one.upload("a.csv", b"1" * 30_000)[0] == 413
        head = b'--m\r\nContent-Disposition: form-data; name="file"; filename="a.csv"\r\n\r\n'
        pieces = (part for part in (head, *[b"x" * 8_000] * 4))  # chunked, without a length
        kind = "multipart/form-data; boundary=m"
        assert one.ask("POST", "/files", pieces, content_type=kind)[0] == 413
        assert one.page.project.files == ()
        assert [path.name for path in tmp_path.iterdir()] == []


def test_a_length_of_a_digit_that_is_no_number_is_refused():
    guard = Guard(None, 1)
    headers = Headers({"host": "127.0.0.1:1", "cookie": f"{guard.cookie}={guard._secret}", "content-length": "\u00b2"})
    assert guard._refusal({"path": "/", "method": "GET"}, headers)[0] == 413


def test_an_upload_that_is_cut_off_leaves_nothing(client):
    before = sorted(path.name for path in client.page.project.folder.iterdir())
    with socket.create_connection(("127.0.0.1", client.port)) as raw:
        head = (
            f"POST /files HTTP/1.1\r\nHost: {client.host}\r\nOrigin: http://{client.host}\r\n"
            f"Cookie: {client.cookie}\r\nContent-Type: multipart/form-data; boundary=m\r\nContent-Length: 100000\r\n"
            "\r\n"
            '--m\r\nContent-Disposition: form-data; name="file"; filename="cut.csv"\r\n\r\nV,f\n1,2\n'
        )
        raw.sendall(head.encode())
    time.sleep(0.3)
    assert client.page.project.entry("cut.csv") is None
    assert sorted(path.name for path in client.page.project.folder.iterdir()) == before
    assert "<h1>Project" in client.get("/")


# names and paths


@pytest.mark.parametrize(
    "path", ["../../../etc/passwd", "..%2f..%2fproject.json", "/etc/passwd", "%2e%2e/project.json", "project.json"]
)
def test_no_path_of_the_browser_is_opened(client, path):
    client.upload("paths.csv", wear_table())
    status, _, text = client.ask("GET", f"/files/paths.csv/results/{path}")
    assert status == 404
    assert "root:" not in text
    assert client.ask("GET", f"/files/{path}")[0] == 404
    assert client.ask("GET", f"/static/{path}")[0] == 404


def test_a_link_in_the_folder_is_no_result(tmp_path):
    project = Project(tmp_path / "p")
    entry = project.add("a.csv", io.BytesIO(b"V,f\n1,2\n"))
    (tmp_path / "secret.txt").write_text("secret")
    (project.folder / "a-secret.txt").symlink_to(tmp_path / "secret.txt")
    (project.folder / "a-folder").symlink_to(tmp_path, target_is_directory=True)
    (project.folder / "a-next.csv").write_text("V\n")
    assert list(project.results(entry)) == ["a-next.csv"]


@given(st.text(max_size=80), st.sampled_from(SUFFIXES))
def test_names_are_harmless(text, suffix):
    name = safe_name(text + suffix)
    assert name == Path(name).name
    assert not name.startswith((".", "-"))
    assert all(sign.isalnum() or sign in "_." for sign in name)
    assert len(name) < 90
    assert safe_name(name) == name


@pytest.mark.parametrize("name", ["a.exe", "a", "", "project.json", "a.csv.html"])
def test_other_kinds_of_files_are_refused(name):
    with pytest.raises(DataError, match=r"\.csv"):
        safe_name(name)


def test_results_of_one_file_are_none_of_another(tmp_path):
    project = Project(tmp_path)
    names = [
        project.add(name, io.BytesIO(data)).name
        for name, data in (("a.csv", b"1"), ("a.xlsx", b"2"), ("a-b.csv", b"3"))
    ]
    assert len(set(names)) == 3
    stems = [Path(name).stem for name in names]
    assert not any(other.startswith(f"{one}-") for one in stems for other in stems)


def test_the_same_file_is_added_once_and_an_empty_one_never(tmp_path):
    project = Project(tmp_path)
    assert project.add("a.csv", io.BytesIO(b"V\n1\n")) == project.add("b.csv", io.BytesIO(b"V\n1\n"))
    with pytest.raises(DataError, match="empty"):
        project.add("c.csv", io.BytesIO(b""))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "project.json"]
    assert Project(tmp_path).files == project.files


@pytest.mark.parametrize("text", ["", "{", '{"schema": "fitmodels.project/2"}', '{"files": [{"name": 1}]}', "[]"])
def test_a_project_file_of_another_kind_is_refused(tmp_path, text):
    (tmp_path / "project.json").write_text(text)
    with pytest.raises(UsageError, match="--folder"):
        Project(tmp_path)
    assert (tmp_path / "project.json").read_text() == text


# what the page gives


def test_the_page_gives_what_its_command_gives(client, tmp_path, monkeypatch):
    """A file with a wrong unit, corrected by the menu: byte for byte the parameter file of the printed command."""
    assert client.upload("wrong unit.csv", wear_table(wear=1000.0))[1] == "/files/wrong_unit.csv"
    text = client.until_done("/files/wrong_unit.csv/reading")
    assert "Doubt" in text or "Not read" in text
    client.reading("wrong_unit.csv")
    assert client.post("/files/wrong_unit.csv/set", set="unit", of="VB", to="um") == (200, "")
    laws = client.until_done("/files/wrong_unit.csv/laws")
    assert "VB   " in laws
    shown = client.get("/files/wrong_unit.csv")
    assert "fitmodels wrong_unit.csv --unit VB=um" in shown
    (name,) = client.page.project.parameter_files(client.page.project.entry("wrong_unit.csv"))
    made = (client.page.project.folder / name).read_bytes()
    (tmp_path / "wrong_unit.csv").write_bytes(wear_table(wear=1000.0))
    monkeypatch.chdir(tmp_path)
    assert cli.main(["wrong_unit.csv", "--unit", "VB=um", "--force"]) == 0
    assert (tmp_path / name).read_bytes() == made


def test_from_tests_to_limits_and_an_export(client):
    client.upload("gc.csv", BUNDLED)
    laws = client.until_done("/files/gc.csv/laws")
    assert "AW = " in laws
    assert "NOT MEASURED" in laws
    assert "card.html" in laws
    machine = client.get("/files/gc.csv/machine")
    assert 'id="action-limits"' in machine
    assert 'data-open="action-costs"' in client.run("gc.csv", "optimum")
    found = client.run("gc.csv", "limits", AW="0.3mm", P="7kW", V="50:200", f="")
    assert "Power P at most 7 kW" in found
    client.run(
        "gc.csv", "costs", machine="60/h", edge="8", change="1.5min", handling="2min", volume="120cm3", currency="EUR"
    )
    found = client.run("gc.csv", "optimum", V="145", f="0.3")
    assert "least cost" in found
    assert re.search(r'id="state-optimum" [^>]*hx-swap-oob="true">done: today V=145 today f=0.3<', found)
    assert "gc-control.ini" in client.run("gc.csv", "export", to="ini")
    status, headers, text = client.ask("GET", "/files/gc.csv/results/gc-control.ini")
    assert (status, headers["content-disposition"][:10]) == (200, "attachment")
    assert "AW" in text
    # fitted again with other options, the file has lost what was added, and the page says so
    assert client.post("/files/gc.csv/set", set="criterion", to="0.25")[0] == 200
    again = client.until_done("/files/gc.csv/laws")
    assert "Run it again" in again
    assert "older than params.json" in again
    words = "limits gc-fit/GC435_709M40-En-19/params.json AW=0.3mm P=7kW V=50:200 --force"
    status, text = client.post("/files/gc.csv/repeat", command=words)
    assert status == 200, text
    answer = client.until_done(f"/jobs/{text.split('/jobs/')[1].split('/')[0].split('?')[0]}?file=gc.csv")
    assert 'id="to-repeat" hx-swap-oob="true"' in answer
    assert f'value="{words}"' not in answer
    assert words not in client.get("/files/gc.csv/laws").replace("&#39;", "'")
    assert client.post("/files/gc.csv/repeat", command=words)[0] == 422
    machine = client.get("/files/gc.csv/machine")
    assert re.search(r'name="P" value="7kW"', machine)
    assert re.search(r'id="state-limits"[^>]*>done: AW=0.3mm P=7kW V=50:200<', machine)
    assert re.search(r'id="state-costs"[^>]*>outdated<', machine)


def test_the_region_follows_its_sliders(client):
    """At a power of 3 kW the best pair of the page is that of `controllers.visible_region`."""
    client.upload("gc.csv", BUNDLED)
    client.until_done("/files/gc.csv/laws")
    found = client.get("/files/gc.csv/region")
    assert re.findall(r'type="range" name="(\w+)"', found) == ["AW", "Fxz", "P", "d", "t"]
    drawn = client.get("/files/gc.csv/region?AW=0.3&P=3&Fxz=3000&d=2&t=10")
    (name,) = client.page.project.parameter_files(client.page.project.entry("gc.csv"))
    limits = {"power": 3.0, "wear": 0.3, "force": None}
    best = visible_region(parameters.read(client.page.project.folder / name), limits=limits, d=2.0, t=10.0).best
    assert best.words[: best.words.index("MRR")] in drawn
    assert "NOT MEASURED" in drawn
    assert "exclude each other" in client.get("/files/gc.csv/region?P=0.001")
    assert client.ask("GET", "/files/gc.csv/region?P=-1")[0] == 422
    assert client.ask("GET", "/files/gc.csv/region?P=x")[0] == 422


def two_forces(data):
    data["laws"]["Fc"] = {**data["laws"]["Fxz"], "response": "Fc", "quantity": "cutting force"}
    data["limits"]["responses"] = {"Fc": {"high": 1.0, "unit": "kN"}, "AW": {"low": 50.0, "unit": "um"}}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda data: None, ""),
        (lambda data: data["limits"].update(power={"value": 5000.0, "unit": "W", "of": "P"}), ""),
        (lambda data: data["limits"].update(power={"value": 5.0, "unit": "kW"}), ""),
        (lambda data: data["limits"].update(wear={"value": 200.0, "unit": "um", "of": "AW"}), ""),
        (two_forces, ""),
        (lambda data: data["limits"]["force"].update(of="Fc"), "NOT APPLIED: limits.force 1500 N: the file has no law"),
    ],
)
def test_the_region_begins_with_the_limits_of_the_file(tmp_path, change, words):
    data = published("AC-2017").model_dump()
    change(data)
    pf = parameters.ParameterFile.model_validate({**data, "content_sha256": None})
    parameters.write(pf, tmp_path / "params.json")
    at = {one.name: float(one.value) for one in region.sliders(tmp_path, "params.json")}
    dropped = {"force": None} if words else None
    best = visible_region(pf, limits=dropped, d=at["d"], t=at["t"]).best
    shown = region.drawn(tmp_path, "params.json", {})[1]
    assert best.words[: best.words.index("MRR")] in shown
    assert words in shown
    assert ("NOT APPLIED" in shown) == bool(words)
    moved = region.drawn(tmp_path, "params.json", {"P": "4", "Fxz": "5000"})[1]  # the limit of Fc stays
    best = visible_region(pf, limits={"power": 4.0, **(dropped or {})}, d=at["d"], t=at["t"]).best
    assert best.words[: best.words.index("MRR")] in moved


def test_results_are_kept_when_the_page_is_opened_again(tmp_path):
    with served(tmp_path) as one:
        one.upload("gc.csv", BUNDLED)
        one.until_done("/files/gc.csv/laws")
        one.run("gc.csv", "limits", P="7kW")
        (name,) = one.page.project.parameter_files(one.page.project.entry("gc.csv"))
        before = (tmp_path / name).read_bytes()
    with served(tmp_path) as one:
        assert "unchanged" in one.until_done("/files/gc.csv/laws")
        assert "fitmodels limits" in one.get("/")
    assert (tmp_path / name).read_bytes() == before
    assert json.loads(before)["limits"]["power"]["value"] == 7.0


def test_what_a_page_shows_outlasts_any_number_of_commands(client, monkeypatch):
    monkeypatch.setattr("fitmodels.app.jobs.KEPT", 2)
    client.upload("gc.csv", BUNDLED)
    laws = client.until_done("/files/gc.csv/laws")
    reading = client.until_done("/files/gc.csv/reading")
    jobs = client.page.jobs
    later = [jobs.start(["--version"]) for _ in range(4)]
    for job in later:
        job.future.result(60)
    jobs.start(["--version"]).future.result(60)
    assert jobs.get(later[0].id) is None
    assert client.get("/files/gc.csv/laws") == laws
    assert client.get("/files/gc.csv/reading") == reading


def test_the_menu_of_forms_holds_all_forms(client):
    client.upload("gc.csv", BUNDLED)
    menu = re.search(r'<select id="set-form".*?</select>', client.until_done("/files/gc.csv/laws"), re.DOTALL)[0]
    assert re.findall(r"<option>([\w-]+)</option>", menu) == list(CHOICES)


def test_rows_are_left_out_with_a_reason_and_taken_in_again(client):
    client.upload("left.csv", wear_table(wear=1.01))
    assert client.post("/files/left.csv/leave-out", target="E3", reason="")[0] == 422
    assert client.post("/files/left.csv/leave-out", target="--out=x", reason="y")[0] == 422
    assert client.post("/files/left.csv/leave-out", target="E3", reason="edge broke")[0] == 200
    laws = client.until_done("/files/left.csv/laws")
    assert re.search(r"<li>E3 \([^)]*\b4 rows?.*: edge broke", " ".join(laws.split())), laws
    assert "8 edges" in laws
    assert "--leave-out E3" in client.get("/files/left.csv")
    assert "--leave-out" not in client.until_done("/files/left.csv/reading").split("Assumed")[-1]
    assert client.post("/files/left.csv/take-back", option="--leave-out E3")[0] == 200
    assert "9 edges" in client.until_done("/files/left.csv/laws")
    assert client.page.project.entry("left.csv").options == ()


def test_results_of_former_settings_are_not_shown_as_those_of_the_file(client):
    client.upload("named.csv", wear_table(wear=1.03))
    assert "unnamed-work" in client.until_done("/files/named.csv/laws")
    assert client.post("/files/named.csv/set", set="work", to="42CrMo4")[0] == 200
    laws = client.until_done("/files/named.csv/laws")
    assert laws.count("<iframe") == 1
    listed, _, former = laws.partition("Files to take along")[2].partition("<details>")
    assert "named-fit/unnamed-tool_unnamed-work" not in listed
    assert "not part of this result" in former
    assert "named-fit/unnamed-tool_unnamed-work/params.json" in former
    assert "42CrMo4" in re.search('name="params" value="([^"]+)"', client.get("/files/named.csv/machine"))[1]
    client.reading("named.csv")
    assert client.post("/files/named.csv/set", set="role", column="6", to="")[0] == 200
    laws = client.until_done("/files/named.csv/laws")
    assert "These settings have given no result" in laws
    assert client.post("/files/named.csv/take-back", option="--map VB=none")[0] == 200
    assert "These settings" not in client.until_done("/files/named.csv/laws")


def test_laws_of_withdrawn_settings_are_marked_and_nothing_is_computed_from_them(client):
    """After a change that the fit refuses, forms and exports went on with the former laws, unmarked."""
    client.upload("withdrawn.csv", wear_table(wear=1.171))
    client.until_done("/files/withdrawn.csv/laws")
    assert "Done in" in client.run("withdrawn.csv", "export", to="ini")
    first = re.search('name="params" value="([^"]+)"', client.get("/files/withdrawn.csv/machine"))[1]
    client.reading("withdrawn.csv")
    assert client.post("/files/withdrawn.csv/set", set="role", column="6", to="")[0] == 200
    laws = client.until_done("/files/withdrawn.csv/laws")
    assert "These settings have given no result" in laws
    assert 'class="verdict doubt">outdated, of former settings</span>' in laws
    assert "usable" not in laws.partition("<pre")[0]
    assert "Next:" not in laws
    assert "Files to take along" not in laws  # nor the export
    assert "withdrawn-control.ini" in laws.partition("Files of former names or settings")[2]
    machine = client.get("/files/withdrawn.csv/machine")
    assert "of former settings, and nothing is computed or exported from it" in machine
    assert "<form" not in machine
    for name in ("predict", "limits", "next", "export", "card"):
        status, text = client.post(f"/files/withdrawn.csv/run/{name}", params=first, to="ini")
        assert (status, "of former settings" in text) == (422, True), name
    assert client.ask("GET", f"/files/withdrawn.csv/region?params={first}")[0] == 422
    start = client.get("/").partition("/files/withdrawn.csv")[2].partition("</li>")[0]
    assert re.findall('verdict doubt">([^<]+)<', start) == ["VB: outdated, of former settings"]
    assert client.post("/files/withdrawn.csv/undo")[0] == 200
    assert "outdated" not in client.until_done("/files/withdrawn.csv/laws").partition("<pre")[0]
    assert "usable" in client.get("/").partition("/files/withdrawn.csv")[2].partition("</li>")[0]
    assert "Done in" in client.run("withdrawn.csv", "limits", V="100:150")


def slipped_table():
    """A table of nine edges with a wear of ten times its value in line 15."""
    lines = wear_table().decode().splitlines()
    cells = lines[14].split(";")
    lines[14] = ";".join([*cells[:-1], f"{10 * float(cells[-1].replace(',', '.')):g}".replace(".", ",")])
    return "\n".join(lines).encode()


def test_a_mistyped_text_is_refused_at_its_field_and_not_kept(client):
    """A correction, target, column, constant or length that the reading refuses; a right one is taken afterwards."""
    name = client.upload("typed.csv", wear_table(wear=1.04))[1]
    client.until_done(f"{name}/reading")
    for what, of, to, words in (
        ("correct", "", "31: 0.261", "write TARGET:SYMBOL*NUMBER"),
        ("correct", "", "lines 9:VB=0,261", "write TARGET:SYMBOL*NUMBER"),
        ("correct", "", "lines 999:VB/10", "no row in line 999"),
        ("correct", "", "lines 9:Q/10", "no column has the role Q"),
        ("edge", "", "nil", "names a column"),
        ("value", "D", "wide", "give a number"),
        ("range", "V", "wide", "give low:high"),
        ("criterion", "", "wide", "no length above zero"),
    ):
        status, text = client.post(f"{name}/set", set=what, of=of, to=to)
        assert status == 422, (what, to)
        assert words in text
        assert "--" not in text
    status, text = client.post(f"{name}/leave-out", target="lines 999", reason="broke")
    assert (status, "no row in line 999" in text) == (422, True)
    assert client.page.project.entry("typed.csv").options == ()
    assert client.post(f"{name}/set", set="correct", to="lines 9:VB/1.01")[0] == 200
    assert client.page.project.entry("typed.csv").options == ("--correct", "lines 9:VB/1.01")
    text = client.until_done(f"{name}/reading")
    assert 'id="set-correct-answer"' in text
    assert "Not read" not in text


def test_examples_are_of_the_unit_and_no_value_to_enter(tmp_path):
    """'abc' is no number; write it as 0.261; a load limit in kW such as 0.28, which is a current in A."""
    path = tmp_path / "a.csv"
    path.write_text("VB [mm]\n1.54\n")
    cells = cells_of(path, (), {"columns": [{"number": 1, "role": "VB", "unit": "mm"}], "units": {"VB": "mm"}})
    with pytest.raises(
        UsageError, match=r"'abc' is no number; write digits with a decimal point in mm\. The file has 1\.54"
    ):
        cells.correction(2, "VB", "abc")
    for symbol, unit, words in (("P", "kW", "fill it in\\.$"), ("I", "A", "fill it in, such as 0.28")):
        (tmp_path / "params.json").write_text(json.dumps({"laws": {symbol: {"unit": unit}}}))
        subject = subject_of(tmp_path, "d", "params.json", [])
        form = next(one for one in actions(subject) if one.name == "settings")
        with pytest.raises(UsageError, match=f"load limit of a worn tool, {unit} is empty: {words}"):
            command(form, subject, {}, [])


def test_a_record_is_offered_before_files_of_tests(client, tmp_path):
    (tmp_path / "params.json").write_text("{}")
    of = subject_of(tmp_path, "d", "params.json", ["b.csv", "drive.csv"])

    def offered_records(subject):
        return [value for value, _ in next(one for one in actions(subject) if one.name == "ident").inputs[0].choices]

    assert offered_records(replace(of, tests=["a.csv", "b.csv"])) == ["drive.csv", "b.csv"]
    assert offered_records(replace(of, tests=["b.csv", "drive.csv"])) == ["", "b.csv", "drive.csv"]
    for k in range(2):
        client.upload(f"offer{k}.csv", wear_table(wear=1.2 + k / 10))
        client.until_done(f"/files/offer{k}.csv/laws")
    client.upload("offer_drive.csv", (Path(__file__).parents[1] / "docs/examples/drive.csv").read_bytes() + b"\n")
    text = client.get("/files/offer0.csv/machine")
    menu = text.partition('<select id="ident-record"')[2].partition("</select>")[0]
    assert menu.index("offer_drive.csv") < menu.index("offer1.csv")


def test_buttons_are_not_made_of_a_malformed_correction():
    ways = ("--correct '31: 0.261' --correct 31", "--unit VB=um", "--correct 'lines 3:VB/10'")
    look = {"commands": [{"command": f"fitmodels a.csv {one}"} for one in ways]}
    assert offered(look) == list(ways[1:])


def test_a_wrong_cell_gets_a_new_value_with_a_reason(client):
    name = client.upload("cell.csv", slipped_table())[1]
    text = client.until_done(f"{name}/reading")
    assert re.search(r'<tr class="doubted"><th scope="row">15 ', text)
    (ready,) = re.findall(r'name="to" value="([\d.]+)"', text)
    client.reading("cell.csv")
    assert client.post(f"{name}/new-value", line="15", symbol="VB", to="x", reason="slip")[0] == 422
    assert client.post(f"{name}/new-value", line="15", symbol="VB", to=ready, reason="")[0] == 422
    assert client.post(f"{name}/new-value", line="999", symbol="VB", to=ready, reason="slip")[0] == 422
    assert client.post(f"{name}/new-value", line="15", symbol="VB", to=ready, reason="slip")[0] == 200
    assert client.page.project.entry("cell.csv").options == ("--correct", "lines 15:VB/10")
    assert client.post(f"{name}/new-value", line="15", symbol="VB", to="0,06", reason="read again")[0] == 200
    entry = client.page.project.entry("cell.csv")
    assert len(entry.options) == 2  # one correction of a value
    assert list(entry.reasons.values()) == ["read again"]
    text = client.until_done(f"{name}/reading")
    assert re.search(r"line 15: VB [\d.]+ mm becomes 0.06 mm: read again", text)
    (row,) = re.findall(r'<tr><th scope="row">15 corrected</th>.*', text)
    assert re.search(r">0\.06 \(was [\d.]+\)</td>", row)
    path = client.page.project.folder / "cell.csv"
    runs = datasets.read_runs(path, correct=[entry.options[1]])
    assert runs.values("VB")[runs.lines == 15] == [0.06]


def test_cells_of_a_large_file_are_not_read_and_its_page_has_its_other_forms(client, monkeypatch):
    name = client.upload("large.csv", slipped_table() + b"\n\n")[1]  # no file that another test has added
    client.until_done(f"{name}/laws")
    path = client.page.project.folder / "large.csv"
    assert cells_of(path, (), {}) is not None
    monkeypatch.setattr(app_cells, "LARGEST", path.stat().st_size - 1)
    assert cells_of(path, (), {}) is None
    client.page._shown["large.csv"].cells = None
    text = client.until_done(f"{name}/reading") + client.until_done(f"{name}/laws")
    assert "Rows in doubt" in text
    assert "Leave out lines 15, because" in text
    assert "New value of" not in text


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
def test_a_new_value_is_met_to_its_last_bit(old, new):
    assume(f"{old:.15g}" != f"{new:.15g}")
    column = Column(1, "VB", "mm", np.array([old]), is_numeric=True)
    table = SimpleNamespace(columns=(column,), lines=np.array([7]))
    cells = Cells(table, [{"number": 1, "role": "VB", "unit": "mm"}], {"VB": "mm"})
    text = cells.correction(7, "VB", repr(new))
    assert parse_correction(text).apply(np.array([old]))[0] == pytest.approx(new, rel=5e-16, abs=0)


def test_a_new_value_that_can_be_read_in_two_ways_is_refused():
    column = Column(1, "F", "N", np.array([800.0]), is_numeric=True)
    table = SimpleNamespace(columns=(column,), lines=np.array([7]))
    cells = Cells(table, [{"number": 1, "role": "F", "unit": "N"}], {"F": "N"})
    with pytest.raises(UsageError, match="1,250 can be read in two ways"):
        cells.correction(7, "F", "1,250")
    assert cells.correction(7, "F", "0,8") == "lines 7:F/1000"
    assert cells.correction(7, "F", "0,261")


def test_a_reading_of_any_length_is_whole(tmp_path):
    job = Job("f" * 16, ("look", "wide.csv", "--json"), tmp_path / "o", tmp_path / "e")
    job.out.write_text(json.dumps({"columns": ["x" * 100] * 4000}), "utf-8")
    assert len(reading_of(job)["columns"]) == 4000
    assert job.output.endswith("... (more in a terminal)")
    job.out.write_text("{", "utf-8")
    assert reading_of(job)["refused"] == "The reading ended without a result; run it again."


def test_a_page_that_is_out_of_date_changes_and_runs_nothing(client):
    """Two tabs: what the second has changed is not exported, and not corrected further, by the first."""
    name = client.upload("tabs.csv", wear_table(wear=1.05))[1]
    client.until_done(f"{name}/laws")

    def token(text, which):
        return re.search(f'name="{which}" value="([^"]+)"', text)[1]

    first = {"shown-options": token(client.get(name), "shown-options")}
    first |= {"shown-files": token(client.get(f"{name}/machine"), "shown-files")}
    done = client.run("tabs.csv", "limits", V="100:150", **first)  # by the other tab
    assert "Done in" in done
    status, text = client.post(f"{name}/run/export", to="ini", **first)
    assert status == 422
    assert "changed since this page was shown (another tab or a command): reload the page" in text
    assert not list(client.page.project.folder.glob("tabs-control.*"))
    new = {**first, "shown-files": token(done, "shown-files")}
    assert new != first
    assert "Done in" in client.run("tabs.csv", "limits", V="100:180", **new)
    assert client.post(f"{name}/set", set="tool", to="T1", **first)[0] == 200
    for path, fields in (("set", {"set": "tool", "to": "T2"}), ("undo", {}), ("leave-out", {"target": "E1"})):
        status, text = client.post(f"{name}/{path}", **fields, **first)
        assert (status, "reload the page" in text) == (422, True), path
    assert client.page.project.entry("tabs.csv").options == ("--tool", "T1")


def test_a_command_that_waited_runs_only_where_its_page_is_not_out_of_date_then(client, monkeypatch):
    """Two tabs at once: both limits were reported as done, and those of the first tab were lost."""
    name = client.upload("queue.csv", wear_table(wear=1.172))[1]
    client.until_done(f"{name}/laws")
    shown = re.search('name="shown-files" value="([^"]+)"', client.get(f"{name}/machine"))[1]
    pages = [re.search('name="shown-page" value="([^"]+)"', client.get(name))[1] for _ in range(2)]
    assert 'hx-include="#shown-options, #shown-files, #shown-page"' in client.get(name)
    first, second = ({"shown-files": shown, "shown-page": page} for page in pages)
    go, run = threading.Event(), app_jobs._exit_code

    def held(job, process):
        go.wait(60)
        return run(job, process)

    monkeypatch.setattr(app_jobs, "_exit_code", held)

    def started(action, **fields):
        status, text = client.post(f"{name}/run/{action}", **fields)
        assert status == 200, text
        return re.search(r'hx-get="([^"]+)"', text)[1].replace("&amp;", "&")

    own = [started("limits", V="100:150", **first), started("limits", V="110:150", **first)]
    other = [started("limits", V="120:200", **second), started("export", to="ini", **second)]
    go.set()
    assert all("Done in" in client.until_done(one) for one in own)  # one after another, in the same tab
    for one in other:
        text = client.until_done(one)
        assert "reload the page. Nothing was run." in text
        assert "Not done" in text
        assert "shown-files" not in text  # the page stays out of date
        assert "save" not in text.partition('id="files-of"')[0]  # nothing was written
    (params,) = client.page.project.parameter_files(client.page.project.entry("queue.csv"))
    assert [step.words[0] for step in client.page.project.steps if params in step.words] == ["limits", "limits"]
    speed = json.loads((client.page.project.folder / params).read_text())["limits"]["speed"]
    assert (speed["low"], speed["high"]) == (110, 150)
    assert not list(client.page.project.folder.glob("queue-control.*"))
    assert client.post(f"{name}/run/limits", V="120:200", **second)[0] == 422


def test_a_command_that_is_repeated_twice_at_once_runs_once(tmp_path, monkeypatch):
    with served(tmp_path) as one:
        name = one.upload("twice.csv", wear_table(wear=1.01))[1]
        one.until_done(f"{name}/laws")
        one.run("twice.csv", "limits", V="100:150")
        one.post(f"{name}/again")
        typed = re.search('name="command" value="([^"]+)"', one.until_done(f"{name}/laws"))[1].replace("&#39;", "'")
        go, run = threading.Event(), app_jobs._exit_code
        monkeypatch.setattr(app_jobs, "_exit_code", lambda *job: (go.wait(60), run(*job))[1])
        texts = [one.post(f"{name}/repeat", command=typed)[1] for _ in range(2)]
        go.set()
        ids = [re.search(r'hx-get="([^"]+)"', text)[1].replace("&amp;", "&") for text in texts]
        assert "Done in" in one.until_done(ids[0])
        assert "was run again already" in one.until_done(ids[1])


def test_a_change_of_options_that_changed_meanwhile_is_refused(tmp_path):
    """The reading that tries a change takes seconds; another change may be accepted in them."""
    project = Project(tmp_path)
    shown = project.add("a.csv", io.BytesIO(b"V,f,t,VB\n100,0.2,5,0.1\n"))
    first = project.change(shown, ["--leave-out", "lines 16"], {"lines 16": "chatter"})
    with pytest.raises(UsageError, match="reload the page"):
        project.change(shown, ["--leave-out", "lines 30"], {"lines 30": "chips"})
    assert project.entry("a.csv") == first


@pytest.mark.parametrize("edge", ["P20:3", "E7: new", "E07"])
def test_rows_of_an_edge_that_is_left_out_are_listed_whatever_its_name_is(tmp_path, edge):
    table = wear_table().decode().replace("E3;", f"{edge};").replace(",", ".").replace(";", ",").encode()
    (tmp_path / "a.csv").write_bytes(table)
    assumed = datasets.read_runs(tmp_path / "a.csv", leave_out=[edge]).assumed
    found = rows_left_out([{"design": {"understood": [f"assumed: {words}" for words in assumed]}}])
    assert list(found) == [edge]
    assert found[edge].startswith("4 rows (lines 14, 15, 16 and 17)")


def test_rows_that_a_check_names_are_proposed_as_ranges_of_lines():
    checks = {"repeats": {"verdict": "copied", "suspects": [{"lines": [*range(10, 82), 90], "column": "VB"}]}}
    assert suspects([{"checks": checks}]) == [("lines 10-81,90", "copied", "VB")]


def test_a_command_that_runs_is_shown_when_the_page_is_loaded_again(client, tmp_path):
    name = client.upload("again.csv", wear_table(wear=1.06))[1]
    client.until_done(f"{name}/laws")
    entry = client.page.project.entry("again.csv")
    (path,) = client.page.project.parameter_files(entry)
    job = Job("f" * 16, ("limits", path, "V=100:150", "--force"), tmp_path / "o", tmp_path / "e")
    client.page._runs["again.csv", "limits"] = job, {"V": "100:150"}
    text = client.get(f"{name}/machine")
    assert re.search(r'id="state-limits"[^>]*>running<', text)
    assert f'hx-get="/jobs/{job.id}?file=again.csv"' in text
    assert re.search(r'id="limits-V" name="V" value="100:150"', text)
    job.code = 0
    assert "running<" not in client.get(f"{name}/machine")


def test_a_field_that_is_emptied_means_its_default(client):
    """From tests and a record that is sent with the form to settings whose programmed feed is taken back."""
    examples = Path(__file__).parent.parent / "docs" / "examples"
    name = client.upload("fraesen.csv", (examples / "fraesen.csv").read_bytes())[1]
    client.until_done(f"{name}/laws")
    status, _, text = client.send(f"{name}/run/ident", "upload", "drive.csv", (examples / "drive.csv").read_bytes())
    assert status == 200
    done = client.until_done(re.search(r'hx-get="([^"]+)"', text)[1].replace("&amp;", "&"))
    assert "Dynamics added to" in done
    assert re.search(r'<select id="ident-record"[^>]*hx-swap-oob="true">.*<option value="drive.csv" selected>', done)
    client.run("fraesen.csv", "settings", worn="0.28", **{"feed-programmed": "800", "on-fault": "stop"})
    page = client.get(f"{name}/machine")
    assert re.search(r'name="feed-programmed" value="800" placeholder="empty: the upper feed limit"', page)
    fields = {"worn": "0.28", "feed-programmed": "", "on-fault": ""}
    done = client.run("fraesen.csv", "settings", **fields)
    assert "--feed-programmed default" in done
    assert "--on-fault default" in done
    page = client.get(f"{name}/machine")
    assert re.search(r'name="feed-programmed" value="" ', page)
    # a verdict against the gains, and a refusal after it, in the heading
    done = client.run("fraesen.csv", "tune", rise="2", settle="4", low="521", high="1034", unit="mm/min", scaling="1")
    assert "do not use" in done
    assert re.search(r'id="state-tune" class="verdict bad"[^>]*>do not use[^<]*: kp ', done)
    done = client.run("fraesen.csv", "tune", rise="2", settle="x")
    assert re.search(r'id="state-tune" class="verdict bad"[^>]*>last run refused; the file keeps kp [^<]+<', done)
    # gains that are older than the settings make no control
    client.run("fraesen.csv", "settings", worn="0.29")
    page = client.get(f"{name}/machine")
    assert re.search(r'id="state-tune" class="verdict bad"[^>]*>last run refused; [^<]+; outdated<', page)
    status, text = client.post(f"{name}/run/export", to="hal")
    assert status == 422
    assert "Not exported: outdated: Gains (Constant load changed after it)." in text
    status, text = client.post(f"{name}/run/export", to="ini")
    assert status == 200


def test_a_record_alone_leads_to_the_files_of_tests(tmp_path):
    examples = Path(__file__).parent.parent / "docs" / "examples"
    with served(tmp_path) as one:
        one.upload("drive.csv", (examples / "drive.csv").read_bytes() + b"\n")
        one.until_done("/files/drive.csv/laws")
        page = one.get("/files/drive.csv/machine")
        assert page.index("<strong>These are the dynamics of a record alone") < page.index("action-tune")
        assert "add a file of tests</a>" in page.replace(" to the project", "")
        one.upload("fraesen.csv", (examples / "fraesen.csv").read_bytes())
        one.until_done("/files/fraesen.csv/laws")
        page = one.get("/files/drive.csv/machine")
        assert 'href="/files/fraesen.csv#action-ident"' in page
        assert "by the load law" not in page
        kinds = re.findall(r'<option value="(\w+)"', page[page.index('name="to"') :].partition("</select>")[0])
        assert kinds == ["mat", "ssv", "h", "ini"]
        assert "Next:" not in one.run("drive.csv", "check")


def test_fields_have_labels_in_words_and_say_what_an_empty_one_means(tmp_path):
    (tmp_path / "params.json").write_text('{"laws": {"I": {"unit": "A", "form": "feed_line"}}}')
    forms = actions(subject_of(tmp_path, "d", "params.json", []))
    fields = {f"{form.name}-{one.name}": one for form in forms for one in form.inputs}
    assert not [one.label for one in fields.values() if "_" in one.label]
    assert fields["settings-safety-factor"].placeholder == "empty: 0.85"
    assert fields["settings-worn"].placeholder == "e.g. 0.28"
    assert fields["settings-feed-programmed"].label.startswith("feed that programs command (F), mm/min")
    assert fields["tune-scaling"].placeholder == "empty: by the load law"
    to = places(forms, {}, "settings")
    assert on_page("Kept: feed_programmed 1100 mm/min", to) == "Kept: feed that programs command 1100 mm/min"
    assert on_page("from 180 to 220 um", to) == "from 180 to 220 µm"


def test_the_card_follows_an_export_where_it_is_outdated(client):
    name = client.upload("follow.csv", wear_table(wear=1.07))[1]
    client.until_done(f"{name}/laws")
    client.run("follow.csv", "limits", V="100:150")
    assert 'data-open="action-card"' in client.run("follow.csv", "export", to="ini")
    client.run("follow.csv", "card")
    assert 'data-open="action-card"' not in client.run("follow.csv", "export", to="ini")
    assert "begins section 3 anew" in client.until_done(f"{name}/reading")


def test_texts_of_a_file_are_text_on_the_page(client):
    head = HEAD.replace("edge;", f"edge{HOSTILE};").replace("VB [mm]", "VB [mm]")
    client.upload("script.csv", wear_table(head))
    for part in ("reading", "laws"):
        assert HOSTILE not in client.until_done(f"/files/script.csv/{part}")
    assert HOSTILE not in client.get("/")


def test_a_zip_bomb_is_refused_by_the_reader(client):
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as book:
        book.writestr("[Content_Types].xml", "<Types/>")
        book.writestr("xl/worksheets/sheet1.xml", b"0" * 300_000_000)
    client.upload("bomb.xlsx", made.getvalue())
    text = client.until_done("/files/bomb.xlsx/reading")
    assert "Not read" in text
    assert "Traceback" not in text


def test_the_picture_of_a_reading_is_no_result_of_a_command(tmp_path):
    project = Project(tmp_path)
    entry = project.add("a.csv", io.BytesIO(b"V\n1\n"))
    for name in ("a-look.png", "a-next.csv"):
        (tmp_path / name).write_text("x")
    assert written(project, entry, Job("1", ("check",), tmp_path, tmp_path, clock_time=1.0)) == ["a-next.csv"]
    assert written(project, entry, Job("1", ("check",), tmp_path, tmp_path)) == []  # it was not started


def test_commands_that_have_made_a_card_are_no_remedy(tmp_path):
    """The provenance of a card chains what was added to its file; a remedy is one command on the table."""
    project = Project(tmp_path)
    entry = project.add("a.csv", io.BytesIO(b"V\n1\n"))
    card = {
        "provenance": {"command": "fitmodels a.csv --work X && fitmodels settings params.json --worn 0.28 --force"},
        "laws": [{"command": "fitmodels a.csv --unit VB=um"}, {"command": "fitmodels a.csv --x 1 && fitmodels card p"}],
    }
    path = tmp_path / "card.json"
    path.write_text(json.dumps(card))
    assert remedies(entry, {"a-fit/p/card.json": path}) == ["--unit VB=um"]


def test_a_remedy_must_be_one_that_was_named(client):
    client.upload("remedy.csv", wear_table(wear=1.02))
    client.until_done("/files/remedy.csv/reading")
    assert client.post("/files/remedy.csv/apply", options="--out /tmp/x")[0] == 422
    for what, of, to in (
        ("unit", "VB", "kW"),
        ("role", "", "V"),
        ("x", "", ""),
        ("tool", "", "-x"),
        ("unit", "nil", "mm"),
    ):
        assert client.post("/files/remedy.csv/set", set=what, of=of, to=to)[0] == 422
    assert client.page.project.entry("remedy.csv").options == ()


@pytest.mark.parametrize("value", ["x\ny", "v" * 300, "\x00"])
def test_values_of_forms_are_bounded(client, value):
    client.upload("gc.csv", BUNDLED)
    client.until_done("/files/gc.csv/laws")
    assert client.post("/files/gc.csv/run/limits", P=value)[0] == 422
    assert client.post("/files/gc.csv/run/nothing", P="7")[0] == 404


def test_a_record_is_identified_and_its_columns_can_be_chosen(client):
    drive = Path(__file__).parent.parent / "docs" / "examples" / "drive.csv"
    client.upload("drive.csv", drive.read_bytes())
    text = client.until_done("/files/drive.csv/reading")
    assert "A record of one run" in text
    assert "G(z)" in client.until_done("/files/drive.csv/laws")
    assert client.post("/files/drive.csv/set", set="output", to="col3")[0] == 200
    assert "fitmodels ident drive.csv --output col3 --out drive-fit" in client.get("/files/drive.csv")


# what goes wrong around it


def test_a_project_file_that_another_program_changed_is_not_replaced(tmp_path):
    with served(tmp_path) as one:
        one.upload("gc.csv", BUNDLED)
        one.until_done("/files/gc.csv/laws")
        other = Project(tmp_path)  # of a second page of the same folder
        other.add("b.csv", io.BytesIO(b"V\n1\n"))
        kept = (tmp_path / "project.json").read_bytes()
        status, text = one.upload("c.csv", b"V\n2\n")
        assert status == 422
        assert "changed by another program" in text
        one.run("gc.csv", "limits", P="7kW")  # runs, and is not recorded
        assert "could not be recorded" in one.get("/")
    assert (tmp_path / "project.json").read_bytes() == kept
    assert not (tmp_path / "c.csv").exists()


def test_results_that_vanish_while_they_are_listed_are_left_out(tmp_path, monkeypatch):
    project = Project(tmp_path)
    entry = project.add("a.csv", io.BytesIO(b"V\n1\n"))
    (tmp_path / "a-fit").mkdir()
    (tmp_path / "a-next.csv").write_text("V\n")

    def vanished(*_):
        raise FileNotFoundError(errno.ENOENT, "No such file or directory")

    monkeypatch.setattr(Path, "rglob", vanished)  # as when a command replaces the folder
    assert list(project.results(entry)) == ["a-next.csv"]
    assert older(project, entry, {"a-gone.csv": tmp_path / "a-gone.csv"}) == {}


def test_results_that_are_damaged_do_not_stop_the_page(tmp_path):
    with served(tmp_path) as one:
        one.upload("gc.csv", BUNDLED)
        one.until_done("/files/gc.csv/laws")
        (name,) = one.page.project.parameter_files(one.page.project.entry("gc.csv"))
        for text in (
            "{",
            "[]",
            '{"laws": []}',
            '{"laws": {"P": 1}}',
            '{"design": {"factors": [1]}}',
            '{"load_line": {"lower": 1}}',
        ):
            (tmp_path / name).write_text(text)
            (tmp_path / name).with_name("card.json").write_text(text)
            for page in ("/", "/files/gc.csv", "/files/gc.csv/laws", "/files/gc.csv/machine"):
                one.get(page)
        assert "Not done" in one.run("gc.csv", "limits")
        (tmp_path / "gc.csv").write_bytes(BUNDLED + b"1")
        assert "no longer the one that was added" in one.get("/files/gc.csv")
        (tmp_path / "gc.csv").unlink()
        assert "no longer the one that was added" in one.get("/files/gc.csv")


def test_a_full_disk_is_said(client, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(client.page.project, "add", full)
    status, text = client.upload("full.csv", b"V\n3\n")
    assert status == 507
    assert "no space left on device. Nothing was changed." in text


def test_a_record_has_the_forms_that_need_no_law(tmp_path):
    (tmp_path / "params.json").write_text('{"dynamics": {"sample_time": 0.02}}')
    subject = subject_of(tmp_path, "d", "params.json", [])
    assert [one.name for one in actions(subject)] == ["tune", "card", "check", "export"]


# its parts


def test_messages_name_the_forms_and_fields_of_the_page(tmp_path):
    """No option, and no command that the page has as a form, is left in the messages of what is missing."""
    (tmp_path / "params.json").write_text('{"laws": {"I": {"unit": "A"}}}')
    forms = actions(subject_of(tmp_path, "d", "params.json", ["drive.csv"]))
    to = places(forms, {"columns": [{"role": "VB", "number": 4}]})
    for text, links in (
        ("fitmodels: d has no costs; write them with fitmodels costs d/params.json machine=60/h edge=8.", ["costs"]),
        ("fitmodels costs: these are required: machine=60/h; see 'fitmodels costs -h'.", []),
        ("no dynamics: fitmodels ident run.csv --params d/params.json.", ["ident"]),
        ("no PI gains; find them with `fitmodels tune params.json`.", ["tune"]),
        ("write it: fitmodels limits PARAMS AW=0.3mm, or VB=0.3mm by the name of its wear law.", ["limits"]),
        ("the limit at the middle of the window, --wear-limit 0.2mm.", ["settings-wear-limit"]),
        ("`fitmodels settings --idle`, or fit runs", ["settings-idle"]),
        ("9 edges; --edge none takes the rows as independent; name it with --work", ["set-edge", "set-work"]),
        ("give --map VB=none, --map f=col3 or --unit VB=um", ["role-4", "role-3", "unit-4"]),
    ):
        shown = str(on_page(text, places(forms, {}, "settings") if "wear-limit" in text else to))
        assert re.findall('data-open="(?:action-)?([^"]+)"', shown) == links, shown
        words = re.sub("<[^>]+>", "", shown)
        assert "--" not in words
        assert "fitmodels" not in words
    assert on_page("<b>&", to) == "&lt;b&gt;&amp;"
    remedy = "Remedy: fitmodels next a.csv --map f=col3 --map d=col4 --unit f=mm/rev --unit d=mm --out a-next.csv"
    assert re.sub("<[^>]+>", "", on_page(remedy, to)) == "Remedy: Plan further tests"
    costs = "write them: fitmodels costs d/params.json machine=60/h edge=8 --force"
    assert 'data-fill="machine=60/h edge=8"' in on_page(costs, to)
    for text, words in (
        ("For gains in feed add --unit mm/min --force.", "For gains in feed set Gains, unit of the command: mm/min."),
        ("no such: --x (did you mean --draws?); see 'fitmodels FILE -h'.", "no such: --x."),
        ("the end, --wear-limit 0.2mm.", "the end, Constant load, wear for the lower feed limit: 0.2mm."),
    ):
        assert re.sub("<[^>]+>", "", on_page(text, places(forms, {}, "tune"))) == words
    assert "in a terminal" in on_page("add it with `fitmodels roughness`.", to)


def test_the_sheet_that_was_read_is_named_and_another_is_chosen_by_a_menu(client):
    import openpyxl

    book = openpyxl.Workbook()
    for k, title in enumerate(("Halle 1", "Halle 2")):
        sheet = book.active if k == 0 else book.create_sheet()
        sheet.title = title
        for line in wear_table().decode().replace(",", ".").splitlines():
            sheet.append([float(cell) if cell[0].isdigit() else cell for cell in line.split(";")])
    made = io.BytesIO()
    book.save(made)
    client.upload("halls.xlsx", made.getvalue())
    text = client.until_done("/files/halls.xlsx/reading")
    assert "several sheets" in text
    assert '<option value="Halle 2">' in text
    assert client.post("/files/halls.xlsx/set", set="sheet", to="Halle 2")[0] == 200
    text = client.until_done("/files/halls.xlsx/reading")
    assert "sheet <strong>Halle 2</strong>" in text
    assert '<option value="Halle 1">' in text
    assert "--sheet 'Halle 2'" in client.get("/files/halls.xlsx").replace("&#39;", "'")


def test_numbers_of_tests_that_are_edges_are_listed_as_assumed():
    columns = [{"number": 1, "header": "Versuch", "role": "edge"}]
    look = {"columns": columns, "assumed": ["left out as asked, --leave-out lines 3: 1 row (line 3)", "work: unnamed"]}
    assert [words.split(":")[0] for words in assumptions(look, [])] == [
        "work",
        "column 'Versuch' numbers the cutting edges",
    ]
    assert assumptions(look, ["--edge", "Versuch"]) == ["work: unnamed"]
    columns[0]["header"] = "Schneide"
    assert assumptions(look, []) == ["work: unnamed"]


def test_of_two_columns_that_disagree_the_cell_that_jumps_is_the_one_to_correct(tmp_path):
    """Force times speed and power disagree in a line where the force, of a slipped decimal mark, jumps."""
    path = tmp_path / "a.csv"
    path.write_text("Fc [N],P [kW]\n458,1.4\n4549,1.35\n472,1.42\n")
    columns = [{"number": 1, "role": "Fc", "unit": "N"}, {"number": 2, "role": "P", "unit": "kW"}]
    cells = cells_of(path, (), {"columns": columns, "units": {"Fc": "N", "P": "kW"}})
    both = {"columns": ["P", "Fc", "V"], "sentence": "P is 0.0989 times Fc V/60000 in 1 row (line 3)", "lines": [3]}
    jump = "Fc jumps within an edge: line 3 has 4549 N, its neighbours in edge 1 458 and 472; a digit may have slipped"
    (cell,) = cells.of_doubt(both, [both, {"columns": ["Fc"], "sentence": jump, "lines": [3]}])
    assert (cell.symbol, cell.line, cell.ready) == ("Fc", 3, 454.9)
    assert [one.symbol for one in cells.of_doubt(both, [both])] == ["P"]


def test_the_lines_of_a_doubt_are_those_of_its_field_and_none_of_its_sentence(tmp_path):
    """ "lines 2, 3, 4, 5, 6 and 23 more" showed the sound line 23 as doubted."""
    path = tmp_path / "a.csv"
    names = "".join(f"{name},100,{k / 10}\n" for name in ("E1", "E2") for k in range(1, 16))
    path.write_text(f"edge,V,VB\n{names}")
    columns = [{"number": k, "role": role, "unit": None} for k, role in enumerate(("edge", "V", "VB"), 1)]
    cells = cells_of(path, (), {"columns": columns, "units": {}})
    many = {"columns": ["VB"], "sentence": "VB in lines 2, 3, 4, 5, 6 and 23 more", "lines": [2, 3, 4, 5, 6, 8, 9, 30]}
    assert [one.line for one in cells.of_doubt(many)] == [2, 3, 4, 5, 6, 8]
    look = {"doubts": [many], "lines": [2, 3, 4]}
    assert [(row.line, row.doubted) for row in named_rows(look, cells, ())] == [
        (line, True) for line in (5, 6, 8)
    ]  # fmt: skip
    edge = {
        "columns": ["VB"],
        "sentence": "VB is of another order in edge E2 by a factor of 25",
        "lines": [*range(17, 32)],
    }
    assert cells.of_doubt(edge) == []
    assert named_rows({"doubts": [edge], "lines": []}, cells, ()) == []
    odd = "V changes within an edge: line 19 has 1000 where the other rows of edge E2 have 100; correct the cell"
    (cell,) = cells.of_doubt({"columns": ["V"], "sentence": odd, "lines": [*range(17, 32)]})
    assert (cell.line, cell.ready) == (19, 10.0)  # of 100 in the file, ten times too much by the sentence
    assert cells.of_doubt({"columns": ["V"], "sentence": "V is constant in lines 2, 3", "lines": []}) == []
    wide = [{"number": k, "role": role, "unit": None} for k, role in enumerate(("V", "f", "t", "VB"), 1)]
    path.write_text("V,f,t,VB\n" + "100,0.1,2,0.1\n" * 3)
    copies = {"columns": ["V", "f", "t", "VB"], "sentence": "lines 3 and 4 repeat earlier rows", "lines": [3, 4]}
    assert cells_of(path, (), {"columns": wide, "units": {}}).of_doubt(copies) == []


def test_a_command_is_cancelled_and_another_waits(tmp_path):
    jobs = Jobs(cli.main, tmp_path)
    try:
        (tmp_path / "a.csv").write_bytes(BUNDLED)
        running = [jobs.start(["a.csv", "--draws", "1000000", "--out", str(k)]) for k in range(2)]
        waits = jobs.start(["--version"])
        end = time.monotonic() + 30
        while any(job.state != "running" for job in running) and time.monotonic() < end:
            time.sleep(0.02)
        assert waits.state == "waiting"
        for job in running:
            jobs.cancel(job)
        waits.future.result(60)
        for job in running:
            job.future.result(60)
            assert (job.state, "draws" in job.errors) == ("cancelled", False)
            assert job.code != 0
        assert (waits.state, waits.code) == ("done", 0)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv"]
    finally:
        jobs.close()


@pytest.fixture
def importable(monkeypatch):
    """Processes of commands find the modules of the tests."""
    monkeypatch.syspath_prepend(Path(__file__).parent)


@pytest.mark.usefixtures("importable")
def test_commands_that_write_the_results_of_one_file_run_one_after_another(tmp_path):
    """Settings changed while a fit writes its results had met "written by another process" in the next fit."""
    jobs = Jobs(slow_command, tmp_path)
    try:
        first = jobs.start(["a", "own"], "one.csv")
        end = time.monotonic() + 30
        while not (tmp_path / "own").exists() and time.monotonic() < end:
            time.sleep(0.01)
        jobs.cancel(first)
        unwanted = jobs.start(["b", "own"], "one.csv")
        last = jobs.start(["c", "own"], "one.csv")
        jobs.cancel(unwanted)
        assert (unwanted.state, unwanted.code) == ("cancelled", 130)
        other = jobs.start(["d", "other"], "two.csv")
        other.future.result(60)
        last.future.result(60)
        assert (tmp_path / "own").read_text() == "a<a>c<c>"
        assert first.ended <= last.started
        assert other.started < last.ended
        assert [job.state for job in (first, unwanted, last, other)] == ["cancelled", "cancelled", "done", "done"]
    finally:
        jobs.close()


@pytest.mark.usefixtures("importable")
def test_a_command_that_gets_no_process_says_so_and_the_next_one_runs(tmp_path, monkeypatch):
    jobs = Jobs(slow_command, tmp_path)
    try:
        start = jobs._context.Process.start

        def refused(process):
            monkeypatch.setattr(jobs._context.Process, "start", start)
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

        monkeypatch.setattr(jobs._context.Process, "start", refused)
        first, second = jobs.start(["a", "own"], "one.csv"), jobs.start(["b", "own"], "one.csv")
        second.future.result(60)
        assert (first.state, first.code, first.future.done()) == ("done", 1, True)
        assert re.fullmatch(r"The command was not run to its end: .*open files.* Run it again\.\n", first.errors)
        assert (tmp_path / "own").read_text() == "b<b>"
    finally:
        jobs.close()


def test_a_command_that_cannot_be_recorded_has_ended_all_the_same(tmp_path):
    def failing(*_):
        raise ValueError("no such record")

    jobs = Jobs(cli.main, tmp_path, ended=failing)
    try:
        job = jobs.start(["--version"], "a.csv")
        job.future.result(60)
        assert job.code == 0
        assert job.output.startswith("fitmodels")
        assert job.errors == "The command has ended, but it could not be recorded: ValueError('no such record').\n"
        next_one = jobs.start(["--version"], "a.csv")
        next_one.future.result(60)
        assert next_one.code == 0
    finally:
        jobs.close()


@pytest.mark.usefixtures("importable")
def test_a_command_that_is_killed_says_so(tmp_path):
    """As when memory runs out: the page stated that the reason stands above, and nothing did."""
    jobs = Jobs(slow_command, tmp_path)
    try:
        first, second = jobs.start(["a", "own"], "one.csv"), jobs.start(["b", "own"], "one.csv")
        end = time.monotonic() + 30
        while not (tmp_path / "own").exists() and time.monotonic() < end:
            time.sleep(0.01)
        os.kill(first.process.pid, signal.SIGKILL)
        second.future.result(60)
        assert (first.code, second.code) == (-signal.SIGKILL, 0)
        assert "ended from outside, as the system does when memory runs out. Run it again." in first.errors
        assert (tmp_path / "own").read_text() == "a<b<b>"
    finally:
        jobs.close()


@pytest.mark.usefixtures("importable")
def test_many_commands_that_were_cancelled_while_they_waited_do_not_hold_up_the_last(tmp_path):
    jobs = Jobs(slow_command, tmp_path)
    try:
        first = jobs.start(["a", "own"], "one.csv")
        for _ in range(1500):
            jobs.cancel(jobs.start(["b", "own"], "one.csv"))
        last = jobs.start(["c", "own"], "one.csv")
        last.future.result(60)
        assert (first.code, last.code, (tmp_path / "own").read_text()) == (0, 0, "a<a>c<c>")
        waits = [jobs.start(["d", "own"], "one.csv") for _ in range(2)]
    finally:
        jobs.close()
    assert all(job.future.done() and job.state == "cancelled" for job in waits)
    with pytest.raises(RuntimeError, match="shutdown"):
        jobs.start(["e", "own"], "one.csv")


def test_options_are_set_once_each():
    options = ["--unit", "VB=mm", "--leave-out", "E1", "--form", "VB=linear"]
    assert replaced(options, "--form", "VB=power") == ["--unit", "VB=mm", "--leave-out", "E1", "--form", "VB=power"]
    assert replaced(options, "--leave-out", "E2") == [*options, "--leave-out", "E2"]
    assert applied(options, "--leave-out E1") == ["--unit", "VB=mm", "--form", "VB=linear", "--leave-out", "E1"]
    assert of_comparison(options) == ["--unit", "VB=mm", "--leave-out", "E1"]


def test_every_form_is_a_command_that_parses(tmp_path):
    """The words of each filled form are those of its command."""
    from importlib import import_module

    (tmp_path / "params.json").write_text('{"laws": {"AW": {"unit": "mm"}}, "tool_life": {}}')
    subject = subject_of(tmp_path, "d", "params.json", ["run.csv"])
    for action in actions(subject):
        filled = {one.name: one.choices[-1][0] if one.choices else one.hint or "1" for one in action.inputs}
        words = command(action, subject, filled, ["d.csv"])
        parser = import_module(f"fitmodels.cli.{words[0].replace('-', '_')}").parser()
        parser.parse_args(words[1:])


def test_decimal_commas_of_fields_become_points(tmp_path):
    """A German engineer types 0,28; the command that is shown has 0.28."""
    (tmp_path / "params.json").write_text('{"laws": {"I": {"unit": "A"}}}')
    subject = subject_of(tmp_path, "d", "params.json", ["run.csv"])
    forms = {one.name: one for one in actions(subject)}
    assert "I=0.28 A" in command(forms["limits"], subject, {"I": "0,28 A"}, [])
    with pytest.raises(UsageError, match="can be read in two ways"):
        command(forms["limits"], subject, {"I": "1,500"}, [])


def test_the_limits_of_the_gains_are_those_of_the_constant_load(tmp_path):
    """The feed limits that the settings gave, and their unit, stand in the form of the gains."""
    line = {"lower": {"value": 513.005}, "upper": {"value": 1031.23}, "unit_feed": "mm/min"}
    (tmp_path / "params.json").write_text(json.dumps({"laws": {"I": {"unit": "A"}}, "load_line": line}))
    forms = {one.name: one for one in actions(subject_of(tmp_path, "d", "params.json", []))}
    assert {one.name: one.value for one in forms["tune"].inputs if one.value} == {
        "low": "514", "high": "1031", "unit": "mm/min",
    }  # fmt: skip
    assert list(forms).index("settings") < list(forms).index("ident") < list(forms).index("tune")


LINE = {"reference": 0.24, "unit_load": "A", "unit_feed": "mm/min", "lower": {"value": 601}, "upper": {"value": 1019}}


def run_project(folder, commands):
    """A project of one table, of which commands were run, with a parameter file that holds all that they add."""
    project, path = Project(folder), "a-fit/p/params.json"
    entry = project.add("a.csv", io.BytesIO(b"V\n1\n"))
    content = {"laws": {"I": {"unit": "A"}}, "load_line": LINE, "pi": {"kp": 1, "ki": 2}}
    (folder / "a-fit" / "p").mkdir(parents=True)
    (folder / path).write_text(json.dumps(content))
    for text, code in commands:
        project.ran(shlex.split(text.replace("PARAMS", path)), code)
    return project, entry, subject_of(folder, "a", path, ["run.csv"])


def test_settings_that_the_file_has_kept_are_repeated_too(tmp_path):
    """What a second command of settings left as it was is part of what a new fit has undone, and of the form."""
    commands = [
        ("settings PARAMS --worn 0.28 --idle 0.12 --on-fault stop --force", 0),
        ("settings PARAMS --worn 0.3 --idle 0.2 --force", 2),  # refused
        ("settings PARAMS --worn 0.27 --wear-limit 196um --feed-programmed 1000 --force", 0),
    ]
    project, entry, of = run_project(tmp_path, commands)
    given = {"worn": "0.27", "wear-limit": "196um", "feed-programmed": "1000", "idle": "0.12", "on-fault": "stop"}
    form = next(one for one in filled(project, entry, of) if one.name == "settings")
    assert {one.name: one.value for one in form.inputs if one.value} == given
    assert to_repeat(project, entry) == []
    project.ran(("a.csv", "--leave-out", "E1", "--force"), 0)
    (tmp_path / of.params).write_text('{"laws": {"I": {"unit": "A"}}}')
    (words,) = to_repeat(project, entry)
    assert shlex.join(words[2:]) == (
        "--worn 0.27 --wear-limit 196um --feed-programmed 1000 --idle 0.12 --on-fault stop --force"
    )
    of = subject_of(tmp_path, "a", of.params, [])
    form = next(one for one in filled(project, entry, of) if one.name == "settings")
    assert {one.name: one.value for one in form.inputs if one.value} == given
    assert states(project, entry, of)["settings"].words == "outdated"
    project.ran(words, 0)
    assert to_repeat(project, entry) == []


def test_values_of_the_settings_have_the_labels_of_their_fields():
    to = places((), {}, "settings")
    said = "Assumed, each replaced by the option of its name: heartbeat 0.2 s; dwell 4 s; load_low 1 A; the dwell of it"
    shown = on_page(said, to)
    assert "by its field under More fields: time without a sign of the load" in shown
    assert (
        "; time at the lower feed limit before the tool counts as worn 4 s; smallest valid load reading 1 A;" in shown
    )
    assert shown.endswith("the dwell of it")


def test_laws_that_must_not_be_used_lead_to_no_limits(client):
    rows = [
        f"E{k};{V};{f};2;{t};{0.1 + 0.05 * ((7 * k + 3 * t) % 5):.4f}"
        for k, (V, f) in enumerate((V, f) for V in (100, 150, 200) for f in (0.1, 0.2, 0.3))
        for t in (2, 4, 8, 12)
    ]
    client.upload("random.csv", (HEAD + "\n".join(rows)).replace(".", ",").encode())
    text = client.until_done("/files/random.csv/laws")
    assert "do not use" in text
    assert "None of these laws may be used" in text
    assert "Next:" not in text


def test_a_card_older_than_its_file_is_outdated_also_after_the_page_was_opened_again(tmp_path):
    """A fit at opening that writes nothing, because its result is there, is no new card."""
    project, entry, of = run_project(tmp_path, [("card PARAMS --force", 0), ("limits PARAMS P=5kW --force", 0)])
    path, card = tmp_path / of.params, (tmp_path / of.params).with_name("card.html")
    card.write_text("card")
    os.utime(card, (path.stat().st_mtime - 5,) * 2)
    project.ran(("a.csv",), 0)
    found = states(project, entry, of)["card"]
    assert (found.words, "card.html is older than params.json" in found.outdated) == ("outdated", True)
    name = card.relative_to(tmp_path).as_posix()
    assert older(project, entry, project.results(entry))[name] == ("card", of.params, "--force")
    card.touch()
    assert states(project, entry, of)["card"].words.startswith("done")


def test_a_fit_that_was_cancelled_is_started_again_on_the_page(client):
    client.upload("gc.csv", BUNDLED)
    client.until_done("/files/gc.csv/laws")
    client.page._shown["gc.csv"].laws.cancelled = True
    assert "The fit was cancelled" in (laws := client.get("/files/gc.csv/laws"))
    assert re.search(r'hx-post="/files/gc.csv/again"[^>]*><button>Fit again</button>', laws)
    assert client.post("/files/gc.csv/again")[0] == 200
    assert "AW = " in client.until_done("/files/gc.csv/laws")


def test_a_file_that_is_there_under_another_name_is_said_to_be_the_same(client):
    """The page of the former name opened without a word, as if the new file had been lost."""
    client.upload("gc.csv", BUNDLED)
    place = client.upload("copy <b>.csv", BUNDLED)[1]
    assert place == "/files/gc.csv?same=copy_b.csv"
    assert "copy_b.csv has the same content as gc.csv" in client.get(place)
    assert client.upload("gc.csv", BUNDLED)[1] == "/files/gc.csv"


def test_each_form_states_what_was_done(tmp_path):
    commands = [
        ("settings PARAMS --worn 0.28 --force", 0),
        ("tune PARAMS --settle 8 --low 600 --high 1000 --unit mm/min --force", 0),
        ("check PARAMS", 0),
    ]
    project, entry, of = run_project(tmp_path, commands)
    found = states(project, entry, of)
    words = "done: reference 0.24 A, feed 601 to 1019 mm/min, an unknown share of tools within the wear at tool change"
    assert (found["settings"].words, found["settings"].colour) == (words, "doubt")
    assert found["tune"].words == "done: kp 1, ki 2"
    assert found["check"].words == "done: passed"
    assert found["export"].words == found["costs"].words == "not done"
    assert "compare" not in found
    project.ran(("tune", of.params, "--settle", "9", "--force"), 0)
    assert states(project, entry, of)["check"].outdated == "Gains changed after it"
    project.ran(("check", of.params), 5)
    assert states(project, entry, of)["check"].words == "refused"
    project.ran(("settings", of.params, "--worn", "0.3", "--force"), 0)
    assert states(project, entry, of)["tune"].outdated == "Constant load changed after it"


def test_menus_have_the_plausible_first():
    look = {
        "columns": [
            {"number": 1, "header": "x", "name": "x", "role": None, "unit": "kW"},
            {"number": 2, "header": "vc", "name": "vc", "role": "V", "unit": ""},
        ],
        "units": {"V": "m/min"}, "doubts": [{"columns": ("V",)}],
    }  # fmt: skip
    power, speed = column_menus(look, "de")
    assert [one.value for one in power.roles[:2]] == ["", "P"]
    assert power.units == ()
    assert speed.roles[0].label == "V Schnittgeschwindigkeit"
    assert speed.units[0].value in ("", "m/min")
    assert speed.doubted
    assert units_of("P")[0] == "kW"
    assert role_label("Fxz", "es") == "Fxz thrust force"
    with pytest.raises(UsageError):
        option_of_change({"set": "role", "column": "9", "to": "V"}, look["columns"])


def test_a_page_that_is_no_card_runs_nothing():
    assert policy_of_card("<script>1</script>").startswith("default-src 'none';")


def test_the_command_of_a_file_is_typed(tmp_path):
    entry = Project(tmp_path).add("a.csv", io.BytesIO(b"V\n1\n"))
    assert shlex.join(["fitmodels", *command_of(entry, force=True)]) == "fitmodels a.csv --force"


def test_the_command_serves_until_it_is_interrupted(tmp_path):
    """The example of its help, as a process: an address with a token, an answer, and an end without words."""
    (tmp_path / "data.csv").write_bytes(wear_table())
    words = [sys.executable, "-m", "fitmodels", "app", "data.csv", "--no-browser", "--quiet"]
    with subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        address = process.stdout.readline().strip()
        host, _, token = address.removeprefix("http://").partition("/start/")
        connection = http.client.HTTPConnection(host, timeout=30)
        connection.request("GET", f"/start/{token}")
        assert connection.getresponse().status == 303
        connection.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(120) == 0
        assert process.stderr.read() == ""
    assert json.loads((tmp_path / "fitmodels-project" / "project.json").read_text())["files"][0]["name"] == "data.csv"


def test_the_server_collects_its_garbage(tmp_path, monkeypatch):
    """A page that was rendered refers to itself; the process runs without the collector until it serves."""
    seen = []
    monkeypatch.setattr(server, "serve", lambda *given: seen.append((gc.isenabled(), gc.get_freeze_count() > 0)))
    gc.disable()
    try:
        assert cli.main(["app", "--no-browser", "--folder", str(tmp_path / "project")]) == 0
    finally:
        gc.enable()
        gc.unfreeze()
    assert seen == [(True, True)]


def test_a_taken_port_is_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert cli.main(["app", "--no-browser", "--port", str(port)]) == 2
    assert "--port" in capsys.readouterr().err
    assert cli.main(["app", "--no-browser", "--port", "70000"]) == 2
    assert cli.main(["app", "missing.csv", "--no-browser"]) in (2, 3)
