"""Plan of a tuning: the gains that may move, the metrics that count, the arms, and how many candidates."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from app.scenario.errors import ScenarioError, scenario_errors
from app.scenario.schema import Scenario
from app.scenario.units import Units
from app.simulation.builders.controller_builder import mode_of
from app.simulation.builders.environment_builder import positions_of, robot_of, task_joints
from app.sweep.axes import Axis, axis_of
from app.sweep.fingerprint import fingerprint
from app.sweep.plan import Design, Sweep, SweepPlan, arms_differ
from app.sweep.run_metrics import COLUMNS, metric_title
from parameters import allowed

AIMS = (
    "motion_error", "angle_error", "force_error", "constraint_violation", "settling_time", "reaching_time", "band_time",
    "residual", "torque_variation", "saturated_share",
)  # fmt: skip
GAINS = ("controller.", "target_model.")  # what may move
LARGEST_SEED = 2**32 - 1  # of optuna
MOST_AIMS = 2  # the front of two aims is a line, that of more cannot be drawn
SHAPE = "allowed: PATH=LOW:HIGH, with :log behind where its logarithm is to be drawn evenly"


class Tuning(Sweep, frozen=True):
    """Tuning: its whole definition, as it stands in tune.toml; a sweep whose points, the candidates, an optimiser
    chooses.

    vary: gains that may move, each within a range.
    design: of the first candidates, before there is anything to learn from.
    points: candidates; the first one has the scenario's own gains.
    draw: true arms on which a candidate is judged by its worst; 0: the scenario's own one.
    aims: metrics that count, one or two, the smaller the better.
    unseen: further true arms, on which no candidate is chosen and what was found is tried.
    """

    design: Design = "sobol"
    aims: tuple[str, ...] = ()
    unseen: Annotated[int, Meta(ge=1)] = 32
    file: ClassVar[str] = "tune.toml"
    noun: ClassVar[str] = "tuning"

    @property
    def seen(self) -> int:
        """Number of true arms that the search sees, all with the same noise of the sensor; each further one has its
        own."""
        return super().arms

    @property
    def arms(self) -> int:
        return self.seen + self.unseen


def require_sound(tuning: Tuning) -> None:
    """Raise ScenarioError with one sentence where a tuning makes no sense."""
    for aim in tuning.aims:
        if aim not in AIMS:
            raise ScenarioError(f"--for {aim!r:.60}; {allowed(aim, AIMS)}")
    known, mode = known_aims(tuning.scenario), tuning.scenario.mode
    if without := [aim for aim in tuning.aims if aim not in known]:
        raise ScenarioError(
            f"--for {without[0]}: a run of this scenario in {mode} mode has none; allowed: {', '.join(known)}"
        )
    if not 1 <= len(set(tuning.aims)) == len(tuning.aims) <= MOST_AIMS:
        given = " ".join(tuning.aims) or "nothing"
        raise ScenarioError(f"--for {given}; allowed: one metric or two different ones of {', '.join(AIMS)}")
    if not tuning.vary:
        raise ScenarioError(f"--move: no gain may move; {SHAPE}")
    for axis in tuning.vary:
        if not is_gain(axis.path):
            raise ScenarioError(f"--move {axis.path}: no gain; allowed: fields of controller and target_model")
    if tuning.drawn > 1 and not arms_differ(tuning):
        raise ScenarioError(
            f"--unseen {tuning.unseen}: true arms that are all alike, since no quantity that is drawn is declared; "
            "allowed: a bound above 0, such as declared.link_scaling, or --unseen 1 without --draw"
        )
    SweepPlan(tuning)


def is_gain(path: str) -> bool:
    """Whether a tuning may move the field at this dotted path."""
    return path.startswith(GAINS)


def known_aims(scenario: Scenario) -> list[str]:
    """Aims that runs of the scenario have. Raises ScenarioError where its arm cannot be read."""
    with scenario_errors():
        mode, robot = mode_of(scenario), robot_of(scenario)
    joint, tilts = scenario.task_space.kind == "joint", 2 if scenario.face.flat and mode.on_surface else 0
    supplemental, angles = task_joints(scenario, robot)
    turning = angles - tilts + sum(not robot.slides[each] for each in supplemental)
    without = {
        "motion_error": not joint and mode.force_directions >= positions_of(robot) + tilts,
        "angle_error": joint or not turning,
        "force_error": not mode.on_surface,
        "constraint_violation": not mode.rigid,
    }
    return [aim for aim in AIMS if not without.get(aim, False)]


def moved(text: str) -> Axis:
    """Gain that may move, of a text PATH=LOW:HIGH or PATH=LOW:HIGH:log. Raises ScenarioError."""
    axis = axis_of(text, "--move", SHAPE)
    if axis.values:
        raise ScenarioError(f"--move {text!r:.100}; {SHAPE}")
    return axis


def program(tuning: Tuning | None = None) -> str:
    """Fingerprint of all that a tuning's answer depends on besides its definition, see `fingerprint`."""
    return fingerprint(tuning, ("app/tune",), ("optuna",))


def in_words(aim: str, units: Units) -> str:
    """Aim with its unit in a task space with these units, as on an axis or at the head of a column."""
    unit = COLUMNS[aim].unit_in(units)
    return metric_title(aim) + (f" [{unit}]" if unit else "")
