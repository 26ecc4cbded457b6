"""The page of ``setid serve``, through its HTTP interface and in a browser."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("flask")

import setid
from setid.cli import main
from setid.serve import server
from setid.serve.server import Jobs, make_app
from sparsepop_py.executors.processes import Processes

ROOT = Path(__file__).resolve().parents[3]
CHANGE = {"X-Setid": "page"}
RECORD = b"u,y\n4,0\n-3,-6.25\n2,1.175\n1,2.0875\n"  # by hand: b0 in [23/12, 2.1093]
FORM: dict[str, Any] = {
    "inputs": ["u"],
    "outputs": ["y"],
    "Ts": 1,
    "samples": 0,
    "structure": "TransferFunction",
    "na": 1,
    "nb": 1,
    "nk": 0,
    "equation": 0.5,
    "output": 0,
    "input": 0,
    "seconds": 20,
}


@pytest.fixture
def jobs(tmp_path: Path) -> Iterator[Jobs]:
    made = Jobs(tmp_path / "files")
    (tmp_path / "files").mkdir()
    yield made
    made.close()


@pytest.fixture
def client(jobs: Jobs) -> Any:
    return make_app(jobs).test_client()


def send(client: Any, content: bytes = RECORD) -> Any:
    return client.post("/records", data=content, headers=CHANGE, base_url="http://127.0.0.1")


def start(client: Any, **fields: Any) -> Any:
    record = send(client).json["record"]
    given = {**FORM, "record": record, **fields}
    return client.post("/jobs", json=given, headers=CHANGE, base_url="http://127.0.0.1")


def state(client: Any, job: str) -> Any:
    return client.get(f"/jobs/{job}", base_url="http://127.0.0.1").json


def ended(client: Any, job: str) -> Any:
    for _ in range(1200):
        found = state(client, job)
        if found["state"] != "running":
            return found
        time.sleep(0.05)
    raise AssertionError(found)


def test_a_record_gives_proved_intervals_and_files(client: Any) -> None:
    found = send(client).json
    assert (found["columns"], found["samples"]) == (["u", "y"], 4)
    job = start(client, samples=3 + 1).json["job"]
    done = ended(client, job)
    assert (done["state"], done["status"]) == ("done", "certified"), done
    titles = [part["title"] for part in done["sections"]]
    assert titles[:2] == ["Do the noise bounds explain the record?", "Intervals"]
    assert "1.91666" in done["sections"][1]["html"]
    assert sum(part["html"].startswith("<svg") for part in done["sections"]) >= 2
    assert done["files"] == ["report.txt", "result.json", "certificate.json"]
    files = {
        name: client.get(f"/jobs/{job}/{name}", base_url="http://127.0.0.1")
        for name in done["files"]
    }
    result = setid.Identification.from_json(files["result.json"].text)  # verifies it
    assert result.intervals["b0"].outer[0] <= 23 / 12 <= result.intervals["b0"].outer[0] + 1e-9
    assert files["certificate.json"].json["is"] == "identification"
    assert "attachment" in files["report.txt"].headers["Content-Disposition"]


def test_a_table_with_decimal_commas_says_the_same(client: Any) -> None:
    commas, local = RECORD.replace(b",", b";").replace(b".", b","), "http://127.0.0.1"
    sent = client.post("/records?decimal=,", data=commas, headers=CHANGE, base_url=local).json
    assert (sent["columns"], sent["samples"]) == (["u", "y"], 4)
    given = {**FORM, "record": sent["record"]}
    job = client.post("/jobs", json=given, headers=CHANGE, base_url=local).json["job"]
    assert "1.91666" in ended(client, job)["sections"][1]["html"]
    wrong = client.post("/records?decimal=%3B", data=RECORD, headers=CHANGE, base_url=local)
    assert wrong.status_code == 400 and wrong.json["error"].startswith("decimal: found ';'")


def test_validation_uses_the_rest_of_the_file(client: Any) -> None:
    record = (ROOT / "examples/data/hairdryer.csv").read_bytes()
    name = send(client, record).json["record"]
    fields = {"na": 2, "nb": 2, "nk": 3, "offset": True, "equation": 0.11, "samples": 100}
    given = {**FORM, **fields, "Ts": 0.08, "record": name}
    begun = client.post("/jobs", json=given, headers=CHANGE, base_url="http://127.0.0.1")
    done = ended(client, begun.json["job"])
    assert done["state"] == "done", done
    assert "Validation on the rest of the file, prediction" in [
        part["title"] for part in done["sections"]
    ]


def test_an_empty_set_is_an_answer(client: Any) -> None:
    done = ended(client, start(client, equation=1e-9).json["job"])
    assert (done["state"], done["status"]) == ("done", "empty")


def test_long_work_shows_progress_and_stops(client: Any) -> None:
    record = (ROOT / "examples/data/hairdryer.csv").read_bytes()
    name = send(client, record).json["record"]
    fields = {"na": 3, "nb": 3, "equation": 0, "output": 0.3, "input": 0.1, "samples": 300}
    given = {**FORM, **fields, "record": name, "seconds": 600}
    begun = client.post("/jobs", json=given, headers=CHANGE, base_url="http://127.0.0.1")
    job = begun.json["job"]
    for _ in range(600):
        if "stage" in state(client, job):
            break
        time.sleep(0.05)
    assert state(client, job)["stage"] == "consistency"
    stopped = client.delete(f"/jobs/{job}", headers=CHANGE, base_url="http://127.0.0.1")
    assert stopped.status_code == 200
    assert ended(client, job)["state"] == "stopped"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "found no lines"),
        (b"u,y\n1,2\n3\n", "the file"),
        (b"u,y\n1,two\n", "two"),
        (b"\x00\xff\xfe\x00 not a table", "the file"),
        (b"y\n1\n2\n", "found one column"),
        (b"<html><script>alert(1)</script></html>", "found one column"),
    ],
)
def test_bad_files_are_named(client: Any, content: bytes, message: str) -> None:
    answer = send(client, content)
    assert answer.status_code == 400
    assert message in answer.json["error"]
    assert "record1.csv" not in answer.json["error"]  # nothing of where it is kept


def test_large_files_are_refused(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = send(client, b"1,2\n" * (server.MOST_BYTES // 4 + 1))
    assert answer.status_code == 413
    assert "more than 16 MiB" in answer.json["error"]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"inputs": []}, "inputs: found []"),
        ({"inputs": ["nobody"]}, "nobody"),
        ({"outputs": "y"}, "outputs: found 'y'"),
        ({"inputs": [[1]]}, "expected names or numbers"),
        ({"Ts": 0}, "Ts: found 0"),
        ({"Ts": "soon"}, "Ts: found 'soon'"),
        ({"na": 1.5}, "na: found 1.5"),
        ({"na": 99}, "expected an integer from 0 to 20"),
        ({"nb": 0}, "nb"),
        ({"equation": 0}, "found no bound above 0"),
        ({"equation": -1}, "equation"),
        ({"samples": 10**9}, "samples: found"),
        ({"structure": "os.system"}, "structure: found"),
        ({"seconds": 0}, "seconds: found 0"),
        ({"record": "17"}, "record: found none"),
    ],
)
def test_wrong_fields_are_named(client: Any, fields: dict[str, Any], message: str) -> None:
    answer = start(client, **fields)
    assert answer.status_code == 400, answer.json
    assert message in answer.json["error"]


@pytest.mark.parametrize("field", ["Ts", "equation", "seconds"])
def test_integers_beyond_all_doubles_are_wrong_fields(client: Any, field: str) -> None:
    found = start(client, **{field: 10**400})
    assert found.status_code == 400 and found.json["error"].startswith(f"{field}: found 1000")


def test_a_job_that_is_stopped_before_it_begins_says_so(tmp_path: Path) -> None:
    future: Future[dict[str, Any]] = Future()
    assert future.cancel()
    job = server._Job(tmp_path, Processes(1), future)
    job.stop()
    assert job.state()["state"] == "stopped"


def test_other_hosts_and_sites_are_refused(client: Any) -> None:
    assert client.get("/", base_url="http://evil.example").status_code == 403
    assert client.get("/", base_url="http://localhost:8321").status_code == 200
    no_header = client.post("/records", data=RECORD, base_url="http://127.0.0.1")
    assert no_header.status_code == 403
    answer = client.get("/jobs/1/..%2f..%2frecord1.csv", base_url="http://127.0.0.1")
    assert answer.status_code == 404
    policy = client.get("/", base_url="http://127.0.0.1").headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy


def test_old_records_go(jobs: Jobs, tmp_path: Path) -> None:
    for _ in range(12):
        jobs.add_record(RECORD)
    assert len(list((tmp_path / "files").iterdir())) == 8


def test_the_command_serves_on_this_machine_alone() -> None:
    call = [sys.executable, "-m", "setid.cli", "serve", "--port", "0", "--no-browser"]
    process = subprocess.Popen(call, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("setid serves http://127.0.0.1:")
    finally:
        process.kill()
        process.communicate()
    assert main(["serve", "--port", "70000", "--no-browser"]) == 2


# ---- in a browser -------------------------------------------------------------------------------


@pytest.fixture
def page(jobs: Jobs, tmp_path: Path) -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api")
    from werkzeug.serving import make_server

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    web = make_server("127.0.0.1", 0, make_app(jobs), threaded=True)
    threading.Thread(target=web.serve_forever, daemon=True).start()
    with api.sync_playwright() as player:
        try:
            browser = player.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        except api.Error as error:
            pytest.skip(f"no browser: {error}")
        opened = browser.new_page(viewport={"width": 1100, "height": 900})
        opened.goto(f"http://127.0.0.1:{web.server_port}/")
        yield opened
        browser.close()
    web.shutdown()


@pytest.mark.slow
def test_in_a_browser(page: Any, tmp_path: Path) -> None:
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    bad, good = tmp_path / "bad.csv", tmp_path / "good.csv"
    bad.write_bytes(b"u,y\n1,<b>two</b>\n")
    good.write_bytes(RECORD)
    page.set_input_files("#file", bad)
    page.wait_for_selector("#error:not([hidden])")
    assert "<b>two</b>" in page.text_content("#error")
    assert page.is_hidden("#form")
    page.set_input_files("#file", good)
    page.wait_for_selector("#form:not([hidden])")
    assert page.is_hidden("#error")
    page.click("#go")  # no noise bound yet
    page.wait_for_selector("#error:not([hidden])")
    assert "found no bound above 0" in page.text_content("#error")
    page.fill("#equation", "0.5")
    page.click("#go")
    page.wait_for_selector("#downloads a", timeout=60_000)
    assert page.text_content("#state").startswith("certified")
    assert "1.91666" in page.text_content("#report")
    assert page.locator("#report svg").count() >= 2
    with page.expect_download() as download:
        page.click("#downloads a:has-text('result.json')")
    text = Path(download.value.path()).read_text(encoding="utf-8")
    assert json.loads(text)["format"] == "setid"
    assert errors == []


@pytest.mark.slow
def test_stop_in_a_browser(page: Any) -> None:
    page.set_input_files("#file", ROOT / "examples/data/hairdryer.csv")
    page.wait_for_selector("#form:not([hidden])")
    for field, value in {"na": "3", "nb": "3", "output": "0.3", "input": "0.1"}.items():
        page.fill(f"#{field}", value)
    page.click("#go")
    page.wait_for_selector("#stop:not([hidden])")
    page.click("#stop")
    page.wait_for_selector("#state:has-text('stopped')")
    assert page.is_hidden("#stop")
