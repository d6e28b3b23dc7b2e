"""Command `vsmrc response`: the tool's impedance, and the force loop's margins."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from app.cli.options import (
    NO_DEFAULT_SHOWN,
    Default,
    Files,
    Settings,
    configured,
    note_unused,
    note_without_effect,
    require_folder,
    use_own,
    written_to,
)
from app.cli.status import DONE
from app.scenario.errors import ScenarioError

if TYPE_CHECKING:
    from app.scenario.schema import Scenario
    from app.session.push_measurement import Measured
    from app.simulation.closed_loop import ClosedLoop
    from app.simulation.omega.search_memory import Memory
    from app.simulation.sampled_loop.push_response import PushResponse
    from app.simulation.sampled_loop.sampled_stability import RespondingLoop

NEWTONS, NEWTON_METRES = Default(2.0), Default(0.1)  # N, N m
LARGEST_PUSH = 1e6  # N, N m; no number overflows


def response(
    scenario: tyro.conf.Positional[str],
    /,
    *,
    out: Path,
    at: float = 0.0,
    measure: Annotated[tuple[float, ...], NO_DEFAULT_SHOWN] = (),
    chirp: Annotated[tuple[float, float] | None, NO_DEFAULT_SHOWN] = None,
    newtons: Annotated[float | None, NEWTONS.hint] = None,
    newton_metres: Annotated[float | None, NEWTON_METRES.hint] = None,
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Compare the impedance of the tool with that of the target model over frequency, and compute the stability
    margins of the force loop. Writes response.svg and response.csv. Also writes force_loop.csv if the controller feeds
    back the contact force.

    Args:
        scenario: a shipped scenario or a .toml file
        out: folder for the files
        at: instant of the run at which the loop is linearised, s
        measure: also measure the impedance at these frequencies, Hz (1/60 to a quarter of the control rate), by
            simulating sinusoidal pushes
        chirp: also measure the impedance by simulating a push whose frequency sweeps from the first value to the
            second, Hz
        newtons: amplitude of these pushes along each axis, N
        newton_metres: amplitude of these pushes about each axis, N·m
        use: file with your own control law, surface or trajectory (docs/extending.md)
    """
    from app.scenario.caption import titled
    from app.session.push_measurement import Chirp, PushExperiment
    from app.simulation.sampled_loop.sampled_stability import sampled_loop
    from app.storage.constants_store import kept_memory

    if not 0.0 <= at < math.inf:
        raise ScenarioError(f"--at {at:g}: allowed: 0 s or more")
    _require_sizes(newtons, newton_metres, pushed=bool(measure) or chirp is not None)
    require_folder(out)
    use_own(use)
    chosen, memory = configured(scenario, settings), kept_memory()
    note_unused(chosen)
    note_without_effect(settings, chosen)
    loop = _loop_at(at, chosen, memory)
    seen = sampled_loop(loop.system, loop.state.arm.views.q.copy(), loop.t)
    if seen.response is None:
        raise ScenarioError(f"response: {scenario} has none: the law chatters, the sensor is late, or J_q is singular")
    _require_moment_axes(newton_metres, seen.response, scenario)
    pushes = NEWTONS.unless(newtons), NEWTON_METRES.unless(newton_metres)
    experiment = PushExperiment(loop.state, seen.response.axes, *pushes, memory)
    points = [experiment.sine(each) for each in measure]
    points += [] if chirp is None else experiment.chirp(Chirp(*chirp))
    _print_response(seen, seen.response, points, loop)
    caption = f"{titled(chosen)}, at t = {loop.t:.3g} s."
    _write(out, seen, seen.response, points, caption)
    return DONE


def _require_sizes(newtons: float | None, newton_metres: float | None, *, pushed: bool) -> None:
    """Raises ScenarioError for a size of pushes that is not possible, or that was typed while nothing is pushed."""
    for flag, size, unit in (("--newtons", newtons, "N"), ("--newton-metres", newton_metres, "N·m")):
        if size is not None and not 0.0 < size <= LARGEST_PUSH:
            raise ScenarioError(f"{flag} {size:g}: allowed: more than 0 {unit}, at most {LARGEST_PUSH:g} {unit}")
        if size is not None and not pushed:
            raise ScenarioError(f"{flag} {size:g}: nothing is pushed; allowed: with --measure or --chirp")


def _require_moment_axes(newton_metres: float | None, predicted: PushResponse, scenario: str) -> None:
    """Raises ScenarioError where a moment was typed for a scenario without an axis that it could act about."""
    from app.simulation.sampled_loop.push_response import FORCE

    if newton_metres is not None and all(axis.kind == FORCE for axis in predicted.axes):
        raise ScenarioError(
            f"--newton-metres {newton_metres:g}: no moment acts on a coordinate of {scenario}; allowed: --newtons"
        )


def _loop_at(at: float, scenario: Scenario, memory: Memory) -> ClosedLoop:
    """Loop of a scenario at an instant, s. Raises ScenarioError where its run does not come there."""
    from app.simulation.closed_loop import ClosedLoop

    if at > scenario.simulation.duration:
        raise ScenarioError(f"--at {at:g}: allowed: 0 to {scenario.simulation.duration:g} s, the duration of the run")
    loop = ClosedLoop.from_scenario(scenario, memory=memory)
    while loop.t < at - 0.5 * loop.period and not loop.stopped:
        loop.step()
    if loop.stopped:
        raise ScenarioError(f"--at {at:g}: the run stops before, {loop.stopped}; allowed: an earlier instant")
    return loop


def _print_response(seen: RespondingLoop, predicted: PushResponse, points: list[Measured], loop: ClosedLoop) -> None:
    """Print the response, what was measured, and the margins of the sampled loop."""
    from app.export import response_files
    from app.session import push_measurement
    from app.simulation.sampled_loop import force_margin
    from app.simulation.sampled_loop.sampled_stability import oscillations

    for line in response_files.summary(predicted):
        print(line)
    if points:
        print(push_measurement.deviation_sentence(points, predicted, push_measurement.not_linear(loop.state)))
    for pole in oscillations(seen):
        print(
            f"poles of the target model at {pole.omega:.4g} 1/s, damping {pole.zeta:.3g}, {pole.count} of them: in "
            f"the sampled loop {pole.slowest:.4g} to {pole.fastest:.4g} 1/s, damping at least {pole.least_zeta:.3g}"
        )
    if math.isfinite(seen.force_factor):
        print(f"force loop: a sample multiplies an error by {seen.force_factor:.3g}; its size must be below 1")
    if seen.force_loop is not None:
        print(force_margin.margins_sentence(seen.force_loop))


def _write(out: Path, seen: RespondingLoop, predicted: PushResponse, points: list[Measured], caption: str) -> None:
    """Write the files of a response to the folder `out`. Raises ScenarioError."""
    from app.export.printing import render
    from app.export.response_files import figure_of, force_table_of, table_of
    from app.process.atomic_write import write_whole

    with written_to(out):
        out.mkdir(parents=True, exist_ok=True)
        files = {
            "response.svg": render(figure_of(seen, predicted, points, caption), "svg"),
            "response.csv": table_of(predicted, points).encode(),
        }
        if seen.force_loop is not None:
            files["force_loop.csv"] = force_table_of(seen.force_loop).encode()
        else:
            (out / "force_loop.csv").unlink(missing_ok=True)  # of an earlier response
        for name, content in files.items():
            write_whole(out / name, lambda file, content=content: file.write(content))
    print(f"written to {out}")
