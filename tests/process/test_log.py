"""The log: a line per event, for programs and people, whatever is in it and wherever it goes."""

from __future__ import annotations

import errno
import re
import subprocess
import sys
from pathlib import Path

import pytest
import structlog

from app.process import log, log_file

pytestmark = pytest.mark.slow  # processes of its own

PROGRAM = """
import logging, os, sys, threading, warnings
from pathlib import Path
import structlog
from app.process import launcher, log
log.configure({level!r}, Path(sys.argv[1]))
events = structlog.get_logger()
def failing():
    raise ValueError("first\\nsecond \\x1b[31m")
{body}
"""


def logged(file: Path, body: str, level: str | None = None) -> tuple[list[str], list[str]]:
    """The lines of file and terminal."""
    program = PROGRAM.format(level=level, body=body)
    done = subprocess.run(
        [sys.executable, "-c", program, str(file)], capture_output=True, text=True, timeout=60, check=True
    )
    return (file.read_text().splitlines() if file.is_file() else []), done.stderr.splitlines()


def test_an_event_is_one_line_whatever_is_in_it(tmp_path: Path) -> None:
    (line,), terminal = logged(
        tmp_path / "log", r'events.info("refused", sentence="a\n\"b\" \x1b[2J\x07\x9b \u202e ‖s‖", n=3, none=None)'
    )
    assert re.match(r"time=20\d\d-\d\d-\d\dT[\d:.]+Z level=info event=refused sentence=", line)
    assert r'sentence="a\n\"b\" \\x1b[2J\\x07\\x9b \\u202e ‖s‖" n=3 none=' in line
    assert line.isprintable()
    assert terminal == []  # which shows warnings


def test_tracebacks_are_for_the_file_and_those_of_libraries_for_debugging(tmp_path: Path) -> None:
    body = """
try:
    failing()
except ValueError:
    events.error("fault", stage="the plant", exc_info=True)
    logging.getLogger("websockets.server").exception("connection handler failed")
warnings.warn("old")
thread = threading.Thread(target=failing, name="worker")
thread.start(); thread.join()
"""
    for level in (None, "debug"):
        file, terminal = logged(tmp_path / f"log-{level}", body, level)
        fault, library, warning, thread = file
        assert r'error="ValueError: first\nsecond \\x1b[31m" traceback="Traceback (most' in fault
        assert ("traceback=" in library) == (level == "debug")
        assert "UserWarning: old" in warning
        assert 'event="thread failed" thread=worker' in thread
        assert "traceback=" in thread
        assert [line.partition(" event=")[2].split()[0] for line in terminal] == ["fault", '"thread']
        assert not any("traceback" in line.lower() for line in terminal)


def test_a_flood_is_cut_and_counted(tmp_path: Path) -> None:
    body = """
import time
for i in range(5000):
    events.info("refused", i=i)
events.info("client left")
first = int(time.time())
while int(time.time()) == first:
    time.sleep(0.01)
events.info("refused", i="last")
"""
    file, _ = logged(tmp_path / "log", body)
    assert len(file) < 1000  # twenty of a kind in a second
    assert any("client left" in line for line in file)  # which it does not hide
    assert re.search(r"i=last by=__main__ process=\d+ left_out=\d+$", file[-1])


def test_a_disk_that_is_full_is_said_once_and_survived() -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    _, terminal = logged(Path("/dev/full"), 'events.info("one")\nevents.info("two")\nevents.warning("three")')
    refusal, three = terminal
    assert refusal == "vsmrc: the log cannot be written: No space left on device; going on"
    assert "event=three" in three


def test_processes_beside_this_one_log_to_the_same_file(tmp_path: Path) -> None:
    inner = (
        "import structlog; from app.process import log; log.configure_as_parent(); structlog.get_logger().info('inner')"
    )
    body = f'import subprocess\nsubprocess.run([sys.executable, "-c", {inner!r}], check=True)\nevents.info("outer")'
    file, _ = logged(tmp_path / "log", body)
    assert [line.partition(" event=")[2].split()[0] for line in file] == ["inner", "outer"]


def test_a_log_file_that_cannot_be_opened_is_refused_in_a_sentence(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "app", "serve", "--port", "0", "--log-file", str(tmp_path / "none" / "log")],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert (
        done.stderr == f"vsmrc: --log-file {tmp_path / 'none' / 'log'}: cannot be written: No such file or directory\n"
    )


def test_a_value_has_no_end_but_a_line_has(tmp_path: Path) -> None:
    body = """
events.info("refused", reason="x" * 5_000_000 + "end")
logging.getLogger("library").warning("y" * 5_000_000)
try:
    raise ValueError("z" * 5_000_000)
except ValueError:
    events.error("fault", exc_info=True)
"""
    file, terminal = logged(tmp_path / "log", body)
    assert len(file) == 3
    assert max(map(len, file + terminal)) < 25_000
    assert " … xxx" in file[0]
    assert 'xxxend" by=' in file[0]
    assert "Traceback (most recent call last)" in file[2]


def test_a_library_that_never_says_the_same_is_cut_as_well(tmp_path: Path) -> None:
    file, _ = logged(
        tmp_path / "log", "for i in range(5000): logging.getLogger('aiohttp.server').warning(f'bad request {i}')"
    )
    assert 20 <= len(file) < 1000


def test_a_file_that_is_full_gets_a_number_whoever_of_its_writers_finds_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_file, "LARGEST", 1000)
    path = tmp_path / "log"
    writers = [log_file.LogFile(path), log_file.LogFile(path)]
    lines = [f"line {number:04d}\n" for number in range(1000)]
    for number, line in enumerate(lines):
        writers[number % 3 == 0].write(line)
    files = [tmp_path / "log.3", tmp_path / "log.2", tmp_path / "log.1", path]
    assert set(tmp_path.iterdir()) == set(files)
    assert all(file.stat().st_size <= 1000 and file.stat().st_mode & 0o777 == 0o600 for file in files)
    kept = "".join(file.read_text() for file in files)
    assert len(kept) > 3000
    assert "".join(lines).endswith(kept)
    path.rename(tmp_path / "moved by another program")
    writers[0].write("goes on\n")
    assert path.read_text() == "goes on\n"
    for writer in writers:
        writer.close()


def test_a_file_that_cannot_be_renamed_grows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(log_file, "LARGEST", 20)
    monkeypatch.setattr(Path, "replace", refused)
    file = log_file.LogFile(tmp_path / "lab.log")
    file.write("a line of the log\n")
    with pytest.raises(log_file.GrowingLog, match=r"lab.log cannot be renamed \(Permission denied\), so it grows"):
        file.write("the first one beyond its limit\n")
    file.write("another one\n")
    file.close()
    assert (tmp_path / "lab.log").read_text().splitlines() == [
        "a line of the log", "the first one beyond its limit", "another one",
    ]  # fmt: skip


@pytest.mark.faults
def test_a_fault_in_a_test_is_noted_after_a_command_has_configured_the_log(logged_faults: list[str]) -> None:
    log.configure_as_parent()  # as every command does that runs within this process
    try:
        raise ValueError("provoked")
    except ValueError as error:
        structlog.get_logger().info("fault", stage="a command", exc_info=error)
    (fault,) = logged_faults
    assert "a command" in fault
    assert "ValueError: provoked" in fault


def test_no_test_prints_into_an_output_that_another_thread_may_close() -> None:
    """As structlog's own `PrintLogger` does, see `tests/conftest.py`."""
    assert not isinstance(structlog.get_config()["logger_factory"](), structlog.PrintLogger)
