"""Scenario: one frozen tree that says everything about a run.

Every field has its bounds, unit and meaning beside it; `field_info` hands them to the screen and the documentation.
Lengths of vectors depend on the robot and are checked where the objects are built (`app.simulation.system`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, cast

import msgspec
from msgspec import Meta, Struct, field

_ONE_LINE = r"^[^\x00-\x1f\x7f-\x9f\u2028\u2029\ufffe\uffff]*\Z"  # an SVG cannot hold the others, a terminal obeys them
Name = Annotated[str, Meta(max_length=200, pattern=_ONE_LINE)]  # it stands on the page
Text = Annotated[str, Meta(max_length=1000, pattern=_ONE_LINE)]  # a path; a formula has at most 500 characters
Vector = Annotated[tuple[float, ...], Meta(max_length=32)]  # an arm has at most eight joints
Vector3 = tuple[float, float, float]
Matrix = Annotated[tuple[float | Vector, ...], Meta(max_length=32)]


class ScenarioError(ValueError):
    """A scenario that cannot be used: one sentence with the field's path, its value and what is allowed."""


def _number(doc: str, unit: str, **bounds: Any) -> Meta:
    return Meta(description=doc, extra={"unit": unit}, **bounds)


class _Section(Struct, frozen=True, forbid_unknown_fields=True):
    """A table of the TOML file."""


class Robot(_Section, frozen=True, forbid_unknown_fields=True):
    """The arm."""

    name: Annotated[Name, _number("row of the catalogue", "")] = "ur5"
    urdf: Annotated[Text | None, _number("any URDF instead, by path", "")] = None
    tool_frame: Annotated[
        Name | None, _number("frame of the tool; default: the catalogue's, or the last one of the arm", "")
    ] = None
    tool_offset: Annotated[Vector3 | None, _number("tool point in the tool frame", "m")] = None
    posture: Annotated[
        Vector | None, _number("joint angles at the start; default: the catalogue's, or one far from singular", "rad")
    ] = None
    rotor_inertia: Annotated[Vector | None, _number("reflected rotor inertia per joint", "kg·m²")] = None


class Truth(_Section, frozen=True, forbid_unknown_fields=True):
    """How the true arm differs from what the controller believes."""

    link_scaling: Annotated[float | Vector, _number("factor on the inertia of every link, or one per link", "1")] = 1.0
    payload_mass: Annotated[float, _number("point mass at the tool", "kg", ge=0, le=50)] = 0.0
    payload_offset: Annotated[Vector3, _number("place of that mass in the tool frame", "m")] = (0.0, 0.0, 0.0)
    coulomb: Annotated[float, _number("Coulomb friction per joint", "N·m", ge=0, le=100)] = 0.0
    viscous: Annotated[float, _number("viscous friction per joint", "N·m·s/rad", ge=0, le=100)] = 0.0
    disturbance: Annotated[float, _number("norm of a disturbance torque", "N·m", ge=0, le=200)] = 0.0
    disturbance_frequency: Annotated[float, _number("its frequency", "Hz", ge=0, le=100)] = 0.5
    torque_limit: Annotated[
        float | Vector,
        _number("what the drives give at most: a factor on the URDF's limits, 0 for no limit, or N·m per joint", "1"),
    ] = 0.0
    push: Annotated[Vector3, _number("a force on the tool, world axes", "N")] = (0.0, 0.0, 0.0)
    push_start: Annotated[float, _number("when it begins", "s", ge=0, le=36000)] = 1.0
    push_duration: Annotated[float, _number("how long it acts", "s", ge=0, le=36000)] = 1.0


class Declared(_Section, frozen=True, forbid_unknown_fields=True):
    """The bounds of the modelling errors that the controller is told, (6)."""

    link_scaling: Annotated[float, _number("links' inertias within 1 ± this", "1", ge=0, lt=1)] = 0.0
    payload_mass: Annotated[float, _number("largest payload", "kg", ge=0, le=50)] = 0.0
    payload_offset: Annotated[float, _number("its largest distance from the tool point", "m", ge=0, le=1)] = 0.0
    coulomb: Annotated[float, _number("largest Coulomb friction per joint", "N·m", ge=0, le=100)] = 0.0
    viscous: Annotated[float, _number("largest viscous friction per joint", "N·m·s/rad", ge=0, le=100)] = 0.0
    disturbance: Annotated[float, _number("largest norm of the disturbance torque", "N·m", ge=0, le=200)] = 0.0
    force_error: Annotated[float, _number("largest error of the force sensor", "N", ge=0, le=100)] = 0.0


class TaskSpace(_Section, frozen=True, forbid_unknown_fields=True):
    """The task coordinates r."""

    kind: Annotated[
        Literal["cartesian", "joint"], _number("r from the tool's pose, or r = q (motion mode only)", "")
    ] = "cartesian"
    characteristic_length: Annotated[float, _number("makes radians metres: r holds l·angle", "m", gt=0, le=10)] = 0.15


class TargetModel(_Section, frozen=True, forbid_unknown_fields=True):
    """(8); each matrix as n diagonal entries or n rows; a missing one takes the mode's default."""

    M_m: Annotated[Matrix | None, _number("inertia", "kg")] = None
    B_m: Annotated[Matrix | None, _number("damping", "N·s/m")] = None
    K_m: Annotated[Matrix | None, _number("stiffness", "N/m")] = None
    K_f: Annotated[Matrix | None, _number("weight of the force error", "1")] = None


class Blend(_Section, frozen=True, forbid_unknown_fields=True):
    """A convex blend from `target_model` to another one in the course of the run; none while `to` has no matrix."""

    to: Annotated[TargetModel, _number("the model at its end; a missing matrix is that of target_model", "")] = field(
        default_factory=TargetModel
    )
    at: Annotated[float, _number("when it begins", "s", ge=0, le=36000)] = 0.0
    over: Annotated[float, _number("how long it takes", "s", gt=0, le=3600)] = 2.0

    @property
    def planned(self) -> bool:
        return self.to != TargetModel()


class Controller(_Section, frozen=True, forbid_unknown_fields=True):
    """The control law (25)."""

    law: Annotated[
        Name,
        _number(
            "vsmrc, the paper's; without a robust term: computed-torque, pd-gravity; or of a file of one's own", ""
        ),
    ] = "vsmrc"
    own: Annotated[
        dict[Name, dict[Name, float]] | None, _number("parameters of laws of your own, by law and name", "")
    ] = None
    A: Annotated[Matrix | float, _number("compensator (9): diagonal, <= 0", "1/s")] = 0.0
    F_1: Annotated[Matrix | float, _number("sliding gain on e_r (10): diagonal", "1/s")] = 10.0
    F_2: Annotated[Matrix | float, _number("sliding gain on z (10): diagonal, nonsingular", "1")] = 1.0
    K_s: Annotated[Matrix | float, _number("linear reaching gain (15), s.p.d.", "N·s/m")] = 100.0
    gain: Annotated[Literal["theorem", "constant"], _number("d by (17), or a constant", "")] = "theorem"
    d: Annotated[float, _number("the constant d", "N", gt=0, le=1e5)] = 30.0
    epsilon: Annotated[float, _number("margin in (17)", "N", gt=0, le=1e4)] = 2.0
    bounds: Annotated[Literal["tight", "paper"], _number("error bounds in task space, or as in (7)", "")] = "tight"
    switching: Annotated[
        Literal["discontinuous", "saturation", "rational", "tanh"], _number("s/||s||, or a smooth version of it", "")
    ] = "saturation"
    layer: Annotated[float, _number("boundary layer", "m/s", gt=0, le=10)] = 0.01
    on_change: Annotated[
        Literal["remove", "watch"],
        _number("z at the start and on changes: s = 0 (Remark 2), or kept, s is reached", ""),
    ] = "remove"
    estimates: Annotated[
        Literal["online", "along-reference"], _number("M, C, G at q, or beforehand along r_d (Remark 3)", "")
    ] = "online"
    period: Annotated[float, _number("control period", "s", ge=1e-5, le=0.05)] = 0.001
    K_e_hat: Annotated[float, _number("estimated stiffness of the surface (33)", "N/m", gt=0, le=1e9)] = 10000.0


class SurfaceMotion(_Section, frozen=True, forbid_unknown_fields=True):
    """Translation by a sinusoid."""

    direction: Annotated[Vector3, _number("direction of the movement", "1")] = (0.0, 0.0, 1.0)
    amplitude: Annotated[float, _number("amplitude", "m", ge=0, le=1)] = 0.0
    frequency: Annotated[float, _number("frequency", "Hz", ge=0, le=20)] = 0.5


class Plane(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="plane"):
    """A plane."""

    origin: Annotated[Vector3, _number("a point of it", "m")] = (0.0, 0.0, 0.0)
    normal: Annotated[Vector3, _number("direction into the environment", "1")] = (0.0, 0.0, -1.0)
    motion: SurfaceMotion = field(default_factory=SurfaceMotion)


class Cylinder(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="cylinder"):
    """A cylinder."""

    origin: Annotated[Vector3, _number("a point of its axis", "m")] = (0.0, 0.0, 0.0)
    axis: Annotated[Vector3, _number("direction of its axis", "1")] = (0.0, 1.0, 0.0)
    reference: Annotated[Vector3, _number("direction from the axis where psi_1 = 0", "1")] = (0.0, 0.0, 1.0)
    radius: Annotated[float, _number("radius", "m", gt=0, le=100)] = 0.3
    side: Annotated[Literal["outside", "inside"], _number("where the tool is", "")] = "outside"
    motion: SurfaceMotion = field(default_factory=SurfaceMotion)


class Sphere(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="sphere"):
    """A sphere."""

    origin: Annotated[Vector3, _number("its centre", "m")] = (0.0, 0.0, 0.0)
    reference: Annotated[Vector3, _number("direction from the centre where psi = 0", "1")] = (0.0, 0.0, 1.0)
    radius: Annotated[float, _number("radius", "m", gt=0, le=100)] = 0.3
    side: Annotated[Literal["outside", "inside"], _number("where the tool is", "")] = "outside"
    motion: SurfaceMotion = field(default_factory=SurfaceMotion)


class Formula(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="formula"):
    """A surface typed as a formula that is 0 on it."""

    text: Annotated[Text, _number("of x, y, z (m from the origin) and t (s): 0 on the surface", "")] = (
        "z - 0.02*sin(8*x - 2*t)"
    )
    solid: Annotated[
        Literal["below", "above"], _number("solid where the formula is below 0, or where it is above", "")
    ] = "below"
    origin: Annotated[Vector3, _number("where x, y, z are 0", "m")] = (0.0, 0.0, 0.0)
    normal: Annotated[Vector3, _number("direction across the surface; psi_1, psi_2 run across it", "1")] = (
        0.0, 0.0, -1.0,
    )  # fmt: skip
    motion: SurfaceMotion = field(default_factory=SurfaceMotion)


class Contact(_Section, frozen=True, forbid_unknown_fields=True):
    """What the tool meets at the surface."""

    kind: Annotated[
        Literal["free", "elastic", "mass-damper-spring", "rigid"], _number("nothing, (32), (28), or (39)", "")
    ] = "free"
    K_e: Annotated[float, _number("stiffness", "N/m", ge=0, le=1e7)] = 10000.0
    B_e: Annotated[float, _number("damping", "N·s/m", ge=0, le=1e5)] = 0.0
    M_e: Annotated[float, _number("mass", "kg", ge=0, le=1e4)] = 0.0
    unilateral: Annotated[bool, _number("pushes only, as real surfaces do", "")] = True
    friction_coulomb: Annotated[float, _number("friction coefficient", "1", ge=0, le=2)] = 0.0
    friction_viscous: Annotated[float, _number("viscous friction along the surface", "N·s/m", ge=0, le=1e4)] = 0.0


class Sensor(_Section, frozen=True, forbid_unknown_fields=True):
    """The force sensor."""

    noise: Annotated[float, _number("standard deviation per axis", "N", ge=0, le=100)] = 0.0
    bias: Annotated[Vector3, _number("bias", "N")] = (0.0, 0.0, 0.0)
    delay: Annotated[float, _number("delay", "s", ge=0, le=1)] = 0.0
    cutoff: Annotated[float, _number("first-order low-pass, 0 for none", "Hz", ge=0, le=1e5)] = 0.0
    ideal: Annotated[
        bool, _number("rigid or heavy surfaces: the loop through the multiplier is solved, not sampled", "")
    ] = False


class Hold(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="hold"):
    """Stay where it starts."""


class PointToPoint(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="point-to-point"):
    """A minimum-jerk move of the position coordinates."""

    displacement: Annotated[Vector, _number("by how much, along x, y, z or the tangents", "m")] = (0.1,)
    duration: Annotated[float, _number("duration", "s", gt=0, le=3600)] = 2.0


class Circle(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="circle"):
    """A circle in two of the position coordinates, through the start."""

    radius: Annotated[float, _number("radius", "m", ge=0, le=2)] = 0.05
    period: Annotated[float, _number("time of one turn", "s", gt=0, le=3600)] = 4.0
    ramp: Annotated[float, _number("time to full speed", "s", ge=0, le=3600)] = 1.0
    axes: Annotated[tuple[int, int], _number("which two coordinates, counted from 0", "")] = (0, 1)


class Line(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="line"):
    """Back and forth along a line of the position coordinates."""

    displacement: Annotated[Vector, _number("to the far end", "m")] = (0.1,)
    period: Annotated[float, _number("time there and back", "s", gt=0, le=3600)] = 4.0
    ramp: Annotated[float, _number("time to full speed", "s", ge=0, le=3600)] = 1.0


class Shift(_Section, frozen=True, forbid_unknown_fields=True):
    """The desired motion moved as a whole; a change is made smoothly, so that r_d keeps two derivatives."""

    by: Annotated[Vector, _number("by how much, along x, y, z or the tangents", "m")] = (0.0,)
    duration: Annotated[
        float, _number("time that the move takes, from the start or the change on", "s", gt=0, le=60)
    ] = 1.0


class ConstantForce(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="constant"):
    """A constant desired normal force."""

    value: Annotated[float, _number("desired force", "N", ge=-1e4, le=1e4)] = 20.0


class ForceStep(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="step"):
    """A step of the desired normal force, smooth within `rise` so that it has two derivatives."""

    value: Annotated[float, _number("force after the step", "N", ge=-1e4, le=1e4)] = 20.0
    start: Annotated[float, _number("force before it", "N", ge=-1e4, le=1e4)] = 10.0
    time: Annotated[float, _number("when", "s", ge=0, le=3600)] = 2.0
    rise: Annotated[float, _number("how long it takes", "s", gt=0, le=3600)] = 0.2


class ForceSinusoid(_Section, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="sinusoid"):
    """A sinusoidal desired normal force."""

    value: Annotated[float, _number("mean force", "N", ge=-1e4, le=1e4)] = 20.0
    amplitude: Annotated[float, _number("amplitude", "N", ge=0, le=1e4)] = 5.0
    frequency: Annotated[float, _number("frequency", "Hz", ge=0, le=50)] = 0.5


class Simulation(_Section, frozen=True, forbid_unknown_fields=True):
    """How the run is computed and when it ends."""

    duration: Annotated[float, _number("simulated time of a headless run", "s", gt=0, le=36000)] = 10.0
    seed: Annotated[int, _number("of the sensor's noise", "", ge=0, le=2**63 - 1)] = 0
    integrator: Annotated[Literal["leapfrog", "semi-implicit-euler", "rk4"], _number("of the plant", "")] = "leapfrog"
    substeps: Annotated[int, _number("plant steps in a control period", "", ge=1, le=1000)] = 1
    domain_radius: Annotated[float, _number("Omega: postures within this of the reference", "rad", gt=0, le=3)] = 0.15
    sigma_min: Annotated[float, _number("J_q counts as singular below this singular value", "m", ge=0, le=1)] = 0.01
    leaving_domain: Annotated[Literal["stop", "flag"], _number("singular J_q, or ||q_dot|| beyond 20 rad/s", "")] = (
        "stop"
    )
    bound_violation: Annotated[Literal["stop", "flag"], _number("||s|| over its envelope (20)", "")] = "flag"


class Scenario(Struct, frozen=True, forbid_unknown_fields=True):
    """One run, whole."""

    name: Name = "unnamed"
    title: Name = ""
    mode: Annotated[
        Literal["motion", "impedance", "hybrid", "hybrid-impedance", "constrained"],
        _number("which application of section IV", ""),
    ] = "motion"
    robot: Robot = field(default_factory=Robot)
    truth: Truth = field(default_factory=Truth)
    declared: Declared = field(default_factory=Declared)
    task_space: TaskSpace = field(default_factory=TaskSpace)
    target_model: TargetModel = field(default_factory=TargetModel)
    blend: Blend = field(default_factory=Blend)
    controller: Controller = field(default_factory=Controller)
    surface: Plane | Cylinder | Sphere | Formula = field(default_factory=Plane)
    contact: Contact = field(default_factory=Contact)
    sensor: Sensor = field(default_factory=Sensor)
    motion: Hold | PointToPoint | Circle | Line = field(default_factory=Hold)
    shift: Shift = field(default_factory=Shift)
    force: ConstantForce | ForceStep | ForceSinusoid = field(default_factory=ConstantForce)
    simulation: Simulation = field(default_factory=Simulation)


def after_blend(scenario: Scenario) -> Scenario:
    """The scenario once its blend has ended: with the target model that it led to, and none ahead."""
    to = {name: matrix for name, matrix in msgspec.structs.asdict(scenario.blend.to).items() if matrix is not None}
    model = msgspec.structs.replace(scenario.target_model, **to)
    return msgspec.structs.replace(scenario, target_model=model, blend=Blend())


@dataclass(frozen=True)
class FieldInfo:
    """What the screen and the documentation say of a field; bounds are None where there are none."""

    doc: str
    unit: str
    least: float | None
    largest: float | None
    choices: tuple[str, ...]


def field_info(path: str) -> FieldInfo:
    """The facts of the field at a dotted path; in a section of several kinds, of the first kind that has it."""
    candidates: list[type[Struct]] = [Scenario]
    *sections, last = path.split(".")
    for section in sections:
        candidates = [t for c in candidates for t in types_of(c, section)]
    for candidate in candidates:
        for f in _schema(candidate).fields:
            if f.name == last and isinstance(f.type, msgspec.inspect.Metadata):
                return _info(f.type)
    raise KeyError(path)


def _info(metadata: msgspec.inspect.Metadata) -> FieldInfo:
    inner: Any = metadata.type
    if isinstance(inner, msgspec.inspect.UnionType):
        inner = inner.types[0]
    low = [b for b in (getattr(inner, "ge", None), getattr(inner, "gt", None)) if b is not None]
    high = [b for b in (getattr(inner, "le", None), getattr(inner, "lt", None)) if b is not None]
    schema = metadata.extra_json_schema or {}
    return FieldInfo(
        doc=str(schema.get("description", "")),
        unit=str((metadata.extra or {}).get("unit", "")),
        least=float(low[0]) if low else None,
        largest=float(high[0]) if high else None,
        choices=tuple(getattr(inner, "values", ())),
    )


def types_of(struct: type[Struct], name: str) -> list[type[Struct]]:
    """The structs that a field may hold: one for a section, several for a section of several kinds, else none."""
    kind = next((f.type for f in _schema(struct).fields if f.name == name), None)
    kinds = kind.types if isinstance(kind, msgspec.inspect.UnionType) else [kind]
    return [k.cls for k in kinds if isinstance(k, msgspec.inspect.StructType)]


@cache
def _schema(struct: type[Struct]) -> msgspec.inspect.StructType:
    """What msgspec says of a struct; it translates all that lies below, which is worth doing once."""
    return cast(msgspec.inspect.StructType, msgspec.inspect.type_info(struct))
