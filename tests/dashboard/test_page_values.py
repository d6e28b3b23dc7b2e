"""A widget's callback is called for the values of pages only."""

import contextlib
import gc
import io
import warnings

import viser

from app.dashboard.transport.page_values import PageEvent, from_pages
from drivers.visitors import visiting
from drivers.waiting import until
from tests.support.viser_insides import chosen


def test_a_value_that_the_program_sets_calls_nothing_back_also_when_the_server_has_ended() -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    received = list[tuple[int, str]]()
    field = server.gui.add_text("mass", "")

    async def receive(event: PageEvent) -> None:
        received.append((event.client.client_id, event.target.value))

    field.on_update(from_pages(receive))
    try:
        with visiting(f"http://127.0.0.1:{server.get_port()}") as page:
            until(lambda: server.get_clients(), "no page")
            field.value = "1"
            page.send(chosen(field, "2"))
            until(lambda: received, "not heard")
    finally:
        server.stop()
    gc.collect()  # what other tests have left
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        field.value = "3"
        gc.collect()
    assert not [warning for warning in warned if "never awaited" in str(warning.message)]
    assert [value for _, value in received] == ["2"]
