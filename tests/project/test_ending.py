"""How commands end: Ctrl-C at any instant, and processes that go on."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.waiting import until
from tests.support.commands import vsmrc

pytestmark = pytest.mark.slow  # processes of its own


def interrupted(pid: int) -> bool:
    """Whether a process has not received the last SIGINT yet; another one would be lost."""
    pending = re.search(r"^ShdPnd:\s*(\w+)", Path(f"/proc/{pid}/status").read_text(), re.MULTILINE)
    return pending is not None and bool(int(pending[1], 16) >> (signal.SIGINT - 1) & 1)


def test_serve_says_its_address_and_a_busy_port_and_ends_on_ctrl_c() -> None:
    command = [sys.executable, "-m", "app", "serve", "planar2r-semicircle", "--port", "0", "--stateless"]
    command += ["--token", "never"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        line = next(line for line in server.stdout if line.startswith("VSMRC Lab"))
        port = re.search(r"http://127\.0\.0\.1:(\d+)", line)
        assert port is not None
        second = vsmrc("serve", "--port", port[1])
        assert second.returncode == 2
        assert port[1] in second.stderr
        for _ in range(2):  # an impatient one
            server.send_signal(signal.SIGINT)
            until(lambda: server.poll() is not None or not interrupted(server.pid))
        _, complaints = server.communicate(timeout=120)
        assert server.returncode == 0
        assert "Traceback" not in complaints
    finally:
        server.kill()
        server.wait()


def test_ctrl_c_ends_a_server_that_a_script_has_begun_in_the_background() -> None:
    """A shell without job control hands SIGINT on ignored."""
    command = [sys.executable, "-m", "app", "serve", "planar2r-semicircle", "--port", "0", "--stateless"]
    ignoring = (
        "import os, signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); os.execv(sys.argv[1], sys.argv[1:])"
    )
    server = subprocess.Popen(
        [sys.executable, "-c", ignoring, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert server.stdout is not None
        assert next(line for line in server.stdout if line.startswith("VSMRC Lab"))
        server.send_signal(signal.SIGINT)
        server.communicate(timeout=60)
        assert server.returncode == 0
    finally:
        server.kill()
        server.wait()


@pytest.mark.parametrize("shared", [(), ("--shared",)])
def test_the_end_does_not_wait_for_the_interpreter_to_be_taken_down(shared: tuple[str, ...]) -> None:
    """Nor does it come from the deadline, which a busy machine may need: both are taken away here."""
    program = """
import atexit, sys, threading
import app.process.deadline
app.process.deadline.end_within = lambda *_: None
threading.Thread(target=threading.Event().wait).start()  # an interpreter waits for it for ever
atexit.register(lambda: print("what was registered"))
from app.__main__ import main
main()
"""
    arguments = ["serve", "planar2r-semicircle", "--port", "0", "--stateless", "--token", "never", *shared]
    server = subprocess.Popen([sys.executable, "-c", program, *arguments], stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        assert next(line for line in server.stdout if line.startswith("VSMRC Lab"))
        server.send_signal(signal.SIGINT)
        output, _ = server.communicate(timeout=60)
        assert server.returncode == 0
        assert "ended" in output
        assert output.splitlines()[-1] == "what was registered"
    finally:
        server.kill()
        server.wait()


def test_ctrl_c_is_not_lost_where_python_swallows_what_it_raises() -> None:
    program = """
import signal
import app.process.precompile
from app.__main__ import main

class Finalized:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

def start():
    Finalized()

app.process.precompile.start = start
main()
"""
    arguments = ["serve", "planar2r-semicircle", "--port", "0", "--stateless", "--token", "never"]
    ended = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False, timeout=120
    )
    assert "Exception ignored in" in ended.stderr
    assert ended.returncode == 0
    assert "ended" in ended.stdout.splitlines()


def test_ctrl_c_before_the_command_is_loaded_is_no_traceback() -> None:
    interrupted = """
import sys

class Finder:
    def find_spec(self, name, *_):
        if name == "msgspec":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Finder())
from app.__main__ import main
main()
"""
    done = subprocess.run([sys.executable, "-c", interrupted], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_two_interruptions_end_a_pool_whose_processes_go_on(tmp_path: Path) -> None:
    program = """
import signal, time
from concurrent.futures import ProcessPoolExecutor
from app.process import worker_pool

end = ProcessPoolExecutor.shutdown

def compute(seconds):
    print("begun", seconds, flush=True)
    time.sleep(seconds)

def computing():
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a kernel that is under way, which sees no signal
    return compute

def shutdown(pool, **how):
    print("ending", flush=True)
    end(pool, **how)

def execute(_):
    ProcessPoolExecutor.shutdown = shutdown
    for _ in worker_pool.results(computing, (), [0, 600], 1):
        pass
    return 0

if __name__ == "__main__":
    import app.cli.commands
    from app.__main__ import main
    app.cli.commands.execute = execute
    main()
"""
    file = tmp_path / "pool.py"  # which its processes import, too
    file.write_text(program)
    with subprocess.Popen([sys.executable, file], stdout=subprocess.PIPE, text=True) as pool:
        assert pool.stdout is not None
        assert [pool.stdout.readline() for _ in range(2)] == ["begun 0\n", "begun 600\n"]
        pool.send_signal(signal.SIGINT)
        assert pool.stdout.readline() == "ending\n"  # on a busy machine two at once would be one
        pool.send_signal(signal.SIGINT)
        try:
            assert pool.wait(timeout=60) == 130
        finally:
            pool.kill()
