"""Postures along the reference: close together however long a run is to last, and none where the arm does not reach."""

from __future__ import annotations

import numpy as np
import pytest

from app.scenario.data import edited, shipped
from app.scenario.errors import PathOutOfReach
from app.simulation.assembly import assemble
from app.simulation.reference_postures import FAR
from app.simulation.search_memory import Memory

STEP = 0.02  # s


@pytest.mark.parametrize("duration", [10.0, 95.0, 600.0, 764.0])  # 764 s are 191 times the circle's period
@pytest.mark.parametrize(
    "motion", [{"kind": "point-to-point", "displacement": [0.2, 0.2, 0.0], "duration": 2.0}, {"kind": "circle"}]
)
def test_the_reference_is_near_a_centre_of_omega_at_every_instant(motion: dict[str, object], duration: float) -> None:
    scenario = edited(edited(shipped()["ur5-motion"], "motion", motion), "simulation.duration", duration)
    system = assemble(scenario, memory=Memory())
    omega, q = system.constants.omega, system.q_0
    apart = np.linalg.norm(np.diff(omega.centres, axis=0), axis=1)
    assert apart.max() <= FAR * omega.radius * (1.0 + 1e-9)
    for t in np.arange(0.0, min(duration, 12.0), STEP):
        q = system.posture_at(q, t).q
        assert omega.centre_near(q).distance <= FAR * omega.radius
    assert len(omega.centres) < 4000


@pytest.mark.parametrize("beyond", [-1e-3, 1e-5, 1e-3])  # m
def test_a_path_that_ends_beyond_the_arms_reach_is_refused(beyond: float) -> None:
    """Newton's method alone ends near the arm stretched out, which is no posture on the path."""
    planar = edited(shipped()["ur5-motion"], "robot", {"name": "planar2r"})
    planar = edited(planar, "motion", {"kind": "point-to-point", "displacement": [0.01, 0.0], "duration": 2.0})
    system = assemble(planar, memory=Memory())
    tool, ahead, behind = (
        system.nominal.evaluate(np.array(q), np.zeros(2)).p[[0, 2]] for q in (system.q_0, (0.0, 0.0), (np.pi, 0.0))
    )
    shoulder, reach = 0.5 * (ahead + behind), 0.5 * float(np.linalg.norm(ahead - behind))
    outwards = (tool - shoulder) / np.linalg.norm(tool - shoulder)
    way = (reach + beyond) * outwards - (tool - shoulder)
    edge = edited(edited(planar, "motion.displacement", way.tolist()), "simulation.sigma_min", 0.0)
    if beyond < 0.0:
        assemble(edge, memory=Memory())
    else:
        with pytest.raises(PathOutOfReach):
            assemble(edge, memory=Memory())
