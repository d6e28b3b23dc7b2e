"""Control laws of a user's own: files named by `--use`, in plain numpy or compiled."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from app.cli.commands import execute
from app.scenario.caption import caption
from app.scenario.data import edited, from_toml, load, to_toml
from app.scenario.errors import ScenarioError
from app.scenario.own_code import OwnCodeError, use
from app.scenario.schema import Scenario
from app.session.headless_run import simulate
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.sampled_loop.sampled_stability import sampled_loop
from controllers.premises import Premise

pytestmark = pytest.mark.slow  # it compiles what is of no use to another process

PID = Path(__file__).parents[2] / "docs" / "examples" / "pid_gravity.py"
HEAD = "from controllers.control_law import ControlLaw, Parameter\nfrom kernels import allocating, inline\n\n"
LAW = 'LAW = ControlLaw(kind="mine", title="mine", about="mine", torque=torque, told=("gravity", "rates"){})\n'
NUMPY = """def torque(given, out):
    model, J_q = given.gains.model, given.task.J_q
    out.terms.linear[:] = -J_q.T @ (model.K_m @ out.e_r + model.B_m @ out.e_r_dot)
    out.terms.force[:] = J_q.T @ given.reference.F_cd
    out.terms.gravity[:] = given.feedforward.G_hat

"""
COMPILED = """@inline
def torque(given, out):
    model, J_q = given.gains.model, given.task.J_q
    for j in range(out.tau.shape[0]):
        for i in range(out.tau.shape[0]):
            pulled = 0.0
            for k in range(out.tau.shape[0]):
                pulled += model.K_m[i, k] * out.e_r[k] + model.B_m[i, k] * out.e_r_dot[k]
            out.terms.linear[j] -= J_q[i, j] * pulled
            out.terms.force[j] += J_q[i, j] * given.reference.F_cd[i]
        out.terms.gravity[j] = given.feedforward.G_hat[j]

"""


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "my_law.py"
        path.write_text(text)
        return path

    return write


def under(law: str, **changes: object) -> Scenario:
    scenario = edited(load("ur5-hybrid"), "controller.law", law)
    for path, value in changes.items():
        scenario = edited(scenario, path.replace("__", "."), value)
    return scenario


@pytest.mark.parametrize(
    "torque", [NUMPY, COMPILED, "@allocating\n" + NUMPY.lstrip()], ids=["numpy", "compiled", "compiled with new arrays"]
)
def test_a_law_of_one_s_own_gives_the_run_of_the_same_law_of_ours(torque: str, written: Callable[[str], Path]) -> None:
    use([written(HEAD + torque + LAW.format(""))])
    mine, ours = ClosedLoop.from_scenario(under("mine")), ClosedLoop.from_scenario(under("pd-gravity"))
    for _ in range(200):
        mine.step()
        ours.step()
    np.testing.assert_allclose(mine.recording.rows(), ours.recording.rows(), rtol=1e-9, atol=1e-9)
    growths = [sampled_loop(loop.system, loop.system.q_0, 0.0).premises[Premise.SAMPLED_LOOP] for loop in (mine, ours)]
    assert growths[0] == pytest.approx(growths[1], abs=1e-7)
    assert mine.standing.run.verdict == "nothing promised"


def test_the_integral_of_the_example_takes_away_what_weight_leaves() -> None:
    """A heavy arm at rest: PD sinks by the missing weight over K_m, PID does not."""
    use([PID])
    heavy = {"truth.link_scaling": 1.15, "motion": "hold", "simulation.duration": 5.0, "contact.kind": "free"}
    left = {}
    for law in ("pd-gravity", "pid-gravity"):
        scenario = edited(load("ur5-impedance"), "controller.law", law)
        for path, value in heavy.items():
            scenario = edited(scenario, path, value)
        loop, metrics = simulate(scenario)
        assert loop.stopped is None
        left[law] = metrics.motion_error_tail
    assert left["pd-gravity"] > 1e-3
    assert left["pid-gravity"] < 0.01 * left["pd-gravity"]
    assert loop.state.x.shape == (6,)


def test_its_own_state_is_kept_forked_and_begun_anew() -> None:
    use([PID])
    loop = ClosedLoop.from_scenario(under("pid-gravity"))
    for _ in range(100):
        loop.step()
    kept = loop.state.copy()
    for _ in range(50):
        loop.step()
    assert (loop.state.x != kept.x).any()
    again = ClosedLoop.from_state(kept, previous=loop.system)
    for _ in range(50):
        again.step()
    np.testing.assert_array_equal(again.state.x, loop.state.x)
    np.testing.assert_array_equal(again.recording.rows(), loop.recording.rows()[100:])

    loop.edit(edited(loop.system.scenario, "controller.own.pid-gravity.k_i", 100.0))
    assert (loop.state.x == again.state.x).all()  # a parameter is no new law
    loop.edit(edited(loop.system.scenario, "controller.law", "vsmrc"))
    loop.step()
    assert loop.state.x.shape == (0,)
    loop.edit(edited(loop.system.scenario, "controller.law", "pid-gravity"))
    assert (loop.state.x == np.zeros(6)).all()


def test_its_parameters_are_said_by_the_scenario() -> None:
    use([PID])
    scenario = under("pid-gravity", **{"controller__own__pid-gravity__k_i": 123.0})
    assert from_toml(to_toml(scenario)) == scenario
    loop = ClosedLoop.from_scenario(scenario)
    assert loop.system.controller.parameters == {"k_i": 123.0}
    for change, message in (
        ({"k_i": -1.0}, "controller.own.pid-gravity.k_i: -1 N/(m·s); allowed: 0 to 50000 N/(m·s)"),
        ({"k_d": 1.0}, "controller.own.pid-gravity.k_d: no such parameter; allowed: k_i; did you mean k_i?"),
    ):
        for path, value in change.items():
            with pytest.raises(ScenarioError) as refused:
                loop.edit(edited(scenario, f"controller.own.pid-gravity.{path}", value))
            assert str(refused.value) == message
    for path, value, wrong in (
        (
            "controller.own.pid-gravity.k_i",
            "much",
            "controller.own.pid-gravity.k_i: 'much'; ",
        ),
        ("controller.own.pid-gravity", 3.0, "controller.own.pid-gravity: 3.0; allowed: a table"),
        ("controller.own", {"pid-gravity": 3.0}, "controller.own.pid-gravity: 3.0; allowed: a table"),
    ):
        with pytest.raises(ScenarioError) as refused:
            edited(scenario, path, value)
        assert wrong in str(refused.value)
    assert loop.system.controller.parameters == {"k_i": 123.0}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def torque(:\n", "my_law.py, line 1: SyntaxError: "),
        (HEAD + "nonsense\n", "my_law.py, line 4: NameError: name 'nonsense' is not defined"),
        (HEAD, "my_law.py: LAW, SURFACE and TRAJECTORY are missing; allowed: a Python file with LAW = ControlLaw"),
        (HEAD + "raise SystemExit(3)\n", "my_law.py, line 4: SystemExit: 3"),
        (HEAD + "open('/nowhere')\n", "my_law.py, line 4: FileNotFoundError: [Errno 2] No such file"),
        (HEAD + NUMPY + LAW.format(", robust=True"), "robust = True; allowed: False, Theorem 1 is about (25)"),
        (
            HEAD + NUMPY + LAW.replace('"rates")', '"rate")').format(""),
            "told ('gravity', 'rate'); allowed: a tuple of 'model'",
        ),
        (
            HEAD + NUMPY + LAW.format(", terms={'pull': 'K e'}"),
            "terms {'pull': 'K e'}; allowed: a name for one or more of",
        ),
        (HEAD + NUMPY + LAW.format(", terms={'linear': 3}"), "terms, linear 3; allowed: text"),
        (
            HEAD + NUMPY + LAW.format("").replace('title="mine"', 'title="PD + gravity"'),
            "title 'PD + gravity'",
        ),
        (HEAD + NUMPY + LAW.format("").replace('title="mine"', "title=None"), "title None; allowed: text"),
        (HEAD + NUMPY + LAW.format("").replace('"mine"', "3", 1), "my_law.py: kind 3; allowed: text"),
        (HEAD + NUMPY + LAW.format(", parameters=3"), "my_law.py: parameters 3; allowed: a tuple, (Parameter(...)"),
        (
            HEAD + NUMPY + LAW.format(', parameters=(Parameter("k", "1", 0.0, 1.0, "", ""),)'),
            "my_law.py: parameter k, value '1'; allowed: a finite number",
        ),
        (
            HEAD + NUMPY + LAW.format(', parameters=(Parameter("k", 0.5, 0.0, float("inf"), "", ""),)'),
            "my_law.py: parameter k, high inf; allowed: a finite number",
        ),
        (
            HEAD + NUMPY + LAW.format(', parameters=(Parameter("k", 0.5, 0.0, 1.0, None, ""),)'),
            "my_law.py: parameter k, unit None; allowed: text",
        ),
        (
            HEAD + NUMPY + LAW.format(', parameters=2 * (Parameter("k", 0.5, 0.0, 1.0, "", ""),)'),
            "my_law.py: parameter 'k' stands there more than once; allowed: one of each name",
        ),
        (HEAD + "LAW = 3\n", "my_law.py: LAW is 3; allowed: a Python file with LAW = ControlLaw(...)"),
        (HEAD + NUMPY + LAW.format("").replace('"mine"', '"vsmrc"', 1), "kind 'vsmrc'; allowed: lower-case words"),
        (HEAD + NUMPY + LAW.format("").replace('"mine"', '"<b>"', 1), "kind '<b>'; allowed: lower-case words"),
        (
            HEAD + NUMPY + LAW.format(', parameters=(Parameter("k", 3.0, 0.0, 1.0, "", ""),)'),
            "my_law.py: k = 3; allowed: 0 to 1",
        ),
        (
            HEAD + NUMPY + LAW.format(', parameters=(Parameter("k b", 1.0, 0.0, 1.0, "", ""),)'),
            "my_law.py: parameter 'k b'; allowed: letters",
        ),
    ],
)
def test_a_file_that_fails_is_said_in_one_sentence_with_its_line(
    text: str, message: str, written: Callable[[str], Path], capfd: pytest.CaptureFixture[str]
) -> None:
    path = written(text)
    assert execute(["run", "ur5-hybrid", "--use", str(path), "--out", str(path.parent / "out")]) == 2
    printed = capfd.readouterr().err
    assert message in printed
    assert printed.count("\n") == 1
    assert not (path.parent / "out").exists()


def test_a_file_that_is_none_is_said(tmp_path: Path) -> None:
    with pytest.raises(OwnCodeError, match=r"nowhere\.py: no Python file; allowed: a Python file with LAW"):
        use([tmp_path / "nowhere.py"])
    with pytest.raises(OwnCodeError, match="no Python file; allowed"):
        use([tmp_path])


@pytest.mark.parametrize(
    ("torque", "message"),
    [
        (
            "def torque(given, out):\n    out.terms.gravity[:] = given.q[:2]\n",
            "line 5: ValueError: could not broadcast",
        ),
        ("def torque(given, out):\n    out.nothing = 1.0\n", "line 5: AttributeError: no field 'nothing'; there are"),
        (
            "def torque(given, out):\n    J_q = given.task.J_q\n    J_q *= 2.0\n",
            "line 6: ValueError: output array is read-only",
        ),
        (
            "def torque(given, out):\n    given.gains.K_s[0, 0] = 1.0\n",
            "line 5: ValueError: assignment destination is read-only",
        ),
        ("def torque(given):\n    pass\n", "TypeError: torque() takes 1 positional argument but 2 were given"),
        (
            "@inline\ndef torque(given, out):\n    out.d = given.nothing\n",
            "line 6: TypingError: Unknown attribute 'nothing'",
        ),
        (
            "@inline\ndef torque(given, out):\n    out.terms.linear[:] = given.task.J_q.T @ out.e_r\n",
            "my_law.py, line 6: a slice, a new array, list or text; allowed: with kernels.allocating in place of "
            "kernels.inline",
        ),
        (
            "@inline\ndef torque(given, out):\n    out.terms.gravity[:] = given.feedforward.G_hat\n",
            "my_law.py, line 6: a slice, a new array, list or text; allowed: with kernels.allocating",
        ),
        (
            "@inline\ndef torque(given, out):\n    out.terms.inertia[out.tau.shape[0]] = 7.0\n",
            "my_law.py, line 6: IndexError: index is out of bounds",
        ),
        (
            "@allocating\ndef torque(given, out):\n    out.terms.linear[:] = given.q[:2]\n",
            "my_law.py, line 6: ValueError: cannot assign slice",
        ),
        (
            "@allocating\ndef torque(given, out):\n    foo(3)\n",
            "my_law.py, line 6: TypingError: NameError: name 'foo' is not defined",
        ),
        (
            "@inline\ndef double(x, out):\n    out[:] = 2.0 * x\n\n\n"
            "@inline\ndef torque(given, out):\n    double(out.e_r, out.terms.linear)\n",
            "my_law.py, line 6: a slice, a new array, list or text; allowed: with kernels.allocating",
        ),
    ],
    ids=[
        "shape",
        "field",
        "input",
        "gain",
        "arguments",
        "compiled",
        "product",
        "slice",
        "beyond",
        "compiled shape",
        "name",
        "in a part",
    ],
)
def test_a_law_that_cannot_answer_is_refused_and_what_runs_goes_on(
    torque: str, message: str, written: Callable[[str], Path]
) -> None:
    use([written(HEAD + torque + LAW.format(""))])
    loop = ClosedLoop.from_scenario(load("ur5-hybrid"))
    loop.step()
    with pytest.raises(ScenarioError) as refused:
        loop.edit(under("mine"))
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    loop.step()
    assert loop.system.controller.law.kind == "vsmrc"
    assert loop.stopped is None


def test_a_law_that_fails_later_stops_the_run_and_keeps_its_recording(written: Callable[[str], Path]) -> None:
    late = "def torque(given, out, x, x_dot):\n    x_dot[0] = 1.0\n    out.d = 1.0 / float(x[0] < 0.05)\n"
    use([written(HEAD + late + LAW.format(", states=lambda n: 1"))])
    loop = ClosedLoop.from_scenario(under("mine", declared__link_scaling=0.0))
    while loop.stopped is None and loop.t < 1.0:
        loop.advance()
    assert loop.stopped is not None
    assert "the control law failed" in loop.stopped
    assert "my_law.py, line 6: ZeroDivisionError: float division by zero" in loop.stopped
    assert len(loop.recording.rows()) == round(loop.t / loop.period) == pytest.approx(50, abs=1)
    assert np.isfinite(loop.view().q).all()


def test_laws_are_known_by_the_command_line_only(tmp_path: Path, written: Callable[[str], Path]) -> None:
    path = written(HEAD + NUMPY + LAW.format(""))
    for law in ("mine", str(path)):
        with pytest.raises(ScenarioError, match=r"controller\.law: .*allowed: vsmrc, computed-torque, pd-gravity \(or"):
            ClosedLoop.from_scenario(under(law))
    assert execute(["run", "ur5-hybrid", "--set", "controller.law=mine", "--out", str(tmp_path / "out")]) == 2


def test_every_command_takes_the_file(tmp_path: Path) -> None:
    own = ["--use", str(PID), "--set", "controller.law=pid-gravity", "simulation.duration=0.1"]
    assert execute(["run", "ur5-hybrid", *own, "controller.own.pid-gravity.k_i=200", "--out", str(tmp_path)]) == 0
    assert "k_i = 200" in (tmp_path / "scenario.toml").read_text()
    assert json.loads((tmp_path / "metrics.json").read_text())["promise"]["verdict"] == "nothing promised"
    assert execute(["compare", "ur5-hybrid", "ur5-impedance", *own]) == 0
    assert execute(["export", "ur5-hybrid", "--to", "svg", "--plots", "Torque", "--out", str(tmp_path), *own]) == 0
    assert list(tmp_path.glob("*.svg"))


def test_the_caption_says_which_law_it_was() -> None:
    use([PID])
    system = assemble(under("pid-gravity"))
    matrices = {name: np.eye(6) for name in ("M_m", "B_m", "K_m", "K_f")}
    text = caption(system.scenario, system.controller, matrices, system.units, 0.0, 1.0)
    assert "PID + gravity, k_i = 5000 N/(m·s), T = 1 ms." in text


def test_a_law_that_ends_the_program_is_said_with_its_line(written: Callable[[str], Path]) -> None:
    use([written(HEAD + "def torque(given, out):\n    raise SystemExit(7)\n\n\n" + LAW.format(""))])
    with pytest.raises(OwnCodeError, match=r"my_law\.py, line 5: SystemExit: 7"):
        ClosedLoop.from_scenario(under("mine"))
