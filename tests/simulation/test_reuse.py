"""Which parts of a system stay when a scenario is edited."""

from __future__ import annotations

import msgspec
import pytest

from app.scenario.data import edited
from app.simulation.assembly import assemble
from app.simulation.closed_loop import ClosedLoop
from app.simulation.period.controlled_arm import ControlledArm
from app.simulation.recording import Recording
from tests.support.cases import short

pytestmark = pytest.mark.slow  # long or many simulations


def test_the_plant_stays_where_nothing_of_it_is_changed() -> None:
    system = assemble(short("ur5-hybrid"))
    for path, value in (("controller.K_s", 70.0), ("force.value", 17.0), ("motion.radius", 0.03)):
        assert assemble(edited(system.scenario, path, value), system).plant is system.plant, path
    for path, value in (
        ("truth.payload_mass", 0.3),
        ("contact.K_e", 2e4),
        ("contact.unilateral", False),
        ("simulation.integrator", "rk4"),
        ("simulation.substeps", 2),
        ("surface.normal", [0.1, 0.0, 1.0]),
    ):
        other = edited(system.scenario, path, value)
        assert assemble(other, system).plant is not system.plant, path


def test_the_controller_stays_where_it_is_told_of_no_change() -> None:
    system, yielding = assemble(short("ur5-hybrid")), assemble(short("ur5-impedance"))
    for path, value in (
        ("truth.link_scaling", 1.1),
        ("contact.K_e", 2e4),
        ("force.value", 17.0),
        ("sensor.delay", 0.002),
    ):
        assert assemble(edited(system.scenario, path, value), system).controller is system.controller, path
    for before, path, value in (
        (system, "controller.K_s", 70.0),
        (system, "controller.K_e_hat", 2e4),
        (system, "controller.A", -1.0),
        (system, "declared.link_scaling", 0.1),
        (system, "target_model.M_m", [12.0] * 6),
        (system, "motion.radius", 0.03),
        (system, "contact.kind", "mass-damper-spring"),
        (yielding, "contact.K_e", 2e4),
    ):
        assert assemble(edited(before.scenario, path, value), before).controller is not before.controller, path


@pytest.mark.parametrize("name", ["ur5-hybrid", "ur5-constrained"])
def test_another_true_arm_has_the_settings_of_a_system_built_with_it(name: str) -> None:
    loop = ClosedLoop.from_scenario(edited(short(name), "declared.delta_G", 30.0))
    truth = msgspec.structs.replace(loop.system.scenario.truth, payload_mass=0.4, viscous=2.0, torque_limit=80.0)
    twin = loop.with_truth(truth, Recording(loop.recording.n), None)
    built = ControlledArm(twin.system, twin.state).settings
    built.data["judged"] = False  # a broken promise stops none of them
    assert (
        twin.controlled_arm.kernel_data.setting.tobytes()
        == built.data.tobytes()
        != loop.controlled_arm.kernel_data.setting.tobytes()
    )
