"""Contact with a surface that moves: Newton's law for its mass, and friction of one that turns."""

from __future__ import annotations

import numpy as np
import pytest

from app.session.headless_run import simulate
from app.simulation.closed_loop import ClosedLoop
from app.simulation.engines import Engine
from tests.support.cases import short

pytestmark = pytest.mark.slow  # compiles a contact of its own


@pytest.mark.parametrize("engine", ["pinocchio", "compiled"])
def test_the_tool_accelerates_the_mass_of_a_surface_in_space(engine: Engine) -> None:
    """lambda = M_e n . p_ddot + B_e phi_dot + K_e phi (28), with the tool's acceleration from its recorded places."""
    M_e, B_e, K_e, h = 3.0, 40.0, 8000.0, 0.001
    heavy = {"kind": "mass-damper-spring", "M_e": M_e, "B_e": B_e, "K_e": K_e, "unilateral": False}
    motion = {"direction": [0.0, 0.0, 1.0], "amplitude": 0.005, "frequency": 2.0}
    scenario = short("ur5-hybrid-moving", contact=heavy, surface__motion=motion, simulation__duration=1.0)
    loop, _ = simulate(scenario, engine=engine)
    seen = loop.recording.signals(("tool", "phi", "multiplier"), t_from=0.4)
    z, phi = seen["tool"][:, 2], seen["phi"]
    downwards = -(z[2:] - 2.0 * z[1:-1] + z[:-2]) / h**2  # the surface's normal points down
    spring = B_e * (phi[2:] - phi[:-2]) / (2.0 * h) + K_e * phi[1:-1]
    pressed = seen["multiplier"][1:-1]
    assert np.abs(M_e * downwards).max() > 2.0
    assert np.abs(pressed - spring - M_e * downwards).max() < 0.1


def test_a_plane_that_turns_about_its_own_normal_drags_the_tool_along() -> None:
    """The tool is held 0.1 m beside the axis: the friction has the direction in which the plane moves under it."""
    tilt = {"axis": [0.0, 0.0, 1.0], "amplitude": 0.3, "frequency": 1.0}
    at_rest = ClosedLoop.from_scenario(short("ur5-hybrid"))
    place = at_rest.system.nominal.evaluate(at_rest.system.q_0, np.zeros(6)).p
    loop = ClosedLoop.from_scenario(
        short(
            "ur5-hybrid",
            surface__tilt=tilt,
            surface__origin=[float(place[0]) - 0.1, float(place[1]), float(at_rest.system.surface.origin[2])],
            contact__friction_coulomb=0.3,
            motion={"kind": "hold"},
        )
    )
    for _ in range(1100):
        loop.step()
    seen = loop.recording.signals(("t", "F", "multiplier"), t_from=0.85)  # the plane turns forwards
    assert (seen["multiplier"] > 1.0).all()
    drag = -seen["F"][:, 1] / seen["multiplier"]  # of the surface on the tool: F is the tool's on the surface
    np.testing.assert_allclose(drag, 0.3, atol=0.02)
