"""An input whose end is said again takes effect once."""

import contextlib
import io

import viser

from app.dashboard.theme.style import COMMIT, RELEASED
from app.dashboard.transport.repeated_inputs import RepeatedInputs
from drivers.visitors import visiting
from drivers.waiting import until


def test_what_a_page_says_again_takes_effect_once() -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    received = list[str]()
    RepeatedInputs(server)
    field = server.gui.add_text("mass", "")

    @field.on_update
    async def _(_event: viser.GuiEvent) -> None:
        received.append(field.value)

    values = ["1", "1" + COMMIT, "1" + 3 * COMMIT, "1" + 5 * COMMIT, "1" + 2 * COMMIT, "1" + 4 * COMMIT]
    values += ["1" + 2 * RELEASED, "2" + 2 * RELEASED, "2" + RELEASED, "over"]
    try:
        with visiting(f"http://127.0.0.1:{server.get_port()}") as page:
            until(lambda: server.get_clients(), "no page")
            for value in values:
                page.send({"type": "GuiUpdateMessage", "uuid": field._impl.uuid, "updates": {"value": value}})
            until(lambda: "over" in received, "not heard")
    finally:
        server.stop()
    assert received == [
        value for value in values if value not in ("1" + 3 * COMMIT, "1" + 5 * COMMIT, "1" + 4 * COMMIT)
    ]
