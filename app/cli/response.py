"""Command `vsmrc response`: the tool's impedance, and the force loop's margins."""

from __future__ import annotations

import math
from pathlib import Path

import tyro

from app.cli.options import Files, Settings, configured, use_own, written_to
from app.cli.status import DONE
from app.scenario.data import shipped
from app.scenario.errors import ScenarioError


def response(
    scenario: tyro.conf.Positional[str],
    /,
    *,
    out: Path,
    at: float = 0.0,
    measure: tuple[float, ...] = (),
    chirp: tuple[float, float] | None = None,
    newtons: float = 2.0,
    newton_metres: float = 0.1,
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Compare the impedance that the tool has with that of the target model, and find the force loop's margins: writes
    response.svg and response.csv, and force_loop.csv where the contact's force is fed back.

    Args:
        scenario: a shipped scenario or a .toml file
        out: folder for the files
        at: the instant of the run whose posture is looked at, s
        measure: frequencies, Hz, at which whole runs under a sinusoidal push measure it, too
        chirp: lowest and highest frequency, Hz, of a push that sweeps from one to the other and measures it between
        newtons: size of that push along each axis, N
        newton_metres: size of that push about each axis, N·m
        use: a file with a law, surface or trajectory of your own (docs/extending.md)
    """
    from app.export.printing import render
    from app.export.response_files import figure_of, force_table_of, table_of, told
    from app.process.atomic_write import write_whole
    from app.scenario.caption import title_of
    from app.session import push_measurement
    from app.session.push_measurement import Chirp, PushExperiment
    from app.simulation import force_margin
    from app.simulation.closed_loop import ClosedLoop
    from app.simulation.sampled_stability import oscillations, sampled_loop
    from app.storage.constants_store import kept_memory

    if not 0.0 <= at < math.inf:
        raise ScenarioError(f"--at {at:g}: allowed: 0 s or more")
    if not 0.0 < newtons < math.inf:
        raise ScenarioError(f"--newtons {newtons:g}: allowed: more than 0 N")
    if not 0.0 < newton_metres < math.inf:
        raise ScenarioError(f"--newton-metres {newton_metres:g}: allowed: more than 0 N·m")
    use_own(use)
    chosen, memory = configured(scenario, settings), kept_memory()
    if at > chosen.simulation.duration:
        raise ScenarioError(f"--at {at:g}: allowed: 0 to {chosen.simulation.duration:g} s, the duration of the run")
    loop = ClosedLoop(chosen, memory=memory)
    while loop.t < at - 0.5 * loop.period and not loop.stopped:
        loop.step()
    if loop.stopped:
        raise ScenarioError(f"--at {at:g}: the run stops before, {loop.stopped}; allowed: an earlier instant")
    seen = sampled_loop(loop.system, loop.state.arm.views.q.copy(), loop.t)
    if seen.response is None:
        raise ScenarioError(f"response: {scenario} has none: the law chatters, the sensor is late, or J_q is singular")
    experiment = PushExperiment(loop.state, seen.response.axes, newtons, newton_metres, memory)
    points = [experiment.sine(each) for each in measure]
    points += [] if chirp is None else experiment.chirp(Chirp(*chirp))
    for line in told(seen.response):
        print(line)
    if points:
        print(push_measurement.told(points, seen.response, push_measurement.not_linear(loop.state)))
    for pole in oscillations(seen):
        print(
            f"poles of the target model at {pole.omega:.4g} 1/s, damping {pole.zeta:.3g}: in the sampled loop "
            f"{pole.sampled_omega:.4g} 1/s, damping {pole.sampled_zeta:.3g}"
        )
    if math.isfinite(seen.force_factor):
        print(f"force loop: a sample multiplies an error by {seen.force_factor:.3g}; allowed below 1 in size")
    if seen.force_loop is not None:
        print(force_margin.told(seen.force_loop))
    caption = f"{title_of(chosen, shipped().get(chosen.name)).text}, at t = {loop.t:.3g} s."
    with written_to(out):
        out.mkdir(parents=True, exist_ok=True)
        files = {
            "response.svg": render(figure_of(seen, seen.response, points, caption), "svg"),
            "response.csv": table_of(seen.response, points).encode(),
        }
        if seen.force_loop is not None:
            files["force_loop.csv"] = force_table_of(seen.force_loop).encode()
        for name, content in files.items():
            write_whole(out / name, lambda file, content=content: file.write(content))
    print(f"written to {out}")
    return DONE
