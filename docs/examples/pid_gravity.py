"""PID with gravity compensation in task space: a control law of one's own, in plain numpy.

vsmrc run ur5-impedance --use docs/examples/pid_gravity.py --set controller.law=pid-gravity --out build/pid
"""

from controllers.control_law import ControlLaw
from parameters import Parameter


def torque(given, out, x, x_dot):
    """J_q^T (F_cd - K_m e_r - B_m e_r_dot - k_i x) + G_hat, where x is the integral of e_r."""
    model, J_q = given.gains.model, given.task.J_q
    x_dot[:] = out.e_r
    pulled = model.K_m @ out.e_r + model.B_m @ out.e_r_dot + given.parameters.k_i * x
    out.terms.linear[:] = -J_q.T @ pulled
    out.terms.force[:] = J_q.T @ given.reference.F_cd
    out.terms.gravity[:] = given.feedforward.G_hat


LAW = ControlLaw(
    kind="pid-gravity",
    title="PID + gravity",
    about="PID + gravity: K_m and B_m as gains, with the integral of the error so that no weight leaves one behind.",
    torque=torque,
    told=("gravity", "rates"),
    terms={"linear": "K_m e_r + B_m ė_r + k_i x", "force": "J_qᵀ F_cd", "gravity": "gravity"},
    states=lambda n: n,
    parameters=(Parameter("k_i", 5000.0, 0.0, 50000.0, "N/(m·s)", "gain on the integral of e_r"),),
)
