"""Scenario: one frozen tree that says everything about a run.

Every field has its bounds, unit and meaning beside it; `app.scenario.field_info` gives them to the page and the
documentation.
Lengths of vectors depend on the robot and are checked where the objects are built (`app.simulation.assembly`).
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from app.scenario.contact_sections import (
    ContactSection,
    CouplingSection,
    FaceSection,
    FurtherSurface,
    SurfaceInWorld,
)
from controllers.laws import KINDS
from controllers.modes import IN_JOINTS, ModeName
from controllers.switching import SwitchingName
from environments.force_profiles.step import ConstantForce
from environments.force_profiles.table import AnyForceProfile
from environments.integrators import IntegratorName
from environments.sensors import Sensor
from environments.surfaces.plane import Plane
from environments.surfaces.table import AnyForm
from environments.trajectories.point_to_point import Hold
from environments.trajectories.table import AnyRotation, AnyTrajectory
from parameters import Matrix, Name, Section, Text, Vector, Vector3, Widget, decades, field

Offset = Annotated[float, Meta(ge=-10, le=10)]  # m along an axis: no mass of an arm is farther off
Offset3 = tuple[Offset, Offset, Offset]
Offsets = Annotated[tuple[Offset | Annotated[tuple[Offset, ...], Meta(max_length=32)], ...], Meta(max_length=32)]


class RobotSection(Section, frozen=True, forbid_unknown_fields=True):
    """The arm."""

    name: Annotated[Name, field("arm of the catalogue, as `vsmrc list` names it", "", title="robot")] = "ur5"
    urdf: Annotated[Text | None, field("path of a URDF to use instead", "", title="URDF")] = None
    tool_frame: Annotated[
        Name | None, field("frame of the tool; default: the catalogue's, or the last one of the arm", "")
    ] = None
    tool_offset: Annotated[Offset3 | None, field("tool point in the tool frame", "m")] = None
    posture: Annotated[
        Vector | None,
        field(
            "joint angles at the start; default: the catalogue's, or one far from singular",
            "rad",
            title="posture at the start",
            of="joints",
        ),
    ] = None
    rotor_inertia: Annotated[Vector | None, field("reflected rotor inertia per joint", "kg·m²", of="joints")] = None


class TruthSection(Section, frozen=True, forbid_unknown_fields=True):
    """Differences of the true arm from the controller's model."""

    link_scaling: Annotated[
        float | Vector,
        field("factor on every link's mass and inertia, or one per link", "1", title="mass of the true links, factor"),
    ] = 1.0
    rotor_scaling: Annotated[float | Vector, field("factor on every joint's rotor inertia, or one each", "1")] = 1.0
    link_centre: Annotated[
        Offsets, field("shift of every link's centre of mass along its axes, or one row of three per link", "m")
    ] = (0.0, 0.0, 0.0)
    link_shape: Annotated[
        Matrix,
        field(
            "change Z of every link's inertia I about its centre of mass, to I^½(1 + Z)I^½, as xx, yy, zz, xy, xz, yz "
            "along its axes, or one row of six per link",
            "1",
            title="change of the links' inertias about their centres (true arm)",
        ),
    ] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    payload_mass: Annotated[float, field("point mass at the tool", "kg", ge=0, le=50, title="payload")] = 0.0
    payload_offset: Annotated[
        Offset3, field("place of that mass in the tool frame", "m", title="place of the payload in the tool frame")
    ] = (0.0, 0.0, 0.0)
    coulomb: Annotated[
        float, field("Coulomb friction per joint", "N·m", ge=0, le=100, title="friction in the joints", of="joints")
    ] = 0.0
    viscous: Annotated[float, field("viscous friction per joint", "N·m·s/rad", of="joints", ge=0, le=100)] = 0.0
    disturbance: Annotated[
        float, field("norm of a sinusoidal torque that disturbs the joints", "N·m", of="joints", ge=0, le=200)
    ] = 0.0
    disturbance_frequency: Annotated[
        float, field("frequency of that torque", "Hz", ge=0, le=100, title="frequency of the disturbance")
    ] = 0.5
    torque_limit: Annotated[
        float | Vector,
        field("largest torque of the drives: a factor on the URDF's limits, 0 for none, or N·m (N) per joint", "1"),
    ] = 0.0
    push: Annotated[Vector3, field("a force on the tool, world axes", "N", Widget("x, y, z"))] = (0.0, 0.0, 0.0)
    push_moment: Annotated[Vector3, field("a moment on the tool, world axes", "N·m", Widget("moment x, y, z"))] = (
        0.0,
        0.0,
        0.0,
    )
    push_start: Annotated[
        float, field("start of the push", "s", Widget("from t ="), ge=0, le=36000, title="start of the push")
    ] = 1.0
    push_duration: Annotated[
        float,
        field("duration of the push", "s", decades("lasts", 0.05, 5), ge=0, le=36000, title="duration of the push"),
    ] = 1.0
    push_every: Annotated[
        float,
        field(
            "time until the push comes again, 0 for never; no pause if the push lasts longer",
            "s",
            decades("again every", 0.5, 20, zero=True),
            ge=0,
            le=36000,
            title="time until the push comes again",
        ),
    ] = 0.0
    push_frequency: Annotated[
        float,
        field(
            "frequency of a sinusoidal push with the amplitudes `push` and `push_moment`; 0 for a constant push",
            "Hz",
            decades("sine at", 0.1, 50, zero=True),
            ge=0,
            le=500,
            title="frequency of the push",
        ),
    ] = 0.0
    push_sweep_to: Annotated[
        float,
        field(
            "frequency to which a sinusoidal push sweeps while it lasts (a chirp); 0 for a constant frequency",
            "Hz",
            decades("sweeps to", 0.1, 100, zero=True),
            ge=0,
            le=500,
        ),
    ] = 0.0


StatedBound = Annotated[float, Meta(ge=0, le=1e6)] | Text | None

# names of the variables of each bound that may be stated, and an example
STATED_IN = {
    "delta_M": (("away",), "0.2 + 0.1*away"),
    "delta_C": (("speed", "away"), "0.5*speed"),
    "delta_G": (("away",), "4 + 2*away"),
    "delta_f": (("speed", "t"), "1 + 0.3*speed"),
}


class Declared(Section, frozen=True, forbid_unknown_fields=True):
    """Bounds of the modelling errors that the controller is told, (6)."""

    link_scaling: Annotated[
        float, field("links' masses and inertias within 1 ± this", "1", ge=0, lt=1, title="links 1 ± (declared)")
    ] = 0.0
    rotor_scaling: Annotated[
        float, field("rotors' inertias within 1 ± this", "1", ge=0, lt=1, title="rotors 1 ± (declared)")
    ] = 0.0
    link_centre: Annotated[
        float, field("largest distance of a link's centre of mass from its believed place", "m", ge=0, le=1)
    ] = 0.0
    link_shape: Annotated[
        float,
        field(
            "links' inertias about their centres of mass within 1 ± this of the scaled ones, s.p.d.", "1", ge=0, lt=1
        ),
    ] = 0.0
    payload_mass: Annotated[float, field("largest payload", "kg", ge=0, le=50)] = 0.0
    payload_offset: Annotated[
        float,
        field(
            "largest distance of the payload from the tool point",
            "m",
            ge=0,
            le=1,
            title="largest distance of the payload from the tool point (declared)",
        ),
    ] = 0.0
    coulomb: Annotated[float, field("largest Coulomb friction per joint", "N·m", of="joints", ge=0, le=100)] = 0.0
    viscous: Annotated[float, field("largest viscous friction per joint", "N·m·s/rad", of="joints", ge=0, le=100)] = 0.0
    disturbance: Annotated[float, field("largest norm of the disturbance torque", "N·m", of="joints", ge=0, le=200)] = (
        0.0
    )
    force_error: Annotated[float, field("largest error of the force sensor", "N", ge=0, le=100)] = 0.0
    moment_error: Annotated[
        float,
        field(
            "largest error of the sensor's moments",
            "N·m",
            ge=0,
            le=10,
            title="largest error of the sensor's moments (declared)",
        ),
    ] = 0.0
    delta_M: Annotated[
        StatedBound,
        field(
            "bound of ‖ΔM‖; replaces that of links, rotors, payload: a number or formula in away = ‖q − q(0)‖",
            "kg·m²",
            of="joints",
        ),
    ] = None
    delta_C: Annotated[
        StatedBound,
        field(
            "bound of ‖ΔC‖; replaces that of links, payload: a number or formula in away, speed = ‖q̇‖",
            "kg·m²/s",
            of="joints",
        ),
    ] = None
    delta_G: Annotated[
        StatedBound,
        field("bound of ‖ΔG‖; replaces that of links, payload: a number or formula in away", "N·m", of="joints"),
    ] = None
    delta_f: Annotated[
        StatedBound,
        field(
            "bound of ‖f̃‖; replaces that of friction, disturbance: a number or formula in speed, t", "N·m", of="joints"
        ),
    ] = None
    least_inertia: Annotated[
        float,
        field(
            "where δ_M is stated: M is at least this share of M̂, for k_r′",
            "1",
            gt=0,
            le=1,
            title="least share c with M ≥ c M̂ (declared)",
        ),
    ] = 0.5


class TaskSpaceSection(Section, frozen=True, forbid_unknown_fields=True):
    """The task coordinates r."""

    kind: Annotated[
        Literal["cartesian", "joint"],
        field(f"r from the tool's pose, or r = q ({' or '.join(IN_JOINTS)} mode only)", ""),
    ] = "cartesian"
    characteristic_length: Annotated[
        float, field("characteristic length: turns radians into metres, since r contains ℓ·angle", "m", ge=0.001, le=10)
    ] = 0.15
    axes: Annotated[
        Vector3, field("rotation vector of Cartesian coordinates against the world", "rad", Widget("axes turned by"))
    ] = (0.0, 0.0, 0.0)
    supplemental: Annotated[
        tuple[int, ...] | None,
        field("joints, counted from 1, that are coordinates themselves (Remark 5); default: the arm's, if any", ""),
    ] = None


class TargetModelSection(Section, frozen=True, forbid_unknown_fields=True):
    """Target model (8); each matrix as n diagonal entries or n rows; a missing one takes the mode's default."""

    M_m: Annotated[Matrix | None, field("inertia of the target model (8)", "kg", of="r")] = None
    B_m: Annotated[Matrix | None, field("damping of the target model (8)", "N·s/m", of="r")] = None
    K_m: Annotated[Matrix | None, field("stiffness of the target model (8)", "N/m", of="r")] = None
    K_f: Annotated[Matrix | None, field("weight of the force error in the target model (8)", "1")] = None


class BlendSection(Section, frozen=True, forbid_unknown_fields=True):
    """Convex blend from `target_model` to another one in the course of the run; none while `to` has no matrix."""

    to: Annotated[TargetModelSection, field("the model at its end; a missing matrix is that of target_model", "")] = (
        msgspec.field(default_factory=TargetModelSection)
    )
    at: Annotated[float, field("start of the blend", "s", ge=0, le=36000)] = 0.0
    over: Annotated[float, field("duration of the blend", "s", gt=0, le=3600)] = 2.0

    @property
    def planned(self) -> bool:
        return self.to != TargetModelSection()


class ControllerSection(Section, frozen=True, forbid_unknown_fields=True):
    """The control law (25)."""

    law: Annotated[
        Name,
        field(
            f"{', '.join(KINDS)}; or a law of your own file",
            "",
            title="control law",
        ),
    ] = "vsmrc"
    own: Annotated[
        dict[Name, dict[Name, float]] | None, field("parameters of laws of your own, by law and name", "")
    ] = None
    A: Annotated[Matrix | float, field("rate of the compensator (9): diagonal, ≤ 0", "1/s")] = 0.0
    F_1: Annotated[Matrix | float, field("sliding gain on e_r (10): diagonal", "1/s", title="sliding gain F_1")] = 10.0
    F_2: Annotated[Matrix | float, field("sliding gain on z (10): diagonal, nonsingular", "1")] = 1.0
    K_s: Annotated[
        Matrix | float,
        field("gain of the linear reaching term (15), s.p.d.", "N·s/m", of="r", title="reaching gain K_s"),
    ] = 100.0
    gain: Annotated[
        Literal["theorem", "constant"], field("gain d: what (17) requires (theorem), or the number d (constant)", "")
    ] = "theorem"
    d: Annotated[float, field("the constant d", "N", of="r", gt=0, le=1e5)] = 30.0
    epsilon: Annotated[float, field("margin of the gain d in (17)", "N", of="r", gt=0, le=1e4)] = 2.0
    bounds: Annotated[
        Literal["tight", "paper"], field("error bounds: computed in task space (tight), or by (7)", "")
    ] = "tight"
    switching: Annotated[SwitchingName, field("s/||s||, or a smooth version of it", "", title="switching function")] = (
        "saturation"
    )
    layer: Annotated[float, field("boundary layer: within it the switching is smooth", "m/s", of="r", gt=0, le=10)] = (
        0.01
    )
    z_0: Annotated[
        Vector | None, field("z at the start; only with on_change = watch; default: zeros", "m/s", of="r")
    ] = None
    on_change: Annotated[
        Literal["remove", "watch"],
        field("z at the start and on changes: set so that s = 0 (remove, Remark 2), or kept (watch)", ""),
    ] = "remove"
    estimates: Annotated[
        Literal["online", "along-reference"],
        field("estimates of M, C, G: at q (online), or in advance along r_d (along-reference, Remark 3)", ""),
    ] = "online"
    period: Annotated[float, field("control period", "s", ge=1e-5, le=0.05)] = 0.001
    K_e_hat: Annotated[
        float, field("estimated stiffness of the surface (33)", "N/m", gt=0, le=1e9, title="believed stiffness")
    ] = 10000.0


class ShiftSection(Section, frozen=True, forbid_unknown_fields=True):
    """Shift of the desired motion as a whole; a change is made smoothly, so that r_d keeps two derivatives."""

    by: Annotated[Vector, field("shift along x, y, z or the tangents", "m", of="r")] = (0.0,)
    duration: Annotated[
        float, field("duration of the shift; from the start or the change on", "s", ge=0.001, le=60)
    ] = 1.0


class Simulation(Section, frozen=True, forbid_unknown_fields=True):
    """Computation of the run, and its end."""

    duration: Annotated[
        float, field("simulated time of a run without the page; Ω is for the reference within it", "s", gt=0, le=36000)
    ] = 10.0
    seed: Annotated[
        int, field("seed of the sensor's noise", "", ge=0, le=2**63 - 1, title="seed of the sensor's noise")
    ] = 0
    integrator: Annotated[IntegratorName, field("integrator of the plant", "")] = "leapfrog"
    substeps: Annotated[
        int, field("integration steps per control period", "", ge=1, le=1000, title="steps per period")
    ] = 1
    domain_radius: Annotated[
        float,
        field(
            "radius of Omega: distance of its postures from the reference",
            "rad",
            of="joints",
            gt=0,
            le=3,
            title="radius of Ω",
        ),
    ] = 0.15
    sigma_min: Annotated[
        float, field("J_q counts as singular below this singular value", "m", of="J_q", ge=0, le=1)
    ] = 0.01
    leaving_domain: Annotated[
        Literal["stop", "flag"],
        field(
            "on a singular J_q, joints over 20 rad/s (m/s), or a lost rigid surface: stop or flag",
            "",
            title="on a failure (singular J_q, too fast, contact lost)",
        ),
    ] = "stop"
    bound_violation: Annotated[
        Literal["stop", "flag"], field("when ||s|| is over (20) and its band: stop or flag", "")
    ] = "flag"


class Scenario(Struct, frozen=True, forbid_unknown_fields=True):
    """Scenario of one run: all its sections."""

    name: Name = "unnamed"
    title: Name = ""
    mode: Annotated[ModeName, field("mode: what is controlled, one of the applications of section IV", "")] = "motion"
    robot: RobotSection = msgspec.field(default_factory=RobotSection)
    truth: TruthSection = msgspec.field(default_factory=TruthSection)
    declared: Declared = msgspec.field(default_factory=Declared)
    task_space: TaskSpaceSection = msgspec.field(default_factory=TaskSpaceSection)
    target_model: TargetModelSection = msgspec.field(default_factory=TargetModelSection)
    blend: BlendSection = msgspec.field(default_factory=BlendSection)
    controller: ControllerSection = msgspec.field(default_factory=ControllerSection)
    surface: AnyForm = msgspec.field(default_factory=Plane)
    contact: ContactSection = msgspec.field(default_factory=ContactSection)
    sensor: Sensor = msgspec.field(default_factory=Sensor)
    motion: Annotated[AnyTrajectory, msgspec.Meta(extra={"of": "r"})] = msgspec.field(default_factory=Hold)
    rotation: Annotated[AnyRotation, msgspec.Meta(extra={"metre": "rad"})] = msgspec.field(default_factory=Hold)
    shift: ShiftSection = msgspec.field(default_factory=ShiftSection)
    force: AnyForceProfile = msgspec.field(default_factory=ConstantForce)
    second: FurtherSurface = msgspec.field(default_factory=FurtherSurface)
    third: FurtherSurface = msgspec.field(default_factory=FurtherSurface)
    coupling: CouplingSection = msgspec.field(default_factory=CouplingSection)
    face: FaceSection = msgspec.field(default_factory=FaceSection)
    simulation: Simulation = msgspec.field(default_factory=Simulation)

    @property
    def surfaces(self) -> tuple[SurfaceInWorld, ...]:
        """The surfaces in the world, the first one first, whether or not the tool touches it."""
        first = SurfaceInWorld("", 0, self.surface, self.contact, self.controller.K_e_hat, self.force, pressed=True)
        further = (("second.", self.second), ("third.", self.third))
        return first, *(
            SurfaceInWorld(
                path, index, each.surface, each.contact, each.K_e_hat, each.force, pressed=each.control == "force"
            )
            for index, (path, each) in enumerate(further, start=1)
            if each.present
        )


def after_blend(scenario: Scenario) -> Scenario:
    """The scenario once its blend has ended: with the blend's last target model, and no further blend."""
    to = {name: matrix for name, matrix in msgspec.structs.asdict(scenario.blend.to).items() if matrix is not None}
    model = msgspec.structs.replace(scenario.target_model, **to)
    return msgspec.structs.replace(scenario, target_model=model, blend=BlendSection())
