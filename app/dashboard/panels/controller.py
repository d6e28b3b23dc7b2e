"""Controller panel: gains of the law (25), switching, and the present numbers of the theorem."""

from __future__ import annotations

from html import escape
from typing import ClassVar

import viser

from app.dashboard.widgets.families.arm_choice import InForce
from app.dashboard.widgets.fields.controls import Control, Desk, Dropdown, NumberField
from app.dashboard.widgets.fields.field_binding import BindingWhere, FieldBinding, log_scale
from app.dashboard.widgets.fields.own_parameters import own_number
from app.dashboard.widgets.theorem.constants_table import constants_html
from app.dashboard.widgets.theorem.theorem_table import TheoremTable
from app.session.snapshot import Snapshot
from app.simulation.builders.controller_builder import laws
from controllers.control_law import ControlLaw
from controllers.premise_statements import STATEMENTS
from controllers.premises import Premise
from controllers.switching import SWITCHING
from parameters import Parameter

_SAID = '<div class="vs-checks"><div class="vs-message vs-warn">{}</div></div>'


def _own(desk: Desk, law: ControlLaw, p: Parameter) -> NumberField:
    """Control of an own parameter of a user's law; hidden under other laws."""

    def running(snapshot: Snapshot) -> float | None:
        controller = snapshot.system.controller
        return controller.parameters[p.name] if controller.law is law else None

    return own_number(desk, f"controller.own.{law.kind}.{p.name}", p, running)


class ControllerPanel:
    """Controller panel: the law, its gains, and the live numbers of the theorem. Controls without a meaning for the
    present law are hidden."""

    holds: ClassVar = "law, robust term, gain d, bounds, switching, sliding surface, domain Ω, constants, computation"

    def __init__(self, desk: Desk) -> None:
        gui = desk.gui
        law = Dropdown(desk, "controller.law", "Law", {law.title: kind for kind, law in laws().items()})
        self._about = gui.add_html("")
        self._facts = TheoremTable(gui)
        self._controls: list[Control] = [law, *(_own(desk, law, p) for law in laws().values() for p in law.parameters)]
        term, surface = gui.add_folder("Robust term"), gui.add_folder("Sliding surface")
        self._robust_only: list[viser.GuiFolderHandle] = [term, surface]
        with term:
            self._controls += _gain_controls(desk)
            self._feedback = gui.add_html("")
            self._controls += _switching_controls(desk)
        with surface:
            self._controls += _surface_controls(desk)
            gui.add_html(
                '<div class="vs-note">K_s, F_1, F_2, A: one number for all axes, or one per axis, separated by '
                "commas.</div>"
            )
        with gui.add_folder("Domain Ω"):
            self._controls += _domain_controls(desk)
        with gui.add_folder("Constants of the theorem", expand_by_default=False):
            self._constants = gui.add_html("")
        with gui.add_folder("Computation"):
            self._controls += _computation_controls(desk)

    def show(self, snapshot: Snapshot) -> None:
        self._facts.show(snapshot)
        law = snapshot.system.controller.law
        about = f"{law.about.rstrip(' .')}. {law.told_in_words}"
        self._about.content = "" if law.robust else _SAID.format(escape(about))
        self._feedback.content = _feedback_html(snapshot)
        self._constants.content = constants_html(snapshot)
        for folder in self._robust_only:
            if folder.visible != law.robust:
                folder.visible = law.robust
        for control in self._controls:
            control.show(snapshot)


def _gain_controls(desk: Desk) -> list[Control]:
    """Controls of the gain d of the robust term, and of the bounds by which (17) finds it."""
    d = BindingWhere("controller.d", lambda scenario: scenario.controller.gain == "constant")
    return [
        Dropdown(desk, "controller.gain", "Gain d", {"by the theorem (17)": "theorem", "constant": "constant"}),
        NumberField(desk, d, "constant d [N]", log_scale(1, 1000)),
        NumberField(desk, FieldBinding("controller.epsilon"), "margin ε [N]", log_scale(0.1, 100)),
        Dropdown(desk, "controller.bounds", "Bounds", {"in task space (tight)": "tight", "as in (7)": "paper"}),
    ]


def _switching_controls(desk: Desk) -> list[Control]:
    """Controls of the switching function and of the linear part of the robust term."""
    kinds = {function.title: function.kind for function in SWITCHING.values()}
    layer = BindingWhere("controller.layer", lambda scenario: SWITCHING[scenario.controller.switching].has_layer)
    return [
        Dropdown(desk, "controller.switching", "Switching", kinds),
        NumberField(desk, layer, "layer s_b [m/s]", log_scale(1e-4, 0.1)),
        NumberField(desk, FieldBinding("controller.K_s"), "K_s [N·s/m]", log_scale(1, 2000)),
    ]


def _surface_controls(desk: Desk) -> list[Control]:
    """Controls of the sliding surface, and of what becomes of s when the gains change."""
    on_change = {"z anew: no reaching": "remove", "z kept: watch s reach 0": "watch"}
    return [
        NumberField(desk, FieldBinding("controller.F_1"), "F_1 [1/s]", log_scale(0.5, 200)),
        NumberField(desk, FieldBinding("controller.F_2"), "F_2", log_scale(0.05, 20)),
        NumberField(desk, FieldBinding("controller.A"), "A ≤ 0 [1/s]"),
        Dropdown(desk, "controller.on_change", "On change", on_change),
        NumberField(desk, InForce("controller.z_0", _kept_z), "z(0) [m/s]"),
    ]


def _domain_controls(desk: Desk) -> list[Control]:
    """Controls of the domain Omega, and of what a broken promise does to the run."""
    stop_or_flag = {"stops the run": "stop", "is reported; the run goes on": "flag"}
    return [
        NumberField(desk, FieldBinding("simulation.domain_radius"), "radius [rad]", log_scale(0.01, 3)),
        NumberField(desk, FieldBinding("simulation.sigma_min"), "σ_min ≥ [m]", log_scale(0.001, 0.2, zero=True)),
        Dropdown(desk, "simulation.leaving_domain", "On a failure", stop_or_flag),
        Dropdown(desk, "simulation.bound_violation", "Promise broken", stop_or_flag),
    ]


def _computation_controls(desk: Desk) -> list[Control]:
    """Controls of how the law is computed: its estimates and its period."""
    estimates = {"M, C, G on-line": "online", "along r_d (Remark 3)": "along-reference"}
    return [
        Dropdown(desk, "controller.estimates", "Estimates", estimates),
        NumberField(desk, FieldBinding("controller.period"), "period [s]", log_scale(1e-4, 0.02)),
    ]


def _kept_z(snapshot: Snapshot) -> tuple[float, ...] | None:
    """Initial state z of the compensator; None, which hides its row, where the compensator starts anew."""
    kept = snapshot.scenario.controller.on_change == "watch"
    return tuple(snapshot.system.z_0.tolist()) if kept else None


def _feedback_html(snapshot: Snapshot) -> str:
    """Note on the gain by (17), which depends on itself: its feedback with the present bounds, as HTML; "" for a
    constant gain."""
    by_names = {finding.premise: finding for finding in snapshot.standing.findings}
    parts = []
    for premise, way in ((Premise.GAIN_BY_CHATTER, "the chattering"), (Premise.GAIN_BY_FORCE, "the contact force")):
        found = by_names.get(premise.name.lower())
        if found is not None and found.value is not None:
            part = f"{found.value:.2g} of each increase through {way}"
            parts.append(f'<span title="{escape(STATEMENTS[premise].why)}">{part}</span>')
    if not parts:
        return ""
    return (
        f'<div class="vs-note">A larger d raises the gain that (17) requires: by {" and ".join(parts)}. Below 1 this '
        "converges; from 1 on (17) may have no solution d.</div>"
    )
