"""Ticks of the timeline."""

from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from unittest.mock import MagicMock

import pytest
import viser

from app.analysis.run_events import Event
from app.dashboard.widgets.fields.field_words import called, field_in_words, refusal_in_words
from app.dashboard.widgets.run.playback import APART, Playback, apart
from app.scenario.data import edited, load, shipped
from app.scenario.errors import ScenarioError
from app.scenario.field_info import paths_below, types_of
from app.scenario.schema import Scenario
from app.scenario.units import CARTESIAN, JOINT
from app.session.commanded_run import CommandedRun
from app.session.commands import Seek
from app.session.snapshot import Snapshot, snapshot_of
from app.simulation.closed_loop import ClosedLoop


def test_many_events_of_a_kind_leave_ticks_that_stand_apart_and_the_last_one_and_all_rare_ones() -> None:
    pushes = [(Event(float(k), "push", "pushed"), k / 200) for k in range(201)]
    fork = (Event(100.2, "fork", "forked"), 0.501)
    kept = apart(sorted([*pushes, fork], key=lambda place: place[1]), CARTESIAN)
    assert fork in [tick[:2] for tick in kept]
    assert kept[-1][:2] == pushes[-1]
    positions = [position for event, position, _ in kept if event.kind == "push"]
    assert 30 < len(positions) <= 41
    assert all(b - a > APART - 1e-9 for a, b in pairwise(positions))
    assert [tick[:2] for tick in apart(pushes[:1], CARTESIAN)] == pushes[:1]


def test_a_tick_tells_of_the_nearer_ones_before_it_in_the_pages_words() -> None:
    laws = [
        (Event(80.0, "edit", "controller.law = computed-torque", (("controller.law", "computed-torque"),)), 0.600),
        (Event(83.4, "edit", "controller.law = vsmrc", (("controller.law", "vsmrc"), ("contact.K_e", 2e4))), 0.601),
    ]
    (tick,) = apart(laws, CARTESIAN)
    assert tick.event.t == 83.4
    first, second = tick.description.splitlines()
    assert first.startswith("80.00 s: ")
    assert "computed torque" in first
    assert second.endswith("20000 N/m")
    assert "contact.K_e" not in tick.description


def test_the_stop_of_a_run_keeps_its_tick_while_one_looks_back_for_its_cause() -> None:
    run = CommandedRun(ClosedLoop.from_scenario(load("planar2r-semicircle")), None)
    for _ in range(200):
        run.step()
    run.loop.fail("the loop", ValueError("planted"))

    def now() -> Snapshot:
        return run.known(snapshot_of(run.loop))

    desk = MagicMock()
    desk.snapshot = now
    playback = Playback(desk)
    playback.show(now())
    (fault,) = [line for line in playback._ticks.content.split("<i ") if "vs-fault" in line]
    run.execute(Seek(now().first))
    assert now().phase == "paused"
    playback.show(now())
    assert fault in playback._ticks.content
    assert playback._instants[-1] == now().end


def test_a_field_has_the_unit_of_the_coordinates_and_what_is_left_out_is_said_as_what_it_is() -> None:
    for units, layer, damping in (
        (CARTESIAN, "0.02 m/s", "400 N·s/m, all axes"),
        (JOINT, "0.02 rad/s", "400 N·m·s/rad, all axes"),
    ):
        assert field_in_words("controller.layer", 0.02, units).endswith(layer)
        assert field_in_words("target_model.B_m", [400, 400], units).endswith(damping)
        assert field_in_words("contact.K_e", 2e4, units).endswith(" N/m")
    assert field_in_words("target_model.B_m", None, JOINT).endswith("the mode's own")
    assert field_in_words("declared.delta_G", None, JOINT).endswith("not given")


def test_a_list_is_said_by_its_one_number_or_its_first_ones() -> None:
    def words(path: str, value: object) -> str:
        return field_in_words(path, value, CARTESIAN).rpartition(": ")[2]

    assert words("target_model.K_m", [500.0, 2000.0, 2000.0]) == "500, 2000, 2000 N/m"
    assert words("target_model.K_m", [500.5, *[2000.25] * 5]) == "500.5, 2000.25, 2000.25, … N/m"
    assert words("target_model.K_m", [[1.0, 0.0], [0.0, 1.0]]) == "2 × 2 numbers"
    assert words("truth.push", (0.0, 0.0, 0.0)) == "0 N each"


def test_a_refusal_names_an_entry_of_a_list_by_its_place() -> None:
    with pytest.raises(ScenarioError) as refused:
        edited(shipped()["ur5-impedance"], "motion.displacement", [0.1, float("nan"), 0.0])
    said = refusal_in_words(str(refused.value))
    assert said == "displacement (desired motion): number 2 is nan; allowed: a finite number"


def test_a_refusal_names_a_matrix_as_the_page_does() -> None:
    refusal = "blend.to: target_model.K_m2: smallest eigenvalue -1000; allowed: symmetric positive definite"
    named = "the model at its end (blend): K_m of the free coordinates: smallest eigenvalue"
    assert refusal_in_words(refusal).startswith(named)
    assert refusal_in_words("target_model.M_m1: small") == "M_m of the pressed coordinates: small"
    assert refusal_in_words("target_model.K_f: an entry") == "K_f: an entry"
    assert refusal_in_words("target_model: unstable") == "target_model: unstable"


def test_a_refusal_names_its_field_so_that_one_knows_which_is_meant() -> None:
    refusal = "controller.epsilon: -1.0; allowed: a number > 0"
    assert refusal_in_words(refusal) == "ε, margin of the gain d in (17): −1; allowed: above 0"
    beyond = "contact.K_e: 1e+09; allowed: a number <= 10000000"
    assert refusal_in_words(beyond) == "K_e, stiffness of the surface: 10⁹ N/m; allowed: at most 10⁷ N/m"
    stiff = "contact.K_e: 1e+07 N/m is too stiff for 1 step(s)"
    assert refusal_in_words(stiff) == "K_e, stiffness of the surface: 10⁷ N/m is too stiff for 1 step(s)"
    little = beyond.replace("1e+09", "10000000.5")
    assert "10000000.5 N/m; allowed: at most 10⁷ N/m" in refusal_in_words(little)
    assert refusal_in_words("motion.radius: -1; allowed: more") == "radius (desired motion): -1; allowed: more"
    assert refusal_in_words("motion.displacement: 1") == "displacement (desired motion): 1"
    assert refusal_in_words("contact.K_e: 0") == "K_e, stiffness of the surface: 0"
    assert refusal_in_words("second.contact.K_e: 0") == "K_e, stiffness of the surface (second surface): 0"
    assert refusal_in_words("truth.push_start: -5") == "start of the push: -5"
    assert refusal_in_words("surface.text: unknown") == "formula of the surface: unknown"
    # the user looks for this name in a file of his or her own
    assert refusal_in_words("own.toml: motion.radius: -1") == "own.toml: motion.radius: -1"


def test_every_number_of_the_page_has_a_name_of_its_own_in_a_refusal() -> None:
    """So that a student finds its row: no dotted path, and no label such as "by" or "x, y, z"."""
    sections = {name: types_of(Scenario, name) for name in Scenario.__struct_fields__}
    paths = [path for name, kinds in sections.items() for path in paths_below(name, kinds)]
    names = {path: called(path) for path in paths if path.partition(".")[0] not in ("second", "third", "target_model")}
    assert len(names) > 80
    assert [path for path, name in names.items() if path in name or len(name) < 4] == []
    twice = [name for name, count in Counter(names.values()).items() if count > 1]
    assert twice == []


def test_the_menu_shows_the_speed_of_a_slow_motion_as_long_as_it_holds(viser_server: viser.ViserServer) -> None:
    snapshot = snapshot_of(ClosedLoop.from_scenario(load("planar2r-semicircle")))
    desk = MagicMock(gui=viser_server.gui)
    desk.snapshot = lambda: snapshot
    playback = Playback(desk)
    menu = playback._speed
    usual = menu.options
    for speed, title in (
        (0.05, "1/20×"),
        (1 / 52, "1/52×"),
        (0.01, "1/100×"),
        (0.3, "1/3.3×"),
        (100.0, "100×"),
        (1.0, "1×"),
    ):
        playback.show(replace(snapshot, speed=speed))
        assert menu.value == title
        assert set(menu.options) == {*usual, title}
        assert (menu.options.index(title) < menu.options.index("1×")) == (speed < 1.0)
    assert menu.options == usual
    desk.post.reset_mock()
    playback.show(replace(snapshot, speed=1 / 52))
    asyncio.run(playback._on_speed(MagicMock()))
    desk.post.assert_not_called()
