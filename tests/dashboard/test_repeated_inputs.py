"""An input whose end is said again takes effect once."""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import pytest
import viser

from app.dashboard.theme.style import LEFT, RELEASED
from app.dashboard.transport.repeated_inputs import REPEATS, RepeatedInputs
from app.dashboard.transport.viser_private import uuid_of
from drivers.visitors import VisitingPage, visiting
from drivers.waiting import until


class Field(NamedTuple):
    """A text field on a server's page.
    received: values that took effect. now: s, the one entry is the instant. numbers: of texts that end a batch."""

    server: viser.ViserServer
    uuid: str
    received: list[str]
    now: list[float]
    numbers: Iterator[int]

    def send(self, page: VisitingPage, *values: str) -> None:
        for value in values:
            page.send({"type": "GuiUpdateMessage", "uuid": self.uuid, "updates": {"value": value}})

    def send_and_wait(self, page: VisitingPage, *values: str) -> None:
        end = f"over {next(self.numbers)}"
        self.send(page, *values, end)
        until(lambda: end in self.received, "not heard")
        self.received.remove(end)


@pytest.fixture
def field(viser_server: viser.ViserServer) -> Field:
    received, now = list[str](), [0.0]
    RepeatedInputs(viser_server, lambda: now[0])
    text = viser_server.gui.add_text("mass", "")

    @text.on_update
    async def _(_event: viser.GuiEvent) -> None:
        received.append(text.value)

    return Field(viser_server, uuid_of(text), received, now, itertools.count())


def test_what_a_page_says_again_takes_effect_once(field: Field) -> None:
    values = ["1", "1" + LEFT, "1" + 3 * LEFT, "1" + 5 * LEFT, "1" + 2 * LEFT, "1" + 4 * LEFT]
    values += ["1" + 2 * RELEASED, "2" + 2 * RELEASED, "2" + RELEASED]
    with visiting(f"http://127.0.0.1:{field.server.get_port()}") as page:
        until(lambda: field.server.get_clients(), "no page")
        field.send_and_wait(page, *values)
    again = ("1" + 3 * LEFT, "1" + 5 * LEFT, "1" + 4 * LEFT)
    assert field.received == [value for value in values if value not in again]


def test_a_field_that_was_hidden_meanwhile_counts_anew(field: Field) -> None:
    with visiting(f"http://127.0.0.1:{field.server.get_port()}") as page:
        until(lambda: field.server.get_clients(), "no page")
        for _ in range(3):  # as long as it is said again it is the same, however long that takes
            field.send_and_wait(page, "30" + 2 * LEFT)
            field.now[0] += 0.9 * REPEATS
        field.now[0] += REPEATS
        field.send_and_wait(page, "30", "30" + 2 * LEFT, "30" + 4 * LEFT)
    assert field.received == ["30" + 2 * LEFT, "30", "30" + 2 * LEFT]


def test_what_one_page_says_again_undoes_nothing_of_another(field: Field) -> None:
    url = f"http://127.0.0.1:{field.server.get_port()}"
    with visiting(url) as one, visiting(url) as other:
        until(lambda: len(field.server.get_clients()) == 2, "no pages")
        field.send_and_wait(one, "5" + LEFT)
        field.send_and_wait(other, "6" + LEFT)
        field.send_and_wait(one, "5" + 3 * LEFT)
    assert field.received == ["5" + LEFT, "6" + LEFT]
