"""Control law of a user's own that reads s, and z with it: a gain on s. z is told of the measured force, by (9)."""

from controllers.control_law import ControlLaw
from parameters import Parameter


def torque(given, out):
    """-g J_q^T s + J_q^T F_cd + G_hat."""
    out.terms.linear[:] = -given.parameters.g * given.task.J_q.T @ out.s
    out.terms.force[:] = given.task.J_q.T @ given.reference.F_cd
    out.terms.gravity[:] = given.feedforward.G_hat


LAW = ControlLaw(
    kind="of-s",
    title="Of s",
    about="A gain on s.",
    torque=torque,
    told=("gravity", "rates", "compensator"),
    parameters=(Parameter("g", 400.0, 0.0, 1e5, "N·s/m", "gain on s"),),
)
