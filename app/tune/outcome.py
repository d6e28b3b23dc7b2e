"""Outcome of a tuning: the table of its candidates, scenarios ready to run, a figure, and sentences."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from app.export.figures import SINGLE
from app.export.printing import file_of
from app.export.ticks import plain_decades
from app.process.atomic_write import write_whole
from app.scenario import data
from app.scenario.number_text import counted, plain, rounded
from app.scenario.schema import Scenario
from app.simulation.builders.environment_builder import robot_of, truth_of
from app.storage.joint_kinds import units_of
from app.sweep.charts import sheet, wide
from app.sweep.folder import packed, write_rows
from app.sweep.plan import LONGEST_NAME, SweepPlan, SweepRow
from app.sweep.run_metrics import COLUMNS, RunMetrics, metric_title
from app.sweep.run_store import column
from app.sweep.titles import unit_of
from app.tune.candidates import Candidate, aim_of
from app.tune.offers import badged, front_left, offered, reason_against
from app.tune.plan import Tuning, in_words, program
from app.tune.running import TuningResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

TABLE, FIGURE = "candidates.parquet", "tune.svg"
OWN = "own gains"
MAY_MOVE = "gain that may move; null: the scenario's own, which is not one number"
SOON = 0.4  # share of a run by which it has to have settled, for its end not to be the transient's


class Comparison(NamedTuple):
    """Metric of a candidate beside that of the scenario's own gains, on the test arms.

    value, before: worst over these arms, and that of the own gains, SI units; inf where an arm has none.
    change: of the worst against that of the own gains, as a share; nan where either has none.
    better: number of arms on which the metric is smaller than with the own gains.
    """

    aim: str
    value: float
    before: float
    change: float
    better: int


def comparisons(tuning: Tuning, found: TuningResult, number: int) -> list[Comparison]:
    """Comparisons of a candidate that was tried, one for each aim."""
    own, mine = found.tried[0], found.tried[number]
    return [
        Comparison(aim, value, before, _change(value, before), sum(_smaller(aim, found, number)))
        for aim, value, before in zip(tuning.aims, mine.aims, own.aims, strict=True)
    ]


def _change(value: float, before: float) -> float:
    return value / before - 1.0 if math.isfinite(value) and math.isfinite(before) and before > 0.0 else math.nan


def _smaller(aim: str, found: TuningResult, number: int) -> list[bool]:
    return [aim_of(mine, aim) < aim_of(own, aim) for mine, own in zip(found.runs[number], found.runs[0], strict=True)]


def files_of(tuning: Tuning, found: TuningResult) -> dict[int, str]:
    """Files of the scenarios that are offered, by candidate: best.toml, or front/1.toml and on."""
    numbers = [each.number for each in offered(tuning, found)]
    if len(tuning.aims) == 1:
        return dict.fromkeys(numbers, "best.toml")
    return {number: f"front/{place}.toml" for place, number in enumerate(numbers, start=1)}


def write(tuning: Tuning, found: TuningResult, folder: Path) -> None:
    """Write candidates.parquet, the figure, and the scenarios that are offered. Raises OSError."""
    table = _table(tuning, found)
    drawn = file_of(lambda: _drawn(tuning, found), "svg")
    write_whole(folder / TABLE, lambda file: pq.write_table(table, file))
    write_whole(folder / FIGURE, lambda file: file.write(drawn))
    for number, name in files_of(tuning, found).items():
        scenario = data.with_values(tuning.scenario, dict(found.tried[number].values))
        called = f"{scenario.name[:LONGEST_NAME]}-tuned-{number}"
        text = data.to_toml(msgspec.structs.replace(scenario, name=called)).encode()
        (folder / name).parent.mkdir(exist_ok=True)
        write_whole(folder / name, lambda file, text=text: file.write(text))


def zipped(tuning: Tuning, rows: Sequence[RunMetrics], found: TuningResult) -> bytes:
    """ZIP file of the folder that `vsmrc tune` writes. Raises OSError."""
    tuning = msgspec.structs.replace(tuning, program=program(tuning))

    def fill(folder: Path) -> None:
        write_rows(folder, tuning, rows)
        write(tuning, found, folder)

    return packed(f"{tuning.scenario.name}-tune", fill)


def _table(tuning: Tuning, found: TuningResult) -> pa.Table:
    """Table of all candidates, with units and meanings."""
    unit_of_aim = {aim: COLUMNS[aim].unit_in(units_of(tuning.scenario)) for aim in tuning.aims}
    worst = [
        column(aim, pa.float64(), unit, "worst of the arms of the search; inf: none")
        for aim, unit in unit_of_aim.items()
    ]
    tried = [column(f"{aim}_unseen", pa.float64(), unit, "worst of the test arms") for aim, unit in unit_of_aim.items()]
    schema = pa.schema(
        [
            column("candidate", pa.int64(), "", "number; 0: the scenario's own gains"),
            *(
                column(axis.path, pa.float64(), unit_of(axis.path, units_of(tuning.scenario)), MAY_MOVE)
                for axis in tuning.vary
            ),
            *worst,
            *tried,
            column("badge", pa.string(), "", "why it is not offered, on the arms of the search or on the test arms"),
            column(
                "promised", pa.float64(), "1", "share of the arms of the search on which the theorem's promise holds"
            ),
            column("file", pa.string(), "", "scenario that was written of it"),
        ]
    )
    files, rows = files_of(tuning, found), []
    own = {axis.path: v for axis in tuning.vary if isinstance(v := _own(tuning, axis.path), int | float)}
    for each in badged(tuning, found):
        again = found.tried.get(each.number)
        gains = each.values if each.number else own
        row: dict[str, Any] = {"candidate": each.number, **gains, "promised": each.promised}
        row |= dict(zip(tuning.aims, each.aims, strict=True))
        row |= {f"{aim}_unseen": again.aims[k] for k, aim in enumerate(tuning.aims) if again}
        rows.append(row | {"badge": each.badge or (again.badge if again else ""), "file": files.get(each.number)})
    return pa.Table.from_pylist(rows, schema=schema)


def _drawn(tuning: Tuning, found: TuningResult) -> Canvas:
    arms = "its own arm" if not tuning.draw else f"the worst of {tuning.seen} true arms"
    caption = f"{tuning.scenario.name}, {len(found.candidates) - 1} candidates, {arms}. "
    candidates = badged(tuning, found)
    if any(each.badge for each in candidates):
        caption += "A cross: never offered, such as over a limit."
    canvas, plot = sheet(SINGLE, caption)
    if len(tuning.aims) == 1:
        _draw_course(plot, tuning, candidates)
    else:
        _draw_front(plot, tuning, candidates, front_left(tuning, found))
    plot.legend(frameon=False, fontsize=6.0)
    return canvas


def _draw_front(plot: Axes, tuning: Tuning, candidates: list[Candidate], best: list[Candidate]) -> None:
    shown = [each for each in candidates[1:] if all(map(math.isfinite, each.aims))]
    for badge, marker, color in ((True, "x", "0.6"), (False, "o", "#5080c0")):
        dots = [each.aims for each in shown if bool(each.badge) == badge]
        plot.scatter([x for x, _ in dots], [y for _, y in dots], s=7, linewidths=0.6, marker=marker, color=color)
    plot.step(
        [each.aims[0] for each in best], [each.aims[1] for each in best], where="post", color="#d03030", label="front"
    )
    if all(map(math.isfinite, candidates[0].aims)):
        plot.plot(*candidates[0].aims, "k*", markersize=7, label=OWN, zorder=5)
    for k, (set_scale, axis) in enumerate(((plot.set_xscale, plot.xaxis), (plot.set_yscale, plot.yaxis))):
        if wide(np.array([each.aims[k] for each in shown])):
            set_scale("log")
            plain_decades(axis)
    plot.set_xlabel(in_words(tuning.aims[0], units_of(tuning.scenario)))
    plot.set_ylabel(in_words(tuning.aims[1], units_of(tuning.scenario)))


def _draw_course(plot: Axes, tuning: Tuning, candidates: list[Candidate]) -> None:
    least, course = math.inf, []
    for each in candidates[1:]:
        least = least if each.badge else min(least, each.aims[0])
        course.append(least)
        if math.isfinite(each.aims[0]):
            plot.plot(each.number, each.aims[0], "x" if each.badge else "o", color="0.6" if each.badge else "#5080c0",
                      markersize=2.5)  # fmt: skip
    plot.step(range(1, len(candidates)), course, where="post", color="#d03030", label="best so far")
    if math.isfinite(candidates[0].aims[0]):
        plot.axhline(candidates[0].aims[0], color="black", linestyle="--", label=OWN)
    if wide(np.array([each.aims[0] for each in candidates])):
        plot.set_yscale("log")
        plain_decades(plot.yaxis)
    plot.set_xlabel("candidate")
    plot.set_ylabel(in_words(tuning.aims[0], units_of(tuning.scenario)))


def summary_rows(tuning: Tuning, found: TuningResult) -> list[list[str]]:
    """Rows of the table that is printed, its head first: gains, and the worst on the test arms with its change and the
    number of arms that are better. A candidate that another one beats there is marked: the front is that of the arms
    of the search."""
    paths = (axis.path.replace(".", ".\n", 1) for axis in tuning.vary)
    aims = (in_words(aim, units_of(tuning.scenario)) for aim in tuning.aims)
    rows = [[f"worst of\n{counted(tuning.unseen, 'test arm')}", *paths, *aims, "promise\nholds"]]
    files = files_of(tuning, found)
    for number, each in found.tried.items():
        if number and number not in files:
            continue
        gains = [plain(float(each.values[a.path])) if number else _own_in_words(tuning, a.path) for a in tuning.vary]
        metrics = [
            rounded(c.value, 4) + (f"\n{_percent(c.change)}, {c.better} of {tuning.unseen}" if number else "")
            for c in comparisons(tuning, found, number)
        ]
        beating = next((name for other, name in files.items() if found.tried[other].dominates(each)), "")
        mark = f"\nbeaten by {beating}" if number and beating else ""
        rows.append([files.get(number, OWN) + mark, *gains, *metrics, f"{100 * each.promised:.3g} %"])
    return rows


def _own(tuning: Tuning, path: str) -> Any:
    """Value of a field of the scenario; None where the mode gives it."""
    value: Any = data.to_plain(tuning.scenario)
    for part in path.split("."):
        if isinstance(value, list) and part.isdecimal():
            value = value[int(part) - 1]
        else:
            value = value.get(part) if isinstance(value, dict) else None
    return value


def _own_in_words(tuning: Tuning, path: str) -> str:
    value = _own(tuning, path)
    return "the mode's" if value is None else plain(value) if isinstance(value, int | float) else str(value)


def _percent(change: float) -> str:
    return "—" if math.isnan(change) else f"{100 * change:+.3g} %"


def conclusions(tuning: Tuning, found: TuningResult, names: Mapping[int, str] | None = None) -> list[str]:
    """Sentences on whether the own gains are beaten on the test arms, and on what is not offered.
    names: of the candidates that are offered, by number; None for those of their files."""
    names, sentences = files_of(tuning, found) if names is None else names, []
    if found.tried[0].badge:
        sentences.append(f"the {OWN} themselves: {found.tried[0].badge}")
    if short := _short(tuning, found):
        sentences.append(short)
    if not _tests_anything(tuning):
        sentences.append(
            "the test arm is that of the search, since no quantity that is drawn is declared: nothing was tested"
        )
    badges = Counter(each.badge.rpartition(" (")[0] for each in found.candidates[1:] if each.badge)
    if badges:
        reason, count = badges.most_common(1)[0]
        sentences.append(
            f"{badges.total()} of {len(found.candidates) - 1} candidates are not offered, {count} of them for "
            f"this reason: {reason}"
        )
    sentences += [
        f"candidate {number} is not offered: {why}"
        for number in found.tried
        if number and (why := reason_against(tuning, found, number))
    ]
    if not names:
        return [*sentences, f"the {OWN} are NOT beaten: no candidate may be offered"]
    beating = [names[n] for n in names if all(_beats(tuning, each) for each in comparisons(tuning, found, n))]
    aims = " and ".join(metric_title(aim) for aim in tuning.aims)
    several = f"the worst of the {tuning.unseen} test arms, and on most of them"
    on = f"on {several if tuning.unseen > 1 else 'the test arm'}"
    if beating:
        sentences.append(f"{aims}: {', '.join(beating)} better than the {OWN}, {on}")
    else:
        both = "in both at once " if len(tuning.aims) > 1 else ""
        sentences.append(f"{aims}: the {OWN} are NOT beaten: no candidate is better {both}{on}")
    return sentences


def _tests_anything(tuning: Tuning) -> bool:
    """Whether a test arm is another one than that of the search, or its sensor has noise."""
    if tuning.drawn > 1 or tuning.scenario.sensor.noise or tuning.scenario.sensor.moment_noise:
        return True
    plan = SweepPlan(tuning)
    seen, unseen = (plan.scenario(SweepRow(arm, 0, arm, {})) for arm in (0, tuning.seen))
    robot = robot_of(tuning.scenario)

    def numbers(scenario: Scenario) -> np.ndarray:
        truth = truth_of(scenario, robot)
        model = truth.model(robot)
        frequency = truth.disturbance_frequency if truth.disturbance else 0.0
        masses = [each.toDynamicParameters() for each in list(model.inertias)[1:]]
        return np.hstack([*masses, model.armature, truth.coulomb, truth.viscous, truth.disturbance, frequency])

    return not np.array_equal(numbers(seen), numbers(unseen))


def _short(tuning: Tuning, found: TuningResult) -> str:
    """Sentence on runs that are too short for metrics of their end, "" where they are not: what is best there may be
    worse in the long run."""
    aims = [metric_title(aim) for aim in tuning.aims if COLUMNS[aim].at_the_end]
    length, times = tuning.length, [run.get("settling_time") for run in found.runs.get(0, [])]
    known = [float(each) for each in times if each is not None]
    unsettled = len(known) < len(times) and ("force_error" in tuning.aims or _comes_to_rest(tuning.scenario))
    if not aims or not (unsettled or max(known, default=0.0) > SOON * length):
        return ""
    settles = "does not settle" if unsettled else f"needs up to {max(known):.2g} s to settle"
    what = f"a run of {length:g} s {settles} with the {OWN}"
    judged = f"Only the last fifth of a run is judged ({', '.join(aims)})."
    longer = "use longer runs (--duration, on the page *Each run*)"
    return f"{what}. {judged} Gains that look better there may be worse later; {longer}"


def _comes_to_rest(scenario: Scenario) -> bool:
    """Whether the path error comes to rest: nothing moves the arm again and again."""
    return scenario.motion.comes_to_rest and scenario.truth.push_every == 0.0


def _beats(tuning: Tuning, compared: Comparison) -> bool:
    """Whether a metric is better than with the own gains. The worst arm alone may be chance."""
    return compared.value < compared.before and 2 * compared.better > tuning.unseen
