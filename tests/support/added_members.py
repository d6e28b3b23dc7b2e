"""Texts of small members that `tests.project.test_extending` adds to a copy of the program (a law, a mode and others),
and of what it then asks that copy."""

from __future__ import annotations

STEEP = """@inline
def _arctan(size, layer):
    return 2.0 / np.pi * np.arctan(0.5 * np.pi * size / layer) / size


@inline
def _arctan_width(layer, given_up):
    return 2.0 / np.pi * layer * np.tan(0.5 * np.pi * (1.0 - given_up))


SWITCHING: dict"""
STEEP_ROW = """
        SwitchingFunction("arctan", "arc tangent", _arctan, _arctan_width),
        SwitchingFunction("tanh","""
DAMPING = '''"""Damping: a brake in every task coordinate."""

from controllers.control_law import ControlLaw
from kernels import inline
from kernels.algebra import copy, transposed_times


@inline
def torque(given, out):
    """-J_q^T B_m r_dot + G_hat."""
    braked = given.work.u
    for i in range(out.tau.shape[0]):
        braked[i] = -given.gains.model.B_m[i, i] * given.task.r_dot[i]
    transposed_times(given.task.J_q, braked, out.terms.linear)
    copy(given.feedforward.G_hat, out.terms.gravity)


LAW = ControlLaw(kind="damping", title="damping", about="A brake.", torque=torque)
'''
SOFT = """        Mode(
            "soft",
            "Soft",
            "Soft impedance control",
            "(27)",
            "The tool yields like a soft spring.",
            on_surface=False,
            feedback="all",
            stiffness=50.0,
        ),
    )
}
"""
SLOPE = '''"""A slope of 45 degrees."""

from typing import Annotated

import numpy as np

from environments.surfaces.chart import Shape, flat
from environments.surfaces.form import Form, tangent_frame
from parameters import field, slider


class Slope(Form, frozen=True, forbid_unknown_fields=True, tag="slope"):
    """A plane at 45 degrees."""

    title = "slope at 45°"
    chart = flat

    width: Annotated[float, field("how wide it is drawn", "m", slider("drawn over", 0.1, 2), gt=0, le=5)] = 0.5

    @property
    def shape(self) -> Shape:
        return self._placed(tangent_frame(np.array([1.0, 0.0, -1.0])))

    def local_point(self, frame, g):
        return frame.T @ g

    def extent(self):
        return (-self.width, self.width), (-self.width, self.width)
'''
NOD = '''"""A nod."""

from typing import Annotated

import numpy as np

from environments.trajectories.trajectory import Trajectory, along, in_plane
from kernels import inline
from parameters import decades, field


@inline
def _move(course, t, value, rate, acceleration):
    w = course.omega
    x = (1.0 - np.cos(w * t), w * np.sin(w * t), w * w * np.cos(w * t))
    along(course, x, (0.0, 0.0, 0.0), value, rate, acceleration)


class Nod(Trajectory, frozen=True, forbid_unknown_fields=True, tag="nod"):
    """Up and down in the first coordinate."""

    title = "nod"
    move = _move

    often: Annotated[float, field("how often", "Hz", decades("nods at", 0.1, 10), gt=0, le=10)] = 5.0

    def course(self, n, free):
        return in_plane(0.001 * np.eye(n)[free.start], np.zeros(n), omega=2 * np.pi * self.often)
'''
FADE = '''"""A force that grows without end."""

from typing import Annotated

from environments.force_profiles.force_profile import ForceCourse, ForceProfile
from kernels import inline
from parameters import field, slider


@inline
def _at(course, t):
    return course.start + course.slope * t, course.slope, 0.0


class Growing(ForceProfile, frozen=True, forbid_unknown_fields=True, tag="growing"):
    """A force that grows by so much in a second."""

    title = "growing"
    at = _at

    growth: Annotated[float, field("its rate", "N/s", slider("grows by", 0, 5), ge=0, le=10)] = 2.0

    @property
    def course(self) -> ForceCourse:
        return ForceCourse(0, self.value, 0.0, 0.0, 0.0, 0.0)._replace(slope=self.growth)
'''
SLOPED = """    omega: float
    slope: float = 0.0  # N/s
"""
CLIP = '''class Clip(Stage):
    """The sensor shows no more than this."""

    @staticmethod
    def acts(sensor: ForceSensor) -> bool:
        return sensor.settings.clip > 0.0

    def read(self, reading: np.ndarray) -> np.ndarray:
        return np.clip(reading, -self.sensor.settings.clip, self.sensor.settings.clip)


STAGES: tuple[type[Stage], ...] = (Clip, '''
CLIPPED = """    clip: Annotated[
        float, field("most that it shows, 0 for no limit", "N", slider("clips at", 0, 100), ge=0, le=1e4)
    ] = 0.0
    noise: """
PUSHED = """
    "pushed": ContactKind("pushed", "(32)", springs=True),
    "rigid":"""
ASKED = """
import gc
import json
from unittest.mock import MagicMock
import numpy as np
from app.dashboard.panels.controller import ControllerPanel
from app.dashboard.panels.task import TaskPanel
from app.dashboard.panels.world import WorldPanel
from app.scenario.data import edited, load, shipped
from app.simulation.closed_loop import ClosedLoop
from controllers.laws.table import number_of

gc.disable()  # a collection finds little of what the compiler makes
desk = MagicMock()
ControllerPanel(desk)
TaskPanel(desk)
WorldPanel(desk)
fields = [call.args[0] for call in desk.gui.add_text.call_args_list]
menus = [list(call.args[1]) for call in desk.gui.add_dropdown.call_args_list]
loop = ClosedLoop.from_scenario(edited(edited(load("mine"), "controller.law", "damping"), "mode", "soft"))
for _ in range(20):
    loop.step()
row = loop.recording.rows()[-1]
columns = loop.recording.columns
added = load("mine")
for path, value in {
    "mode": "hybrid", "contact.kind": "elastic", "surface": "slope", "motion": "nod", "force": "growing",
    "force.growth": 3.0, "controller.K_e_hat": 1e4, "sensor.clip": 0.5, "declared.force_error": 50.0,
}.items():
    added = edited(added, path, value)
tool = loop.view().tool
other = ClosedLoop.from_scenario(edited(added, "surface.origin", tool.tolist()))
for _ in range(20):
    other.step()
soft = edited(edited(load("mine"), "mode", "soft"), "contact.kind", "pushed")
bent = load("mine")
for path, value in {
    "switching": "arctan", "gain": "constant", "d": 50.0, "layer": 0.02, "on_change": "watch", "z_0": [0.02, 0.01],
}.items():
    bent = edited(bent, f"controller.{path}", value)
bent = ClosedLoop.from_scenario(bent)
J_q = bent.system.observe(bent.state.arm.views.q, np.zeros(2), 0.0)[1].J_q
bent.step()
out = ClosedLoop.from_scenario(soft).system.surface.chart(tool, 0.0).G[0]
pushed = [ClosedLoop.from_scenario(edited(soft, "surface.origin", (tool + d * out).tolist())) for d in (1e-3, -1e-3)]
for each in pushed:
    for _ in range(20):
        each.step()
print(json.dumps({
    "menus": [option for options in menus for option in options],
    "scenarios": list(shipped()),
    "number": number_of(loop.system.controller.law),
    "stiffness": loop.system.controller.model.K_m[0, 0],
    "gravity": row[columns["tau_gravity"]].tolist(),
    "tau": row[columns["tau"]].tolist(),
    "stopped": loop.stopped,
    "fields": fields,
    "s": bent.recording.signals(("s",))["s"][0].tolist(),
    "switched": np.linalg.solve(J_q.T, bent.recording.signals(("tau_switching",))["tau_switching"][0]).tolist(),
    "width": bent.state.evaluation.part("posture_check").layer_width,
    "normal": other.system.surface.chart(tool, 0.0).G[0].tolist(),
    "wanted": other.system.reference(0.3).r_d.tolist(),
    "start": other.system.plan.start.tolist(),
    "force": float(other.system.reference(2.0).F_cd[0]),
    "other": other.stopped,
    "measured": abs(other.recording.signals(("F",))["F"]).max(),
    "touched": abs(other.recording.signals(("multiplier",))["multiplier"]).max(),
    "pushed": sorted(abs(each.recording.signals(("multiplier",))["multiplier"]).max() for each in pushed),
}))
"""
