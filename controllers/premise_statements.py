"""Statements of the premises in words: what is compared, the sentence for a failure, and the reason."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.premises import Premise
from parameters import UnitsOf


@dataclass(frozen=True)
class Statement:
    """A premise in words.
    title: the quantity that is compared.
    sign: how value and limit must compare.
    of: whose unit it has, "" for a plain number: a force of r, an angle of the joints, or J_q.
    failed: sentence for a failure, with {value}, {limit} and {unit}, and {ways} to a stable loop that the law has.
    why: reason for the premise.
    unknown: sentence where the value is infinite because it cannot be computed, "" for `failed`.
    counts: whether the value is a number of violations, of which none is allowed."""

    title: str
    sign: str
    of: UnitsOf
    failed: str
    why: str
    unknown: str = ""
    counts: bool = False


STATEMENTS: dict[Premise, Statement] = {
    Premise.LAW: Statement(
        "robust law (25)",
        "≤",
        "",
        "the law is not the robust one (25)",
        "Theorem 1 is about (25) and no other law",
        counts=True,
    ),
    Premise.DECLARED: Statement(
        "true arm inside the declared set",
        "≤",
        "",
        "the true arm is outside the declared set: it violates {value} declared bounds",
        "number of declared bounds that the true arm violates; the bounds (6) hold inside the declared set only",
        counts=True,
    ),
    Premise.DOMAIN: Statement(
        "q in Ω",
        "≤",
        "joints",
        "q has left Ω: it is {value} {unit} from the postures along the reference (at most {limit} {unit}); "
        "choose a larger radius of Ω, or a path nearer to the arm",
        "distance to the nearest posture along the reference; k_r′ and k_r″ of (19) hold within it; for "
        "surfaces that never come back to their places or forms only until simulation.duration, for those that take "
        "more than 1000 s only for 1000 s",
        unknown="k_r′ and k_r″ of (19) are not known for the surfaces as they are now: where a formula changes with "
        "time, or a surface moves and never comes back, they are searched up to simulation.duration only, and nowhere "
        "for more than 1000 s; choose a longer duration, up to 1000 s",
    ),
    Premise.REGULAR: Statement(
        "σ_min(J_q)",
        "≥",
        "J_q",
        "J_q is nearly singular: σ_min = {value} {unit} (must be at least {limit} {unit}); choose another path or "
        "posture",
        "J_q is singular nowhere in Ω",
    ),
    Premise.DRIVES: Statement(
        "torque of the drives",
        "≤",
        "",
        "a drive saturates: the law asks for {value} times its limit; choose a slower path, or a softer target model",
        "largest ratio of a commanded torque to its drive's limit; a torque that is cut off is missing in (25)",
    ),
    Premise.JOINTS: Statement(
        "joints within their limits",
        "≤",
        "",
        "a joint is beyond its limits: it is {value} times half its range from the middle (at most {limit}); choose "
        "another path or posture",
        "largest distance of a joint from the middle of its range, by half the range; (2) has no stops, so that beyond "
        "a limit of the URDF the run is that of no arm",
    ),
    Premise.GAIN: Statement(
        "d covers (17)",
        "≤",
        "r",
        "the gain d = {limit} {unit} is below the {value} {unit} that (17) requires",
        "value: the gain that (17) requires; limit: d",
    ),
    Premise.HELD: Statement(
        "torque held over a period",
        "≤",
        "r",
        "within one period the model's torque and the force change by {value} {unit} (at most {limit} {unit})",
        "change of (25) without its robust terms from one sample to the next, or to the mean force in between, in task "
        "space, while the torque is held; a quarter of ε and of K_s s, and the declared error of the force sensor, are "
        "reserved for it",
    ),
    Premise.LAYER: Statement(
        "robust terms, sampled",
        "<",
        "",
        "K_s and the boundary layer are too stiff for the control period: their factor is {value} (must be below 2); "
        "choose a wider layer, a smaller K_s, or a shorter control period",
        "(λ_max(K_s) + ¼ λ_min(K_s) + d/s_b) T / λ_min(H), with the d that is needed where all errors are zero, "
        "and without d/s_b where there is no layer; from 2 on one period can make s larger; infinite where M̂ minus its "
        "declared error is not positive definite, where d grows with ‖s‖ faster than η comes near 1 or than a period "
        "can take from s, or where K_s is so large that a period takes less from s than (19) counts on",
        unknown="the robust terms are too strong for the control period, or M̂ minus its declared error is not positive "
        "definite: there is no ‖s‖ from which on a period takes from s what (19) counts on",
    ),
    Premise.GAIN_BY_CHATTER: Statement(
        "d fed back by chattering",
        "<",
        "",
        "the gain (17) runs away: chattering in ė_r raises d by {value} of itself each period (must be below 1)",
        "(δ_H ‖M_m⁻¹B_m + A‖ + k_q̇) T / λ_min(H): d by (17) grows with r̈_eq, which chatters with ė_r, and by k_q̇ with "
        "q̇, through the bounds of friction and of Ĉ",
    ),
    Premise.GAIN_BY_FORCE: Statement(
        "d fed back by the force",
        "<",
        "",
        "the gain (17) and the contact force raise each other: {value} of each change comes back (must be below 1)",
        "against a rigid or heavy surface the force depends on the torque, and d by (17) depends on the force; below 1 "
        "this loop has exactly one solution, at any control period",
    ),
    Premise.FORCE_LOOP: Statement(
        "force loop, sampled",
        "<",
        "",
        "the sampled force loop diverges: its factor is {value} (must be below 1); choose a larger M_m along the "
        "normal, or an ideal reading of the sensor",
        "factor by which one sample multiplies an error of the fed-back force, plus the part that d by (17) adds",
    ),
    Premise.SAMPLED_LOOP: Statement(
        "closed loop, sampled",
        "<",
        "",
        "the sampled loop is unstable: each control period multiplies a deviation by {value} (must be below 1); choose "
        "{ways}",
        "largest growth of a small deviation over one control period with the torque held, for the present model and "
        "posture, on each choice of elastic surfaces that may be left, with Coulomb friction in the worst direction of "
        "slip; under the discontinuous law that of the motion on s = 0; infinite (not known) where the reading of a "
        "contact's force is late by more than 100 periods, or the loop has no linearisation",
        unknown="whether the sampled loop is stable is not known: the force sensor is late by more than 100 control "
        "periods, or the loop has no linearisation here; choose a smaller delay, or another posture",
    ),
    Premise.CONTACT: Statement(
        "contact kept, no impact",
        "≤",
        "",
        "contact with a rigid surface is missing, or a surface with a mass has just been met ({value} surfaces)",
        "number of rigid surfaces that the tool did not touch in the period before, and of surfaces with a mass that "
        "it has just met; (39) assumes contact, and an impact is a force without a bound",
        counts=True,
    ),
}
