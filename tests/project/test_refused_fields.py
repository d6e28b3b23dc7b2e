"""Wrong fields of a scenario, from the command line and from files: one sentence with the field and what is allowed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from app.scenario.data import edited, from_toml, load
from app.scenario.errors import ScenarioError
from app.scenario.schema import Scenario

pytestmark = pytest.mark.slow  # processes of its own


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("run", "ur5-hybrid", "--set", "force.vale=3"),
            "force.vale: no such field; allowed: kind, value; did you mean v",
        ),
        (("run", "ur5-hybrid", "--set", "robot.nmae=ur3"), "; did you mean name?"),
        (("run", "ur5-hybrid", "--set", "robot.name=pandas"), "; did you mean panda?"),
        (("run", "ur5-hybrid", "--set", "mode=hybrd"), "; did you mean hybrid?"),
        (("run", "ur5-hybrid", "--set", "contact.kind=elastc"), "; did you mean elastic?"),
        (("run", "ur5-hybrid", "--set", "controller.law=vsmcr"), "; did you mean vsmrc?"),
        (("run", "ur5-hybrid", "--set", "force.value"), "allowed: KEY=VALUE"),
        (("run", "ur5-hybrid", "--set", "force.value=nan"), "force.value: nan; allowed: a finite number"),
        (("run", "ur5-hybrid", "--set", "controller.layer=-1"), "controller.layer: -1; allowed: a number > 0"),
        (("run", "ur5-hybrid", "--set", "mode=constrained"), "contact.kind: 'elastic' in constrained mode"),
        (("run", "ur5-hybrid", "--set", "target_model.M_m=[1,2]"), "target_model.M_m: 2 entries; allowed: 6"),
        (("run", "ur5-hybrid", "--set", "robot.urdf=/none.urdf"), "robot.urdf: cannot read /none.urdf"),
        (("run", "ur5-hybrid", "--set", "robot.tool_frame=hand"), "robot.tool_frame: no frame 'hand'"),
        (("run", "ur5-hybrid", "--set", "contact.K_e=0"), "contact.K_e: 0 N/m, which takes no force in hybrid mode"),
        (
            ("run", "ur5-motion", "--set", "truth.push=[0,5,0]", "truth.push_frequency=500"),
            "truth.push_frequency: 500 Hz, at least half the control rate, so that the loop sees a slower one",
        ),
        (
            (
                *("run", "ur5-motion", "--set", "truth.push=[0,5,0]"),
                *("truth.push_duration=2", "truth.push_every=1", "truth.push_frequency=2"),
            ),
            "truth.push_every: 1 s, which cuts a sine of 2 s short; allowed: 0 for once, or at least",
        ),
        # numbers whose squares are none, or whose inverses are not
        (
            ("run", "ur5-motion", "--set", "truth.link_centre=[1e155,0,0]"),
            "truth.link_centre[0]: 10¹⁵⁵; allowed: a number <= 10\n",
        ),
        (
            ("run", "planar3r-hybrid", "--set", "truth.link_centre=[[0,0,0],[0,-11,0],[0,0,0]]"),
            "truth.link_centre[1][1]: -11; allowed: a number >= -10\n",
        ),
        (
            ("run", "ur5-motion", "--set", "truth.payload_mass=1", "truth.payload_offset=[1e200,0,0]"),
            "truth.payload_offset[0]: 10²⁰⁰; allowed: a number <= 10\n",
        ),
        (("run", "ur5-motion", "--set", "shift.duration=1e-170"), "shift.duration: 10⁻¹⁷⁰; allowed: a number >= 0.001"),
        (
            ("run", "ur5-hybrid", "--set", "motion.period=1e-300"),
            "motion.period: 10⁻³⁰⁰ s, at most two control periods, so that the loop sees a slower path; allowed: above",
        ),
        (
            ("run", "ur5-motion", "--set", "rotation=line", "rotation.period=0.002"),
            "rotation.period: 0.002 s, at most two control periods",
        ),
        (
            ("run", "ur5-hybrid", "--set", "force=sinusoid", "force.frequency=50", "controller.period=0.01"),
            "force.frequency: 50 Hz, at least half the control rate, so that the loop sees a slower one",
        ),
        (
            (
                "run",
                "ur5-motion",
                "--set",
                "truth.disturbance=10",
                "truth.disturbance_frequency=100",
                "controller.period=0.005",
            ),
            "truth.disturbance_frequency: 100 Hz, at least half the rate of the plant's steps, so that the arm feels a",
        ),
        (
            (
                "run",
                "ur5-groove-moving",
                "--set",
                "second.surface.motion.amplitude=0.001",
                "second.surface.motion.frequency=20",
                "controller.period=0.025",
            ),
            "second.surface.motion.frequency: 20 Hz, at least half the control rate",
        ),
        (
            ("run", "ur5-hybrid", "--set", "surface.normal=[1e200,1e200,0]"),
            "surface.normal: 10²⁰⁰, 10²⁰⁰, 0 is too long for a direction; allowed: three numbers that are not all 0, "
            "such as 0, 0, 1, and none beyond 10⁹\n",
        ),
        (
            ("run", "ur5-impedance", "--set", "target_model.K_m.9=1"),
            "target_model.K_m.9: no such entry; allowed: target_model.K_m.1 to target_model.K_m.6\n",
        ),
        (
            ("run", "ur5-hybrid", "--set", "target_model.K_m.1=1"),
            "target_model.K_m.1: no such entry; allowed: an entry",
        ),
        (
            ("run", "ur5-hybrid", "--set", "force=20"),
            "vsmrc: force: 20; allowed: a field of this section, such as force.value=20\n",
        ),
        (("run", "ur5-hybrid", "--set", "surface=[1,2]"), "surface: [1, 2]; allowed: a field of this section, such as"),
        (("run", "ur5-hybrid", "--set", "force.1=20"), "force.1: no such entry; allowed: an entry, from 1, of a list"),
        (("run", "ur5-impedance", "--set", f"target_model.K_m.{'9' * 5000}=1"), "no such entry; allowed: an entry"),
        (("run", "ur5-hybrid", "--set", "contact.K_e.1=1"), "contact.K_e.1: no such entry; allowed: an entry, from 1"),
        (("run", "ur5-hybrid", "--set", "5=1"), "5: no such field; allowed: name, title, mode, robot"),
        (("run", "ur5-hybrid", "--set", "title=\udcff"), "title: '\\udcff'; allowed: a text in UTF-8"),
        (("run", "ur5-hybrid", "--set", ""), "--set: an empty text; allowed: KEY=VALUE"),
        (("run", "ur5-hybrid", "--set", "=3"), "--set '=3': no field; allowed: KEY=VALUE"),
        (
            ("run", "ur5-hybrid", "--set", "force.value=3", "force.value=4"),
            "--set force.value: it is set more than once; allowed: once",
        ),
        (
            ("run", "ur5-hybrid", "--set", "simulation.duration=0.2", "--duration", "0.05"),
            "--duration 0.05: --set simulation.duration is given, too; allowed: one of both",
        ),
        (
            ("run", "ur5-hybrid", "--set", "surface.origin=[0,0,0]", "surface=plane"),
            "--set surface: it would undo surface.origin, set before it; allowed: surface first",
        ),
        (
            ("run", "ur5-hybrid", "--set", "blend.at=1", "--blend-to", "ur5-hybrid-moving"),
            "--set blend.at: --blend-to sets it, too; allowed: one of both",
        ),
        (
            ("run", "ur5-hybrid", "--set", "force.value=2024-01-01"),
            "force.value: 2024-01-01, a date or a time; allowed: a number, or a text in quotes",
        ),
        (("run", "ur5-hybrid", "--set", "surface.kind=spere"), "surface.kind: 'spere'; allowed: "),
        (
            ("run", "ur5-hybrid", "--set", "controller.own.k_i=10"),
            "controller.own.k_i: 10; allowed: a table, in the form controller.own.<law>.<parameter>",
        ),
        (
            ("run", "ur5-hybrid", "--set", "controller.own.pid-gravty.k_i=10"),
            "controller.own.pid-gravty: no such law; allowed: controller.own.<law>.<parameter> with a law of a file",
        ),
        (
            ("response", "ur5-impedance", "--at", "0.5", "--set", "truth.push=[0,5000,0]", "truth.push_start=0.0"),
            "--at 0.5: the run stops before, ",
        ),
    ],
)
def test_a_wrong_field_is_refused_in_one_sentence(
    arguments: tuple[str, ...], message: str, refuses: Callable[[tuple[str, ...], str], None]
) -> None:
    refuses(arguments, message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("mode", "levitation"), "mode: 'levitation'; allowed: constrained, hybrid"),
        (("motion", "spiral"), "motion"),
        (("controller.gain", 3), "controller.gain"),
        (("sensor.bias", [1.0, 2.0]), "sensor.bias"),
        (("contact.K_e", "stiff"), "contact.K_e: 'stiff'; allowed: a number"),
        (("target_model.K_m", 5), "target_model.K_m: 5; allowed: a list of numbers, or of rows where it is a matrix"),
        (("robot.urdf", 5), "robot.urdf: 5; allowed: text"),
        (("simulation.substeps", 2.5), "simulation.substeps: 2.5; allowed: a whole number"),
        (("robot", 5), "robot"),
        (("surface.colour", "red"), "surface.colour: no such field; allowed: kind, origin"),
    ],
)
def test_wrong_field_is_named(change: tuple[str, object], message: str) -> None:
    with pytest.raises(ScenarioError, match=message.replace("(", r"\(")):
        edited(Scenario(), *change)


def test_scenario_files_that_are_none(tmp_path: Path) -> None:
    for text, message in (
        ("mode = ", "not a TOML file"),
        ("# nothing\n", "an empty scenario"),
        ("[robot]\n", "an empty scenario"),
        ("[robot]\n[controller.own.spiral]\n", "an empty scenario"),
        ("[legs]\n", "legs: no such field"),
        ("colour = 'red'", "colour"),
        ("[robot]\nlegs = 2", "legs"),
    ):
        path = tmp_path / "scenario.toml"
        path.write_text(text)
        with pytest.raises(ScenarioError, match=message):
            load(str(path))
    with pytest.raises(ScenarioError, match="cannot be read"):
        load(str(tmp_path / "missing.toml"))
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(ScenarioError, match=r"^scenario '[^']*folder.toml': is a folder; allowed: a file$"):
        load(str(tmp_path / "folder.toml"))
    with pytest.raises(ScenarioError, match=r"^force\.kind: missing; allowed: constant, step, sinusoid$"):
        from_toml("[force]\nvalue = 30")
