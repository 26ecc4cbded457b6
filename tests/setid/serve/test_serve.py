"""The page of ``setid serve``, through its HTTP interface and in a browser."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import pytest
from slow_values import slow_after

pytest.importorskip("flask")

import setid
from setid.cli import main
from setid.serve import server
from setid.serve import work as work_module
from setid.serve.server import Jobs, make_app
from setid.serve.work import Form, _Report, _samples, read_form
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
    asked = ["What was asked", "Do the noise bounds explain the record?", "Intervals"]
    assert titles[:3] == asked
    assert "1.91666" in done["sections"][2]["html"]
    assert sum(part["html"].startswith("<svg") for part in done["sections"]) >= 2
    assert done["files"] == ["report.txt", "result.json", "certificate.json", "record.csv"]
    files = {
        name: client.get(f"/jobs/{job}/{name}", base_url="http://127.0.0.1")
        for name in done["files"]
    }
    result = setid.Identification.from_json(files["result.json"].text)  # verifies it
    assert result.intervals["b0"].outer[0] <= 23 / 12 <= result.intervals["b0"].outer[0] + 1e-9
    assert files["certificate.json"].json["is"] == "identification"
    assert "attachment" in files["report.txt"].headers["Content-Disposition"]


@pytest.mark.slow
def test_a_table_with_decimal_commas_says_the_same(client: Any) -> None:
    commas, local = RECORD.replace(b",", b";").replace(b".", b","), "http://127.0.0.1"
    sent = client.post("/records?decimal=,", data=commas, headers=CHANGE, base_url=local).json
    assert (sent["columns"], sent["samples"]) == (["u", "y"], 4)
    given = {**FORM, "record": sent["record"]}
    job = client.post("/jobs", json=given, headers=CHANGE, base_url=local).json["job"]
    assert "1.91666" in ended(client, job)["sections"][2]["html"]
    wrong = client.post("/records?decimal=%3B", data=RECORD, headers=CHANGE, base_url=local)
    assert wrong.status_code == 400 and wrong.json["error"].startswith("decimal: found ';'")


@pytest.mark.slow
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


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Any, Path]]:
    """What is said of three of four samples, and a folder with its files."""
    jobs, folder = Jobs(tmp_path_factory.mktemp("jobs")), tmp_path_factory.mktemp("part")
    client = make_app(jobs).test_client()
    given = {"file": "<b>mine</b>.csv", "Ts": 0.1, "equation": 1e308}  # huge bounds have files, too
    job = start(client, samples=3, **given).json["job"]
    done = ended(client, job)
    for file in done.get("files", []):
        content = client.get(f"/jobs/{job}/{file}", base_url="http://127.0.0.1").data
        (folder / file).write_bytes(content)
    yield done, folder
    jobs.close()


def test_page_and_report_say_what_the_intervals_are_about(part: tuple[Any, Path]) -> None:
    """Of a part of the file, whose samples come along: they are what files are checked against."""
    done, folder = part
    assert done["state"] == "done", done
    section = done["sections"][0]["html"]
    assert "3 of 4, every 0.1" in section and "equation 1e+308, output 0.0, input 0.0" in section
    assert "&lt;b&gt;mine&lt;/b&gt;.csv" in section and "<b>" not in section
    assert "samples: 3 of 4, every 0.1\n" in (folder / "report.txt").read_text()
    assert (folder / "record.csv").read_text() == "u,y\n4.0,0.0\n-3.0,-6.25\n2.0,1.175\n"


def test_files_are_proved_again_against_the_samples_that_come_along(
    part: tuple[Any, Path],
) -> None:
    record, *files = (
        str(part[1] / name) for name in ("record.csv", "result.json", "certificate.json")
    )
    assert [main(["verify", "--record", record, file]) for file in files] == [0, 0]
    check = [sys.executable, str(ROOT / "checker/check.py"), "--record", record, files[1]]
    assert subprocess.run(check, check=False).returncode == 0


def test_missing_samples_stay_missing_in_the_samples_that_come_along() -> None:
    data = setid.IOData([4.0, -3.0, 0.1], [0.0, float("nan"), 1.175])
    assert _samples(data) == "u1,y1\n4.0,0.0\n-3.0,\n0.1,1.175\n"


def test_files_of_a_job_that_is_stopped_are_listed(jobs: Jobs, tmp_path: Path) -> None:
    """They are there from the moment on that they are written."""
    form = read_form_of(tmp_path)
    report = _Report(tmp_path, 2)
    report.file("report.txt", form.model.__repr__)
    report.stage("pictures")
    stored = json.loads((tmp_path / "progress.json").read_text())
    assert stored["files"] == ["report.txt"]


def test_names_of_files_are_no_lines_of_their_own(tmp_path: Path) -> None:
    asked = dict(read_form_of(tmp_path, file="mine\nproved: everything").asked())
    assert asked["file"] == repr("mine\nproved: everything")


def read_form_of(folder: Path, **fields: Any) -> Form:
    path = folder / "sent.csv"
    path.write_bytes(RECORD)
    return read_form(path, {**FORM, **fields})


def test_the_time_limit_is_shared_by_all_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bands and validation took 20 s each whatever the limit was."""
    (tmp_path / "r.csv").write_bytes(RECORD)
    form = read_form(tmp_path / "r.csv", {**FORM, "samples": 3, "seconds": 8})
    given: dict[str, float] = {}
    result = setid.identify(form.record, form.model, form.noise)
    monkeypatch.setattr(work_module.time, "monotonic", lambda: 100.0)  # no time goes by

    def identified(*arguments: Any, **named: Any) -> Any:
        given["intervals"] = arguments[4].time_limit
        return result

    def banded(name: str) -> Any:
        def band(self: Any, *arguments: Any, time_limit: float) -> Any:
            given[name] = time_limit
            raise ValueError("no picture")

        return band

    monkeypatch.setattr(work_module, "identify", identified)
    for name in ("bode", "compare"):
        monkeypatch.setattr(setid.Identification, name, banded(name))
    work_module.work(form, str(tmp_path))
    assert given == {"intervals": 6.0, "bode": 4.0, "compare": 0.9 * 8}
    assert work_module._share(99.0, 0.5) == 1.0 and work_module._share(3700.0, 0.5, 20.0) == 20.0


def test_what_cannot_be_written_is_said_and_the_rest_is_kept(tmp_path: Path) -> None:
    report = _Report(tmp_path, 2)

    def fails() -> str:
        raise OverflowError("math range error")

    report.file("report.txt", fails)
    report.file("result.json", lambda: "{}")
    assert report.files == ["result.json"]
    assert report.sections == [{"title": "report.txt", "html": "<p>math range error</p>"}]


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


def test_tables_of_too_many_columns_are_refused_before_their_numbers_are_read(client: Any) -> None:
    """Eight million columns took half a minute and an answer of 67 MB."""
    assert len(send(client, b",".join([b"1"] * 1000) + b"\n").json["columns"]) == 1000
    answer = send(client, b",".join([b"1"] * 1001) + b"\nno number\n")
    assert answer.status_code == 400
    assert "found 1001 columns" in answer.json["error"] and "at most 1000" in answer.json["error"]


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
        ({"equation": -1}, "equation: found -1, expected a finite noise bound >= 0"),
        ({"output": -(10**400)}, "output: found -1"),
        ({"input": None}, "input: found None, expected a finite noise bound >= 0"),
        ({"equation": "1"}, "equation: found '1', expected a finite noise bound >= 0"),
        ({"offset": "true"}, "offset: found 'true', expected true or false"),
        ({"stable": 1}, "stable: found 1, expected true or false"),
        ({"structure": "PolynomialNARX", "nk": 2}, "nk: found 2, expected 0"),
        ({"structure": "PolynomialNARX", "nb": 0}, "nb: found 0, expected at least 1"),
        ({"structure": "PolynomialNARX", "stable": True}, "stable: found true, expected false"),
        (
            {"structure": "PolynomialNARX", "na": 5, "nb": 4},  # C(11 + 4, 4) monomials
            "order 5 and degree 4, which make 1365 parameters, expected at most 300",
        ),
        ({"structure": "PolynomialNARX", "na": 20, "nb": 20}, "expected at most 300"),
        ({"structure": "ContinuousTransferFunction", "offset": True}, "offset: found True"),
        ({"structure": "ContinuousTransferFunction", "nk": 1}, "nk: found 1, expected 0"),
        ({"structure": "ContinuousTransferFunction", "nb": 0}, "nb: found 0, expected at least 1"),
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


def test_seconds_of_a_job_end_with_it_whenever_they_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([100.0, 103.5, 160.0, 170.0])
    monkeypatch.setattr(server.time, "monotonic", lambda: next(clock))
    future: Future[dict[str, Any]] = Future()
    job = server._Job(tmp_path, Processes(1), future, begin=server.time.monotonic())
    future.set_result({"status": "certified"})
    assert job.state()["seconds"] == 3.5


def test_clients_that_fall_silent_are_given_up(jobs: Jobs, monkeypatch: pytest.MonkeyPatch) -> None:
    from werkzeug.serving import make_server

    monkeypatch.setattr(server, "SILENCE", 0.1)
    web = make_server("127.0.0.1", 0, make_app(jobs), True, request_handler=server._handler())
    threading.Thread(target=web.serve_forever, daemon=True).start()
    head = b"POST /records HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Setid: page\r\n"
    try:
        for half, answer in (
            (b"POST /rec", b""),
            (head + b"Content-Length: 99\r\n\r\nu,y", b"400"),
        ):
            with socket.create_connection(("127.0.0.1", web.server_port), timeout=30) as client:
                client.sendall(half)
                said = b"".join(iter(lambda c=client: c.recv(4096), b""))  # until it is closed
            assert answer in said.partition(b"\r\n")[0]
    finally:
        web.shutdown()
        web.server_close()


@pytest.mark.parametrize("body", ["[" * 100_000, '{"a":' * 5000 + "1" + "}" * 5000, "[1]", ""])
def test_bodies_that_are_no_form_are_wrong_input(client: Any, body: str) -> None:
    headers = {**CHANGE, "Content-Type": "application/json"}
    found = client.post("/jobs", data=body, headers=headers, base_url="http://127.0.0.1")
    assert found.status_code == 400
    assert found.json["error"] == "request: expected a JSON object"


def test_a_table_without_a_length_is_refused(client: Any) -> None:
    """Of a body in chunks the rest beyond the limit would be left out without a word."""
    found = client.post(
        "/records",
        input_stream=io.BytesIO(RECORD),
        headers={**CHANGE, "Transfer-Encoding": "chunked"},
        base_url="http://127.0.0.1",
    )
    assert found.status_code == 411
    assert found.json["error"].startswith("record: found no Content-Length")


def test_long_records_are_refused_where_they_are_sent(client: Any) -> None:
    found = send(client, b"u,y\n" + b"1,2\n2,1\n1,1\n" * 6_667)
    assert found.json["error"] == "record: found 20001 samples, expected at most 20000"


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_files_of_many_lines_are_refused_before_they_are_read(
    end: bytes, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "column_names", lambda *_: pytest.fail("the file was read"))
    found = send(client, b"u,y" + end + (b"1,2" + end) * 30_000)
    assert found.status_code == 400
    assert found.json["error"] == "record: found 30001 lines, expected at most 20000 samples"


def test_comments_and_line_ends_of_two_characters_are_no_samples(client: Any) -> None:
    head = b"# a comment\r\n" * 500 + b"u,y\r\n"
    assert send(client, head + b"1,2\r\n2,1\r\n" * 10_000).json["samples"] == 20_000


def test_files_are_deleted_when_a_signal_comes_before_the_server(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    seen = []

    def interrupted(folder: Path) -> None:
        seen.append(folder.is_dir())
        raise KeyboardInterrupt

    monkeypatch.setattr(server, "Jobs", interrupted)
    server.serve(0)
    assert seen == [True] and not list(tmp_path.iterdir())


def test_defects_of_the_server_are_said_and_logged(
    client: Any, jobs: Jobs, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(jobs, "job", lambda name: 1 / 0)
    found = client.get("/jobs/1", base_url="http://127.0.0.1")
    assert found.status_code == 500 and "please report" in found.json["error"]
    assert "ZeroDivisionError" in capsys.readouterr().err
    assert client.put("/", headers=CHANGE, base_url="http://127.0.0.1").json["error"]


SERVED = """
import signal, sys
from setid.cli import main
for name in {reset}:  # whatever this process inherits
    signal.signal(getattr(signal, name), signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(main(["serve", "--port", "0", "--no-browser"]))
"""


POSIX = pytest.mark.skipif(
    sys.platform == "win32", reason="Windows ends a process without asking it, and has no SIGHUP"
)


@POSIX
@pytest.mark.parametrize("name", slow_after(1, ["SIGTERM", "SIGHUP"]))
def test_files_are_deleted_however_the_server_is_told_to_end(name: str, tmp_path: Path) -> None:
    call = [sys.executable, "-c", SERVED.format(reset=[name])]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    process = subprocess.Popen(call, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        process.stdout.readline()
        assert list(tmp_path.glob("setid-*"))
        process.send_signal(getattr(signal, name))
        process.communicate(timeout=60)
        assert not list(tmp_path.glob("setid-*"))
    finally:
        process.kill()


@POSIX
def test_signals_that_are_ignored_stay_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """As nohup asks: the server outlives its terminal."""

    def stops(address: str) -> None:
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGTERM) is signal.default_int_handler
        raise KeyboardInterrupt

    before = {n: signal.getsignal(n) for n in (signal.SIGHUP, signal.SIGTERM)}
    try:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        server.serve(0, stops)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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


@pytest.mark.slow
@pytest.mark.parametrize("header", ["u,u,u", '"a, b","c","y"', "u,v;w,y"])
def test_samples_with_odd_names_are_proved_again(
    client: Any, header: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Columns are chosen by their numbers where names are alike or hold separators."""
    names = header.encode()
    rows = [b"4,9,0", b"-3,8,-6.25", b"2,7,1.175", b"1,6,2.0875"]
    sent = send(client, b"\n".join([names, *rows]))
    if sent.status_code != 200:  # such a file is refused where it is sent
        assert sent.status_code == 400
        return
    given = {**FORM, "record": sent.json["record"], "inputs": [0], "outputs": [2]}
    started = client.post("/jobs", json=given, headers=CHANGE, base_url="http://127.0.0.1")
    job = started.json["job"]
    assert ended(client, job)["state"] == "done"
    for file in ("record.csv", "certificate.json"):
        content = client.get(f"/jobs/{job}/{file}", base_url="http://127.0.0.1").data
        (tmp_path / file).write_bytes(content)
    paths = [str(tmp_path / file) for file in ("record.csv", "certificate.json")]
    assert main(["verify", "--record", *paths]) == 0
    command = [sys.executable, str(ROOT / "checker" / "check.py"), "--record", *paths]
    assert subprocess.run(command, capture_output=True, check=False, timeout=60).returncode == 0
