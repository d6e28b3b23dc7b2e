"""Order of convergence: the plant's integrators over substeps, the sampled loop and the sliding band over the period.

The reference is the paper's differential equation written independently (`tests/independent.py`: plain numpy, DOP853),
for the plant under a constant torque with a relative tolerance of 1e-12, for the closed loop 1e-10.

    python -m benchmarks.convergence
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from tqdm import tqdm

from app.scenario import edited, shipped
from environments.stiffness import STEPS
from tests.independent import order
from tests.twins import Twin, bands, loop_errors, plant_errors

CONTACTS = {
    "elastic, moving sphere": Twin("ur5", "hybrid", radius=0.3),
    "mass 3 kg, moving sphere": Twin("ur5", "hybrid", radius=0.3, M_e=3.0, ideal=True),
    "rigid sphere": Twin("ur5", "constrained", radius=0.3, moving=False, ideal=True),
}
SPAN = 0.04  # s under a constant torque
PERIODS = (0.002, 0.001, 0.0005, 0.00025)
DISCONTINUOUS = ("ur5-motion-discontinuous", "planar2r-semicircle-discontinuous")


def row(name: str, steps: Sequence[float], errors: np.ndarray) -> str:
    """Name, errors from the longest step to the shortest, slope."""
    return f"{name:52s}" + "".join(f"{e:11.2e}" for e in errors) + f"{order(steps, errors):9.2f}"


def heading(title: str, columns: Sequence[str]) -> str:
    return f"\n{title}\n{'':52s}" + "".join(f"{c:>11s}" for c in columns) + f"{'slope':>9s}"


def plant_rows() -> list[str]:
    """Both integrators on every contact; a rigid one is smooth enough for fewer steps to meet the reference's error."""
    lines = []
    for name, twin in tqdm(CONTACTS.items(), desc="integrators"):
        substeps = (4, 8, 16) if twin.rigid else (16, 32, 64)
        lines.append(heading(f"UR5, {name}: error of (q, q̇) after {SPAN} s", [f"{n} steps" for n in substeps]))
        for integrator in STEPS:
            errors = plant_errors(replace(twin, integrator=integrator), substeps, SPAN)
            lines.append(row(integrator, [SPAN / n for n in substeps], errors))
    return lines


def loop_rows() -> list[str]:
    """Sampled loop against continuous loop, and ||s|| under the discontinuous law, over the control period."""
    periods = [f"{1e3 * T:g} ms" for T in PERIODS]
    lines = [heading("Sampled loop against the continuous one: error of q over 0.2 s, rad", periods)]
    for name, twin in tqdm(CONTACTS.items(), desc="sampled loop"):
        for integrator in STEPS:
            errors = loop_errors(replace(twin, integrator=integrator), PERIODS, 0.2)
            lines.append(row(f"UR5, {name}, {integrator}", PERIODS, errors))
    lines.append(heading("Discontinuous law: largest ‖s‖ from 0.15 s on, m/s", periods))
    for name in tqdm(DISCONTINUOUS, desc="sliding band"):
        scenario = edited(edited(shipped()[name], "simulation.duration", 0.4), "controller.gain", "constant")
        scenario = edited(scenario, "controller.d", 20.0)
        lines.append(row(f"{name}, d = 20 N", PERIODS, bands(scenario, PERIODS, since=0.15)))
    return lines


def main() -> None:
    """Print the tables."""
    lines = plant_rows() + loop_rows()
    print("\n".join(lines))


if __name__ == "__main__":
    main()
