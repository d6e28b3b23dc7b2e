"""Controller: gains of the law (25), switching, and what the theorem says of them now."""

from __future__ import annotations

from app.dashboard.controls import Choice, Control, Desk, Number, Place, decades
from app.dashboard.facts import Facts
from app.runner import Snapshot


class ControllerPanel:
    """The law, its gains, and the live numbers of the guarantee."""

    def __init__(self, desk: Desk) -> None:
        gui = desk.gui
        self._facts = Facts(gui)
        laws = {"VSMRC (25)": "vsmrc", "computed torque": "computed-torque"}
        switching = {
            "s / ‖s‖ (discontinuous)": "discontinuous",
            "saturation": "saturation",
            "s / (‖s‖ + φ)": "rational",
            "tanh": "tanh",
        }
        self._controls: list[Control] = [Choice(desk, "controller.law", "Law", laws)]
        with gui.add_folder("Robust term"):
            self._controls += [
                Choice(desk, "controller.gain", "Gain d", {"by the theorem (17)": "theorem", "constant": "constant"}),
                Number(desk, Place("controller.d"), "constant d [N]", decades(1, 1000)),
                Number(desk, Place("controller.epsilon"), "margin ε [N]", decades(0.1, 100)),
                Choice(desk, "controller.bounds", "Bounds", {"in task space (tight)": "tight", "as in (7)": "paper"}),
                Choice(desk, "controller.switching", "Switching", switching),
                Number(desk, Place("controller.layer"), "layer φ [m/s]", decades(1e-4, 0.1)),
                Number(desk, Place("controller.K_s"), "K_s [N·s/m]", decades(1, 2000)),
            ]
        with gui.add_folder("Sliding surface"):
            self._controls += [
                Number(desk, Place("controller.F_1"), "F_1 [1/s]", decades(0.5, 200)),
                Number(desk, Place("controller.F_2"), "F_2", decades(0.05, 20)),
                Number(desk, Place("controller.A"), "A ≤ 0 [1/s]"),
                Choice(
                    desk,
                    "controller.on_change",
                    "On change",
                    {"z anew: no reaching": "remove", "z kept: watch it reach": "watch"},
                ),
            ]
        with gui.add_folder("Computation"):
            estimates = {"M, C, G on-line": "online", "along r_d (Remark 3)": "along-reference"}
            self._controls += [
                Choice(desk, "controller.estimates", "Estimates", estimates),
                Number(desk, Place("controller.period"), "period [s]", decades(1e-4, 0.02)),
            ]

    def show(self, snapshot: Snapshot) -> None:
        self._facts.show(snapshot)
        for control in self._controls:
            control.show(snapshot)
