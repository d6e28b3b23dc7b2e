"""A choice on the page is heard also when the running value is just being shown."""

import contextlib
import io
import threading
import time

import viser

from app.dashboard.transport.widget_lock import WidgetLock
from drivers.visitors import visiting
from drivers.waiting import until
from tests.support.viser_insides import chosen


def test_callback_reads_the_page_value_before_redraw_overwrites_it() -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    widget_lock, over, received = WidgetLock(server), threading.Event(), list[str]()
    dropdown = server.gui.add_dropdown("Mode", ("motion", "hybrid", "impedance"))

    @dropdown.on_update
    async def _(event: viser.GuiEvent) -> None:
        if event.client is not None:
            time.sleep(0.05)  # the machine has other things to do
            received.append(dropdown.value)

    def draw() -> None:
        while not over.wait(0.001):
            with widget_lock.drawing:
                dropdown.value = "motion"

    drawing = threading.Thread(target=draw)
    drawing.start()
    try:
        with visiting(f"http://127.0.0.1:{server.get_port()}") as page:
            until(lambda: bool(server.get_clients()))
            for value in ("hybrid", "impedance"):
                page.send(chosen(dropdown, value))
            until(lambda: len(received) > 1)
    finally:
        over.set()
        drawing.join()
        server.stop()
    assert received == ["hybrid", "impedance"]
