"""Controller of a scenario, checked: its target model (8), the blend to another one, gains and declared bounds."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from app.scenario.errors import ScenarioError, scenario_errors
from app.scenario.own_code import own_code
from app.scenario.schema import Matrix, Scenario, TargetModelSection, after_blend
from app.simulation.builders.environment_builder import believed_matrix, environment_of
from app.simulation.omega.domain import Constants
from controllers import modes
from controllers.blend import CERTIFIED, BlendCertificate, ModelBlend, certify
from controllers.bounds import Uncertainty
from controllers.compensator import Compensator
from controllers.control_law import ControlLaw
from controllers.controller import Controller
from controllers.estimate_rates import LinkRates
from controllers.followed_faces import FollowedFaces
from controllers.laws.table import LAWS
from controllers.modes import Mode
from controllers.surface_stability import SurfaceRange, passive_throughout
from controllers.switching import SWITCHING
from controllers.target_model import InvalidGain, TargetModel
from controllers.task_space import TaskLayout
from environments.robots import Robot
from parameters import allowed, values_of


def laws() -> dict[str, ControlLaw]:
    """All laws by kind: those of the program, then those of the user's own files."""
    return LAWS | own_code().laws


def law_of(scenario: Scenario) -> ControlLaw:
    """Law of the scenario. Raises ScenarioError where there is none of its kind."""
    known, kind = laws(), scenario.controller.law
    if kind not in known:
        raise ScenarioError(
            f"controller.law: {kind!r:.60}; {allowed(kind, known)} (or that of a file of your own, by --use FILE of "
            "serve, run, compare, export and response)"
        )
    return known[kind]


def parameters_of(scenario: Scenario, law: ControlLaw) -> dict[str, float]:
    """Values of the law's own parameters, by name. Raises ScenarioError, also where the scenario has parameters of a
    law that there is not."""
    own, known = scenario.controller.own or {}, laws()
    if unknown := [kind for kind in own if kind not in known]:
        named = allowed(unknown[0], (kind for kind, each in known.items() if each.parameters))
        raise ScenarioError(
            f"controller.own.{unknown[0]:.60}: no such law; allowed: controller.own.<law>.<parameter> with a law of a "
            f"file that --use names; {named}"
        )
    with scenario_errors():
        return values_of(law.parameters, own.get(law.kind, {}), f"controller.own.{law.kind}")


def uncertainty_of(scenario: Scenario, robot: Robot, k_C: float, rates: LinkRates) -> Uncertainty:
    """Declared uncertainty of the true arm; k_C, rates: of the Coriolis forces, see `controllers.bounds`."""
    d = scenario.declared
    return Uncertainty(
        rho=d.link_scaling,
        rho_rotor=d.rotor_scaling,
        payload_mass=d.payload_mass,
        payload_offset=d.payload_offset,
        coulomb=d.coulomb,
        viscous=d.viscous,
        disturbance=d.disturbance,
        force_error=d.force_error,
        moment_error=d.moment_error,
        k_C=k_C,
        rho_centre=d.link_centre,
        rho_shape=d.link_shape,
        rates=rates,
        mass=float(sum(link.mass for link in list(robot.model.inertias)[1:])),
        least_inertia=d.least_inertia,
    )


def mode_of(scenario: Scenario) -> Mode:
    """Mode of the scenario among its surfaces."""
    surfaces = scenario.surfaces
    tilts = 2 if scenario.face.flat else 0
    return modes.MODES[scenario.mode].among(len(surfaces), sum(each.pressed for each in surfaces), tilts)


def believed_stiffness(scenario: Scenario) -> np.ndarray:
    """Estimated stiffness (m, m) N/m of the surfaces whose force is controlled, and of a flat tool's tilts, K_e_hat in
    (33), while the tool holds the other surfaces of the same body."""
    pressed = mode_of(scenario).pressed
    return _with_tilts(scenario, believed_matrix(scenario)[:pressed, :pressed], scenario.face.K_t_hat)


def believed_compliance(scenario: Scenario) -> np.ndarray:
    """Compliance (m, m) m/N of r_fd, (33), while the tool presses no other surface: inverse of `believed_stiffness`,
    unless there are others of the same body, which then yield, too."""
    mode, stiffness = mode_of(scenario), believed_stiffness(scenario)
    if followed_faces(scenario).sets:
        return np.linalg.inv(believed_matrix(scenario))[: mode.pressed, : mode.pressed]
    diagonal = np.diag(stiffness)
    return np.diag(1.0 / diagonal) if (stiffness == np.diag(diagonal)).all() else np.linalg.inv(stiffness)


def followed_faces(scenario: Scenario) -> FollowedFaces:
    """Faces whose distance is followed, of the body that the mode presses."""
    mode, surfaces = mode_of(scenario), scenario.surfaces
    if mode.rigid or not 0 < mode.pressed < len(surfaces):
        return FollowedFaces.none()
    unilateral = [each.contact.unilateral for each in surfaces]
    return FollowedFaces.of(believed_matrix(scenario), mode.pressed, unilateral)


def stiffness_met(scenario: Scenario) -> np.ndarray:
    """Estimated stiffness (m, m) N/m that the target model meets, or (k, k) where it has followed faces."""
    return believed_matrix(scenario) if followed_faces(scenario).sets else believed_stiffness(scenario)


def true_stiffness(scenario: Scenario) -> np.ndarray:
    """True stiffness (m, m) N/m in the same directions, K_e in (32)."""
    pressed = mode_of(scenario).pressed
    return _with_tilts(scenario, environment_of(scenario).K_e[:pressed, :pressed], scenario.face.K_t)


def _with_tilts(scenario: Scenario, stiffness: np.ndarray, K_t: float) -> np.ndarray:
    """The stiffness (k, k) with that of a flat tool's tilts, K_t N m/rad, converted to N/m of the coordinates l t."""
    mode, l = mode_of(scenario), scenario.task_space.characteristic_length
    return np.asarray(block_diag(stiffness, K_t / l**2 * np.eye(mode.force_directions - mode.pressed)))


def default_target_model(mode: Mode, n: int, K_e_hat: np.ndarray) -> dict[str, np.ndarray]:
    """Default diagonals of (8) for a mode: critically damped at 20 rad/s; softer where it meets forces. K_m1 = 0 in all
    modes that control a force, also where (38) has it s.p.d.: so (37) leaves no force error. K_e_hat: (m, m) N/m, of
    whose diagonal each coordinate takes its damping."""
    M = np.full(n, 10.0)
    K = np.full(n, mode.stiffness)
    B = 2.0 * np.sqrt(K * M)
    m = mode.force_directions
    K[:m] = 0.0
    if mode.rigid:
        M[:m], B[:m] = 15.0, 100.0
    else:
        B[:m] = 2.0 * np.sqrt(np.diag(K_e_hat) * M[:m])
    return {"M_m": M, "B_m": B, "K_m": K, "K_f": mode.controlled(n)}


def square(path: str, value: Matrix | float, n: int) -> np.ndarray:
    """A field's matrix (n, n), given as one number, n diagonal entries or n rows. Raises ScenarioError."""
    if isinstance(value, int | float):
        return np.eye(n) * value
    rows = [np.atleast_1d(np.array(row, dtype=float)) for row in value]
    shape = f"{len(rows)} entries" if all(len(r) == 1 for r in rows) else f"rows of {sorted({len(r) for r in rows})}"
    if len(rows) == n and all(r.shape == (1,) for r in rows) and n > 1:
        return np.diag(np.concatenate(rows))
    if len(rows) == n and all(r.shape == (n,) for r in rows):
        return np.stack(rows)
    raise ScenarioError(f"{path}: {shape}; allowed: {n} diagonal entries or a {n} x {n} matrix")


def compensation(scenario: Scenario, n: int) -> np.ndarray:
    """A (n, n) of the compensator (9), 1/s; zero under a law that does not read it."""
    return square("controller.A", scenario.controller.A, n) if law_of(scenario).compensated else np.zeros((n, n))


def target_model(scenario: Scenario, n: int) -> TargetModel:
    """Target model (8) of the scenario for n coordinates, missing matrices at the mode's defaults; not yet checked by
    the mode.

    Raises ScenarioError and InvalidGain.
    """
    return TargetModel(**matrices_of(scenario, n))


def matrices_of(scenario: Scenario, n: int) -> dict[str, np.ndarray]:
    """Matrices (n, n) of (8) by name, as `target_model` has them, whether they make a model or not. Raises
    ScenarioError."""
    default = default_target_model(mode_of(scenario), n, believed_stiffness(scenario))
    given = {f: getattr(scenario.target_model, f) for f in TargetModelSection.__struct_fields__}
    return {
        f: np.diag(default[f]) if value is None else square(f"target_model.{f}", value, n) for f, value in given.items()
    }


def surfaces_met(scenario: Scenario, mode: Mode, layout: TaskLayout) -> SurfaceRange | None:
    """Range of surfaces on which the target model has to be stable: as stiff as the scenario's, with any normal; None
    for none."""
    contact, m, others = scenario.contact, mode.force_directions, scenario.surfaces[1:]
    if not contact.nature.springs or mode.feedback != "all":
        return None
    if m:  # the normal has a coordinate of its own
        friction = contact.friction_viscous + sum(each.contact.friction_viscous for each in others)
        return SurfaceRange(
            K_e=0.0,
            B_e=0.0,
            M_e=0.0,
            friction=friction,
            first=m,
            directions=layout.end_of_positions - m,
            normal=False,
        )
    return SurfaceRange(
        K_e=contact.K_e,
        B_e=contact.B_e,
        M_e=contact.M_e if contact.nature.massive else 0.0,
        friction=contact.friction_viscous,
        first=0,
        directions=layout.positions,
        normal=True,
    )


def blend_of(scenario: Scenario, mode: Mode, layout: TaskLayout) -> ModelBlend | None:
    """Blend that the scenario plans; refused unless every model on the way is stable."""
    if not scenario.blend.planned:
        return None
    n, surfaces = layout.n, surfaces_met(scenario, mode, layout)
    start = target_model(scenario, n)
    try:
        end = target_model(after_blend(scenario), n)
        require_admitted(end, scenario, mode, surfaces)
        certificate = certificate_between(start, end, scenario, mode, layout)
    except (InvalidGain, ScenarioError) as error:
        raise ScenarioError(f"blend.to: {error}") from error
    if not certificate.stable:
        raise ScenarioError(
            f"blend.to: {certificate.sentence}; allowed: a model with all poles left of 0 on the whole way to it"
        )
    return ModelBlend(start, end, scenario.blend.at, scenario.blend.over, certificate)


def require_admitted(model: TargetModel, scenario: Scenario, mode: Mode, surfaces: SurfaceRange | None) -> None:
    """Raise InvalidGain unless the mode admits the model, whether the tool presses the followed faces or not."""
    for stiffness in _stiffnesses_met(scenario):
        mode.check(model, stiffness, surfaces)
    _require_passive(model, model, scenario, mode)


def certificate_between(
    start: TargetModel, end: TargetModel, scenario: Scenario, mode: Mode, layout: TaskLayout
) -> BlendCertificate:
    """The weakest certificate of a blend between two admitted models, whether the tool presses the followed faces or
    not. Raises InvalidGain where only passive models are known to be stable, and one on the way is not."""
    _require_passive(start, end, scenario, mode)
    surfaces = surfaces_met(scenario, mode, layout)
    found = [certify(start, end, mode.environment(layout.n, K), surfaces) for K in _stiffnesses_met(scenario)]
    return max(found, key=lambda certificate: (CERTIFIED.index(certificate.by), certificate.rightmost.at_most))


def _stiffnesses_met(scenario: Scenario) -> list[np.ndarray]:
    """Estimated stiffness matrices that the target model meets: where it has followed faces, with and without them."""
    alone = [np.linalg.inv(believed_compliance(scenario))] if followed_faces(scenario).sets else []
    return [stiffness_met(scenario), *alone]


def _require_passive(start: TargetModel, end: TargetModel, scenario: Scenario, mode: Mode) -> None:
    """Raise InvalidGain where only passive models are known to be stable, and one from `start` to `end` is not."""
    if mode.feedback != "all":
        return
    if mode.force_directions < len(scenario.surfaces) > 1:
        where = "among several surfaces"
    elif scenario.face.flat and not mode.on_surface:
        where = "with a flat tool"
    else:
        return
    if not passive_throughout(start, end, mode.force_directions):
        which = "target_model" if start is end else "a model on the way"
        raise InvalidGain(
            f"{which}: not passive with its K_f, so {where} it may be unstable; allowed: K_f^-1 M_m, "
            "K_f^-1 B_m and K_f^-1 K_m symmetric positive definite, as with K_f a multiple of the identity"
        )


def z_at_start(scenario: Scenario, n: int) -> np.ndarray:
    """State z of the compensator (9) at the start, (n,) m/s, where it is kept. Raises ScenarioError."""
    given = scenario.controller.z_0
    if given is not None and len(given) != n:
        raise ScenarioError(f"controller.z_0: {len(given)} values; allowed: {n}")
    return np.zeros(n) if given is None else np.array(given, dtype=float)


def controller_of(scenario: Scenario, robot: Robot, mode: Mode, layout: TaskLayout, constants: Constants) -> Controller:
    """Controller of the scenario: its law with its gains. Raises ScenarioError and InvalidGain."""
    n, c = layout.n, scenario.controller
    model = target_model(scenario, n)
    require_admitted(model, scenario, mode, surfaces_met(scenario, mode, layout))
    gains = {f: square(f"controller.{f}", getattr(c, f), n) for f in ("A", "F_1", "F_2", "K_s")}
    law = law_of(scenario)
    return Controller(
        law=law,
        parameters=parameters_of(scenario, law),
        model=model,
        compensator=Compensator.design(model, gains["A"], gains["F_1"], gains["F_2"]),
        K_s=gains["K_s"],
        d=None if c.gain == "theorem" else c.d,
        epsilon=c.epsilon,
        bounds=c.bounds,
        switching=SWITCHING[c.switching],
        layer=c.layer,
        uncertainty=uncertainty_of(scenario, robot, constants.k_C, constants.rates),
        controlled=mode.controlled(n),
        surfaces=mode.normals,
    )
