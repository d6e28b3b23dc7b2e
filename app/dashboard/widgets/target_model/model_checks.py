"""Checks of the target model: poles, eigenvalues and sampled loops of the running model, and of the model that an edit
asks for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape

import numpy as np

from app.dashboard.widgets.chips import chip
from app.dashboard.widgets.fields.field_words import refusal_in_words
from app.dashboard.widgets.run.whatif import changed
from app.dashboard.widgets.target_model.pole_drag import draggable
from app.dashboard.widgets.target_model.pole_map import grouped, pole_map_html
from app.dashboard.widgets.theorem.theorem_table import number_chip
from app.scenario.errors import ScenarioError
from app.scenario.number_text import rounded, short
from app.scenario.schema import Scenario
from app.scenario.units import Units
from app.session.commands import Edit, EditModel
from app.session.snapshot import Snapshot
from app.simulation.builders.controller_builder import (
    certificate_between,
    mode_of,
    require_admitted,
    stiffness_met,
    surfaces_met,
    target_model,
)
from app.simulation.sampled_loop.force_margin import ForceLoop, in_words
from app.simulation.sampled_loop.sampled_stability import oscillations
from controllers.blend import BlendCertificate
from controllers.premise_statements import STATEMENTS
from controllers.premises import Premise
from controllers.target_model import InvalidGain, TargetModel
from controllers.task_space import TaskLayout


@dataclass(frozen=True)
class Judgement:
    """Judgement of a target model.
    poles: in contact, 1/s.
    refusal: reason why the mode does not admit the model, "" where it does."""

    model: TargetModel
    poles: np.ndarray
    refusal: str

    @property
    def slowest(self) -> float:
        """The largest real part of the poles, 1/s."""
        return float(np.real(self.poles).max())


def judge_running(snapshot: Snapshot) -> Judgement:
    """Judgement of the model in force."""
    return _judge(TargetModel(**snapshot.matrices), snapshot.scenario, snapshot.system.layout)


def judge_requested(snapshot: Snapshot, edit: Edit | EditModel) -> Judgement:
    """Judgement of the model that an edit would bring. Raises ScenarioError or InvalidGain for an edit that brings no
    model."""
    scenario = changed(snapshot.scenario, edit)
    model = target_model(scenario, len(snapshot.coordinates))
    return _judge(model, scenario, snapshot.system.layout)


def _judge(model: TargetModel, scenario: Scenario, layout: TaskLayout) -> Judgement:
    mode = mode_of(scenario)
    try:
        require_admitted(model, scenario, mode, surfaces_met(scenario, mode, layout))
        refusal = ""
    except InvalidGain as error:
        refusal = str(error)
    return Judgement(model, mode.poles(model, stiffness_met(scenario)), refusal)


def judge_blend(snapshot: Snapshot, edit: Edit | EditModel) -> BlendCertificate | None:
    """Certificate of the blend from the running model to the model that an edit would bring; None where the latter is
    refused. Raises InvalidGain where the scenario admits no blend between the two."""
    try:
        requested = judge_requested(snapshot, edit)
    except (ScenarioError, InvalidGain):
        return None
    if requested.refusal:
        return None
    running, system = TargetModel(**snapshot.matrices), snapshot.system
    return certificate_between(running, requested.model, snapshot.scenario, system.mode, system.layout)


def blend_html(snapshot: Snapshot, edit: Edit | EditModel | None) -> str:
    """Progress of the present blend as HTML; without one, the certificate of a blend to the model of `edit`."""
    if snapshot.blending is not None:
        per_cent = f"{100 * snapshot.blending:.0f}"
        return f'<div class="vs-checks"><div class="vs-message vs-good">blending: {per_cent} % of the way.</div></div>'
    try:
        certificate = None if edit is None else judge_blend(snapshot, edit)
    except InvalidGain as error:
        look, sentence = "vs-bad", f"refused: {error}"
    else:
        if certificate is None:
            return ""
        look, sentence = "vs-good" if certificate.stable else "vs-bad", certificate.sentence
    return f'<div class="vs-checks"><div class="vs-message {look}">blend: {escape(sentence)}</div></div>'


def checks_html(snapshot: Snapshot, edit: Edit | EditModel | None) -> str:
    """Verdict, pole map and table of the running model, and beside them those of the model of `edit`, as HTML."""
    now = judge_running(snapshot)
    requested, problem = None, ""
    if edit is not None:
        try:
            requested = judge_requested(snapshot, edit)
            problem = requested.refusal
        except (ScenarioError, InvalidGain) as error:
            problem = str(error)
    verdicts = _stability_chip(now, "")
    if requested is not None:
        verdicts += _stability_chip(requested, "asked: ")
    message = f'<div class="vs-message vs-bad">{escape(refusal_in_words(problem))}</div>' if problem else ""
    rings = [] if requested is None else grouped(requested.poles)
    return (
        f'<div class="vs-checks"><div class="vs-row">{verdicts}</div>{message}'
        f"{pole_map_html(grouped(now.poles), rings, draggable(snapshot))}"
        f"{_table(now, requested, snapshot.system.units)}</div>"
    )


def _stability_chip(judgement: Judgement, prefix: str) -> str:
    word, look = ("stable", "vs-good") if judgement.slowest < 0.0 else ("not stable", "vs-bad")
    rightmost = rounded(judgement.slowest)
    return chip(f"{prefix}{word}, rightmost pole at {rightmost} 1/s", look)


def _table(now: Judgement, requested: Judgement | None, units: Units) -> str:
    head = f"<tr><td>eigenvalues</td><td>running</td>{'' if requested is None else '<td>asked</td>'}</tr>"
    rows = ""
    for name, unit in units.of_model.items():
        cells = "".join(f"<td>{_spread(getattr(j.model, name))}</td>" for j in (now, requested) if j is not None)
        rows += f"<tr><td>{name}{f' [{unit}]' if unit else ''}</td>{cells}</tr>"
    return f'<table class="vs-facts">{head}{rows}</table>'


def _spread(matrix: np.ndarray) -> str:
    """Smallest and largest eigenvalue, as text."""
    values = np.linalg.eigvals(matrix)
    if np.abs(values.imag).max() > 1e-9 * max(np.abs(values).max(), 1e-300):
        return chip("not symmetric", "vs-bad")
    low, high = float(values.real.min()), float(values.real.max())
    text = short(low, 4) if math.isclose(low, high, rel_tol=1e-6) else f"{short(low, 4)} … {short(high, 4)}"
    return chip(text, "vs-bad") if low < -1e-12 else text


def loops_html(snapshot: Snapshot) -> str:
    """Table of the factors of the loops that sampling closes, with their limits, as HTML; see docs/symbols.md."""
    live = snapshot.live
    rows = []
    if math.isfinite(factor := live.get("force_loop_factor", math.nan)):
        rows.append(("force loop, |factor| alone &lt; 1", number_chip(factor, low=-1.0, high=1.0)))
    if math.isfinite(factor := live.get("layer_loop_factor", math.nan)):
        rows.append((f"{STATEMENTS[Premise.LAYER].title}, factor &lt; 2", number_chip(factor, high=2.0)))
    rows += _margins(snapshot.sampled.force_loop)
    body = "".join(f"<tr><td>{what}</td><td>{value}</td></tr>" for what, value in rows)
    return (f'<table class="vs-facts">{body}</table>' if rows else "") + _sampled_poles(snapshot)


def _margins(loop: ForceLoop | None) -> list[tuple[str, str]]:
    """Rows of the force loop's margins, where there is one."""
    if loop is None:
        return []
    if loop.margins is None:
        return [("force loop", chip("unstable, so it has no margins", "vs-bad"))]
    return [(f"force loop, {name} margin", escape(words)) for name, words in in_words(loop.margins, loop.period)]


def _sampled_poles(snapshot: Snapshot) -> str:
    """Table of ω and ζ of the target model's poles, and of the poles of the sampled loop, those of the matrix of
    `app.simulation.sampled_loop.sampled_stability`, as HTML."""
    found = oscillations(snapshot.sampled)
    if not found:
        return ""
    rate = 1e-3 / snapshot.scenario.controller.period
    head = f"<tr><td>poles</td><td>model ω, ζ</td><td>sampled at {rounded(rate)} kHz</td></tr>"
    rows = "".join(
        f"<tr><td>{f'{o.count} ×' if o.count > 1 else ''}</td><td>{rounded(o.omega)} rad/s, {_ratio(o.zeta)}</td>"
        f"<td>{_span(o.slowest, o.fastest)} rad/s, {'≥ ' if o.count > 1 else ''}{_ratio(o.least_zeta)}</td></tr>"
        for o in found
    )
    return f'<table class="vs-facts">{head}{rows}</table>'


def _span(low: float, high: float) -> str:
    """Range of numbers to three digits, as one number where its ends are written alike."""
    ends = (rounded(low), rounded(high))
    return ends[0] if ends[0] == ends[1] else " to ".join(ends)


def _ratio(zeta: float) -> str:
    return f"{zeta:.3f}".replace("-", "−")
