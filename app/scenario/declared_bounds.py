"""Check of the true arm against the declared bounds: the theorem promises something only for an arm within them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from app.scenario.schema import Scenario

SPREAD = 4.0  # of three normal numbers, the norm stays below this many standard deviations 99.9 % of the time
ROUNDING = 1e-9


def outside(scenario: Scenario) -> tuple[str, ...]:
    """Violated inequalities between truth and declaration, each with both numbers; none when all hold.

    Of the force sensor only bias and noise are judged, the noise by `SPREAD`: the effect of delay and low-pass depends
    on
    how fast the force changes.
    """
    return tuple(
        f"{what} {true:.4g}{unit} > declared {declared:.4g}{unit}"
        for what, true, declared, unit in _inequalities(scenario)
        if true > declared + ROUNDING
    )


def _inequalities(scenario: Scenario) -> Iterator[tuple[str, float, float, str]]:
    true, declared, sensor = scenario.truth, scenario.declared, scenario.sensor
    for what, of, factors, most in (
        ("link scaling", "link", true.link_scaling, declared.link_scaling),
        ("rotor scaling", "joint", true.rotor_scaling, declared.rotor_scaling),
    ):
        scaling = np.atleast_1d(np.array(factors, dtype=float))
        worst = int(np.abs(scaling - 1.0).argmax())
        which = f"{what} of {of} {worst + 1}" if len(scaling) > 1 else what
        yield f"{which} |{scaling[worst]:.4g} − 1| =", abs(scaling[worst] - 1.0), most, ""
    yield "payload", true.payload_mass, declared.payload_mass, " kg"
    if true.payload_mass > 0.0:
        distance = float(np.linalg.norm(true.payload_offset))
        yield "payload offset", distance, declared.payload_offset, " m"
    yield "Coulomb friction", true.coulomb, declared.coulomb, " N·m"
    yield "viscous friction", true.viscous, declared.viscous, " N·m·s/rad"
    yield "disturbance", true.disturbance, declared.disturbance, " N·m"
    kept, told = SPREAD * _kept_noise(scenario), f"(bias + {SPREAD:g}σ of noise)"
    error = float(np.linalg.norm(sensor.bias)) + kept * sensor.noise
    yield f"force error {told}", error, declared.force_error, " N"
    error = float(np.linalg.norm(sensor.moment_bias)) + kept * sensor.moment_noise
    yield f"moment error {told}", error, declared.moment_error, " N·m"


def _kept_noise(scenario: Scenario) -> float:
    """Share of the noise's standard deviation that the sensor's low-pass leaves."""
    sensor = scenario.sensor
    if sensor.cutoff == 0.0:
        return 1.0
    gain = 1.0 - np.exp(-2 * np.pi * sensor.cutoff * scenario.controller.period)
    return float(np.sqrt(gain / (2.0 - gain)))
