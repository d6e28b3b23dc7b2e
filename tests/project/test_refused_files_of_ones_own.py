"""Files of one's own for the `vsmrc` command that are wrong, or not used: one sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from app.cli.status import STOPPED
from app.scenario import own_code
from tests.support.commands import Done
from tests.support.pages import ROOT

pytestmark = pytest.mark.slow  # processes of its own


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("raise BaseException('of no kind')", "line 1: BaseException: of no kind"),
        ("def __getattr__(name): raise ValueError(name)", "LAW, SURFACE and TRAJECTORY are missing"),
        (
            "class Dumb(Exception):\n    def __str__(self): raise ValueError\nraise Dumb",
            "line 3: Dumb",
        ),
        (
            """
from controllers.control_law import ControlLaw
from parameters import Parameter

LAW = ControlLaw("mine", "Mine", "", None, parameters=(Parameter("k", 10**400, 0, 1, "1", "gain"),))
""",
            "parameter k, value 1000",
        ),
    ],
)
def test_a_file_of_ones_own_that_breaks_is_refused_in_one_sentence(
    text: str, said: str, tmp_path: Path, here: Callable[..., Done]
) -> None:
    file = tmp_path / "a:b" / "mine.py"  # the folder's name, too: it parts the names of a search path
    file.parent.mkdir()
    file.write_text(text)
    done = here("run", "ur5-hybrid", "--use", str(file), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert done.stderr.startswith(f"vsmrc: --use {file}")
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_law_that_is_not_chosen_is_said(tmp_path: Path, here: Callable[..., Done]) -> None:
    asked = ("run", "planar3r-hybrid", "--use", "docs/examples/pid_gravity.py", "--duration", "0.01", "--out")
    done = here(*asked, str(tmp_path))
    assert done.returncode == 0
    assert "the law pid-gravity of --use is not used; --set controller.law=pid-gravity chooses it\n" in done.stderr
    assert "not used" not in here(*asked, str(tmp_path), "--set", "controller.law=pid-gravity").stderr


@pytest.mark.parametrize(
    ("states", "message"),
    [
        ("5", "states 5; allowed: a function of the number of coordinates"),
        ("lambda n: -1", "states gives -1 for 2 coordinates; allowed: a whole number, 0 to 1000"),
        ("lambda n: 1 / 0", "line 4: ZeroDivisionError: division by zero"),
    ],
)
def test_a_law_whose_state_has_no_length_is_refused(
    states: str, message: str, tmp_path: Path, here: Callable[..., Done]
) -> None:
    (law := tmp_path / "law.py").write_text(
        "from controllers.control_law import ControlLaw\n"
        "def torque(given, out, x, x_dot):\n    pass\n"
        f"LAW = ControlLaw('refused', 'Refused', 'None.', torque, states={states})\n"
    )
    done = here("run", "planar3r-hybrid", "--use", str(law), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert message in done.stderr
    assert str(law) in done.stderr


@pytest.mark.parametrize(
    ("arguments", "states", "message"),
    [
        (
            "given, out",
            "lambda n: 1",
            "torque(given, out) in a law with states; allowed: torque(given, out, x, x_dot), or torque(given, out) "
            "without states\n",
        ),
        (
            "given, out, x, x_dot",
            "None",
            "torque(given, out, x, x_dot) in a law with no states; allowed: torque(given, out), or torque(given, out, "
            "x, x_dot) with states\n",
        ),
    ],
)
@pytest.mark.parametrize("decorator", ["", "@inline\n"])
def test_a_law_with_other_arguments_than_it_gets_is_refused(
    decorator: str, arguments: str, states: str, message: str, tmp_path: Path, here: Callable[..., Done]
) -> None:
    (law := tmp_path / "law.py").write_text(
        "from controllers.control_law import ControlLaw\nfrom kernels import inline\n"
        f"{decorator}def torque({arguments}):\n    pass\n"
        f"LAW = ControlLaw('refused', 'Refused', 'None.', torque, states={states})\n"
    )
    done = here("run", "planar3r-hybrid", "--use", str(law), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert done.stderr == f"vsmrc: --use {law}: {message}"


def test_a_path_that_fails_in_the_run_ends_the_command_with_the_status_of_a_run_that_has_stopped(
    tmp_path: Path, here: Callable[..., Done]
) -> None:
    (path := tmp_path / "path.py").write_text(
        "from environments.trajectories.own import OwnTrajectory\nfrom kernels import inline\n"
        "@inline\ndef path(t, p, value, rate, acceleration):\n"
        "    if 0.052999 < t and t < 0.053001:\n        raise ValueError('late')\n"
        "TRAJECTORY = OwnTrajectory('late', 'Late', 'It fails.', path)\n"
    )
    for engine in ("pinocchio", "compiled"):
        out = tmp_path / engine
        done = here(
            *("run", "ur5-hybrid", "--use", str(path), "--engine", engine, "--out", str(out)),
            *("--set", "motion=own:late", "--duration", "0.1"),
        )
        assert done.returncode == STOPPED
        said = f"t = 0.053 s: a function of --use failed ({path}, line 6: ValueError: late)"
        assert said in done.stdout + done.stderr
        assert (out / "recording.npz").exists()


def test_a_file_that_was_changed_since_the_start_is_not_used_by_another_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "mine.py"
    file.write_text((ROOT / "docs" / "examples" / "pid_gravity.py").read_text())
    monkeypatch.setenv(own_code.VARIABLE, "[]")
    try:
        own_code.use([file])
        own_code.own_code.cache_clear()
        assert list(own_code.own_code().laws) == ["pid-gravity"]
        file.write_text(file.read_text().replace("5000.0", "6000.0"))
        own_code.own_code.cache_clear()
        with pytest.raises(own_code.OwnCodeError, match="the file has been changed since the start; allowed: start"):
            own_code.own_code()
    finally:
        own_code.own_code.cache_clear()
