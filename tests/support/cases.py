"""Scenarios for tests: any arm in any mode against any surface that its tool just touches."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from app.scenario.data import edited, from_plain, load, shipped, to_plain
from app.scenario.schema import Scenario
from app.session.changes import in_mode, on_robot
from app.simulation.closed_loop import ClosedLoop
from app.simulation.compiled_run import CompiledRun
from controllers.premises import Premise

SURFACES = ("plane", "moving plane", "cylinder", "inside of a cylinder", "typed wave", "moving sphere")
ALIKE = ("ur3", "ur10", "xarm7", "z1")  # the kernels see nothing in them that other arms do not have


def surfaces_for(robot: str) -> tuple[str, ...]:
    """Those to try this arm on: of arms that are alike one meets them all, the others two that move."""
    return SURFACES[-2:] if robot in ALIKE else SURFACES


@cache
def tool_height(robot: str) -> np.ndarray:
    return ClosedLoop.from_scenario(from_plain({"robot": {"name": robot}})).view().tool


def surfaces(robot: str) -> dict[str, dict[str, object]]:
    """Surfaces that this arm's tool just touches, at rest and moving."""
    x, y, z = tool_height(robot).tolist()
    motion = {"direction": [0.0, 0.0, 1.0], "amplitude": 0.01, "frequency": 1.0}
    below = {"origin": [x, y, z - 0.3], "radius": 0.3}
    return {
        "plane": {"kind": "plane", "origin": [x, y, z]},
        "moving plane": {"kind": "plane", "origin": [x, y, z], "motion": motion},
        "cylinder": {"kind": "cylinder", **below},
        "inside of a cylinder": {
            "kind": "cylinder", "origin": [x, y, z + 0.3], "radius": 0.3, "side": "inside", "reference": [0, 0, -1.0],
        },
        "typed wave": {"kind": "formula", "text": "z - 0.01*sin(9*x)*cos(2*t) - 0.1*x*y", "origin": [x, y, z]},
        "moving sphere": {"kind": "sphere", **below, "motion": motion},
    }  # fmt: skip


@cache
def adapted(robot: str, mode: str) -> Scenario:
    """The scenario of all defaults, on an arm in a mode."""
    return in_mode(on_robot(Scenario(), robot), mode)


def scenario_of(robot: str, mode: str, contact: str, surface: str) -> Scenario:
    data = to_plain(adapted(robot, mode))
    data["surface"] = surfaces(robot)[surface]
    data["contact"] |= {"kind": contact, "friction_coulomb": 0.1, "M_e": 1.0, "B_e": 10.0}
    data["motion"] = {"kind": "line", "displacement": [0.05]}
    data["truth"] |= {"link_scaling": 1.1, "viscous": 0.1}
    data["declared"] |= {"link_scaling": 0.15, "viscous": 0.2}
    data["sensor"] |= {"noise": 0.05}
    data["simulation"] |= {"seed": 7}
    return from_plain(data)


def short(name: str, **fields: object) -> Scenario:
    """A shipped scenario of 0.3 s with other fields by their dotted paths, with "__" for the dot."""
    scenario = edited(shipped()[name], "simulation.duration", 0.3)
    for path, value in fields.items():
        scenario = edited(scenario, path.replace("__", "."), value)
    return scenario


def changed(name: str, **sections: Any) -> Scenario:
    """A shipped scenario with other fields, by section."""
    data = to_plain(load(name))
    for section, fields in sections.items():
        data[section] = fields if "kind" in fields else data.get(section, {}) | fields
    return from_plain(data)


def run(scenario: Scenario, seconds: float) -> ClosedLoop:
    """The run of a scenario after some seconds."""
    loop = ClosedLoop.from_scenario(scenario)
    CompiledRun(loop).advance(round(seconds / loop.period))
    return loop


def value(loop: ClosedLoop, premise: Premise) -> float:
    """Present value of a premise of a run."""
    return float(loop.state.evaluation.views.table.value[premise])
