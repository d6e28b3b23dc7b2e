"""Statements of the premises in words: what is compared, the sentence for a failure, and the reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from controllers.premises import Premise


@dataclass(frozen=True)
class Statement:
    """A premise in words.
    title: the quantity that is compared.
    sign: how value and limit must compare.
    of: whose unit it has, "" for a plain number: a force of r, an angle of the joints, or J_q.
    failed: sentence for a failure, with {value}, {limit} and {unit}.
    why: reason for the premise.
    unknown: sentence where the value is infinite because it cannot be computed, "" for `failed`."""

    title: str
    sign: str
    of: Literal["", "r", "joints", "J_q"]
    failed: str
    why: str
    unknown: str = ""


STATEMENTS: dict[Premise, Statement] = {
    Premise.LAW: Statement(
        "robust law (25)", "≤", "", "the law is not the robust one (25)", "Theorem 1 is about (25) and no other law"
    ),
    Premise.DECLARED: Statement(
        "true arm inside the declared set",
        "≤",
        "",
        "the true arm is outside the declared set, {value} inequalities violated",
        "number of inequalities between truth and declaration that are violated; the bounds (6) are for that set",
    ),
    Premise.DOMAIN: Statement(
        "q in Ω",
        "≤",
        "joints",
        "q has left Ω: {value} {unit} from the postures along the reference, allowed {limit} {unit}",
        "distance to the nearest posture along the reference; k_r′ and k_r″ of (19) hold within it",
    ),
    Premise.REGULAR: Statement(
        "σ_min(J_q)", "≥", "J_q", "J_q is nearly singular: σ_min {value}, allowed from {limit}", "Ω ends where J_q does"
    ),
    Premise.DRIVES: Statement(
        "torque of the drives",
        "≤",
        "",
        "a drive saturates: the law asks for {value} times its limit",
        "largest ratio of a commanded torque to its drive's limit; what is cut off is missing in (25)",
    ),
    Premise.GAIN: Statement(
        "d covers (17)", "≤", "r", "the gain d = {limit} {unit} is below what (17) asks for, {value} {unit}", "(17)"
    ),
    Premise.HELD: Statement(
        "held over a period",
        "≤",
        "r",
        "within one period the model's torque and the force change by {value} {unit}, allowed {limit} {unit}",
        "what (25) without its robust terms changes from one sample to the next, in task space: over the period the "
        "torque is constant; a quarter of ε and of K_s s, and the declared error of the force sensor, are kept for it",
    ),
    Premise.LAYER: Statement(
        "robust terms, sampled",
        "<",
        "",
        "K_s and the boundary layer are too stiff for the control period: (K_s + d/s_b)T/H = {value}, allowed below 2",
        "(λ_max(K_s) + ¼ λ_min(K_s) + d/s_b) T / λ_min(H), without d/s_b where there is no layer: from 2 on one period "
        "makes s larger; infinite where M̂ less its declared errors is not positive definite",
    ),
    Premise.GAIN_BY_CHATTER: Statement(
        "d fed back by chattering",
        "<",
        "",
        "the gain (17) runs away: chattering in ė_r raises d by {value} of itself each period, allowed below 1",
        "δ_H ‖M_m⁻¹B_m + A‖ T / λ_min(H): d by (17) grows with r̈_eq, which chatters with ė_r",
    ),
    Premise.GAIN_BY_FORCE: Statement(
        "d fed back by the force",
        "<",
        "",
        "the gain (17) and the contact force raise each other: by {value} of the change, allowed below 1",
        "against a rigid or heavy surface the force depends on the torque, d by (17) on the force; from 1 on that loop "
        "has no solution, at any control period",
    ),
    Premise.FORCE_LOOP: Statement(
        "force loop, sampled",
        "<",
        "",
        "the sampled force loop diverges: its factor is {value}, allowed below 1; raise M_m along the normal, or set "
        "sensor.ideal",
        "what one sample makes of an error in the force that is fed back, with what d by (17) adds",
    ),
    Premise.SAMPLED_LOOP: Statement(
        "closed loop, sampled",
        "<",
        "",
        "the sampled loop swings up: a deviation grows {value} times each control period, allowed below 1",
        "largest growth of a small deviation over one control period with the torque held, for the model in force and "
        "the posture of now; under the discontinuous law, on the sliding surface s = 0 and where it reads a contact's "
        "force; infinite, for not known, where such a reading is late by more than 100 periods",
        unknown="whether the sampled loop swings up is not known: the force sensor is late by more than 100 control "
        "periods (sensor.delay)",
    ),
    Premise.CONTACT: Statement(
        "contact kept, no impact",
        "≤",
        "",
        "contact with a rigid surface is missing, or a surface with a mass has just been met: {value} of them",
        "number of rigid surfaces that the tool was off in the period before, and of surfaces with a mass that it has "
        "just met; (39) takes contact for granted, and an impact is a force without a bound",
    ),
}
