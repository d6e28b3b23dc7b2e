"""The `vsmrc` command: `serve | run | compare | export | response | sweep | tune | figures | lesson | list`."""

from __future__ import annotations

import math
import os
import signal
import sys
import tomllib
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar, get_args

import structlog
import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from app.access.admission import Names, PortTaken
from app.access.given_token import given_token
from app.access.rate_limits import Limits
from app.dashboard.theme.colors import Theme
from app.export.formats import ALL_PLOTS, Kind
from app.gateway.server_settings import PageStyle, ServerSettings, Token
from app.process import log, open_files
from app.process.other_users import other_people
from app.process.terminal_text import printable, say
from app.scenario.data import OPENING, edited, load, shipped
from app.scenario.schema import Scenario, ScenarioError, scenario_errors
from app.simulation.engines import Engine
from controllers.laws import KINDS
from parameters import allowed

if TYPE_CHECKING:
    from app.analysis.metrics import Metrics
    from app.simulation.system import System
    from app.sweep.cluster import Cluster
    from app.sweep.question import Sweep
    from app.tune.question import Tuning

# Each command imports its own libraries: no other command waits for those of the page or of the simulation.

DONE, FAULT, BAD_INPUT, STOPPED, BROKEN, UNPROMISED = 0, 1, 2, 3, 4, 5
TITLE = 40  # letters of a figure's name, before its value
FILES = 64 + 2 * Limits().per_session  # open at once in a server for oneself: its own, pages and new connections
events = structlog.get_logger()
Choice = TypeVar("Choice", bound=str)
Files = Annotated[tyro.conf.UseAppendAction[tuple[Path, ...]], tyro.conf.arg(metavar="FILE.py")]
Settings = Annotated[
    tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]],
    tyro.conf.arg(name="set", metavar="KEY=VALUE", help="change fields, e.g. --set force.value=30 contact.K_e=2e4"),
]


def one_of(flag: str, given: str, names: tuple[Choice, ...]) -> Choice:
    """The one of these names that was given to a flag. Raises ScenarioError with the one that was probably meant."""
    for name in names:
        if name == given:
            return name
    raise ScenarioError(f"{flag} {given!r:.60}; {allowed(given, names)}")


def _braces(names: tuple[str, ...]) -> str:
    return f"{{{','.join(names)}}}"


KINDS_OF_FILES: tuple[Kind, ...] = get_args(Kind)
THEMES: tuple[Theme, ...] = get_args(Theme)
TOKENS: tuple[Token, ...] = get_args(Token)
ENGINES: tuple[Engine, ...] = get_args(Engine)
LEVELS: tuple[log.Level, ...] = get_args(log.Level)


def serve(
    scenario: Annotated[str, tyro.conf.Positional] = OPENING,
    /,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    theme: Annotated[str, tyro.conf.arg(metavar=_braces(THEMES))] = "dark",
    fps: float = 30.0,
    state_dir: Path | None = None,
    stateless: bool = False,
    log_level: Annotated[str | None, tyro.conf.arg(metavar=_braces(LEVELS))] = None,
    log_file: Path | None = None,
    shared: bool = False,
    token: Annotated[str, tyro.conf.arg(metavar=_braces(TOKENS))] = "auto",
    token_file: Path | None = None,
    origin: tuple[str, ...] = (),
    max_sessions: int | None = None,
    per_address: int | None = None,
    copies: bool = True,
    classes: Annotated[bool, tyro.conf.arg(name="class")] = False,
    idle_minutes: float = 30.0,
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Open the dashboard, for yourself or for an audience.

    Args:
        scenario: a shipped scenario or a .toml file to begin with
        host: address to listen at; only this machine can reach 127.0.0.1, another one needs the link with the token
        port: port to listen at
        theme: how the page looks at first; T changes it there
        fps: pictures of the scene per second; without a graphics card, few leave more to the loop
        state_dir: folder that keeps scenarios and pinned runs for the next start, instead of ~/.local/state/vsmrc-lab,
            and for an audience (--shared, --host, --origin, --token always), whose sessions else end with the server
        stateless: keep nothing
        log_level: what is logged; by default warnings, and what is of interest afterwards to the file, too
        log_file: a file to log to as well
        shared: a session for every visitor, each in a process of its own, with links to watch and to steer it
        token: ask for a token: unless only your own programs can come (auto), always, or never, as a proxy asks
        token_file: where the token to steer is, which else is VSMRC_TOKEN of the environment or made at the start
        origin: public addresses behind a proxy, such as https://lab.example.org
        max_sessions: with --shared, how many run at once, instead of what this machine holds; the others queue
        per_address: with --shared, how many of them one address may have, instead of all but a quarter
        copies: with --shared, whether who watches may take a private copy of the session
        classes: let the lessons of a session ask a class, which answers on its phones by a link or QR code
        idle_minutes: with --shared, a session that nobody looks at so long is closed; its link brings it back
        use: a file with a control law of your own (docs/extending.md); it runs as your program
    """
    from app.dashboard.frame_rate import check_fps

    chosen_theme: Theme = one_of("--theme", theme, THEMES)
    asking: Token = one_of("--token", token, TOKENS)
    level: log.Level | None = None
    if log_level is not None:
        named: log.Level = one_of("--log-level", log_level, LEVELS)
        level = named
    try:
        log.configure(level, log_file)
    except OSError as error:
        raise ScenarioError(f"--log-file {log_file}: cannot be written: {error.strerror}") from error
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a script that begins us with & hands it on ignored
    for ending in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(ending) is not signal.SIG_IGN:  # nohup
            signal.signal(ending, signal.default_int_handler)
    if not 0 <= port <= 65535:
        raise ScenarioError(f"--port {port}; allowed: 0 to 65535")
    _use(use)
    chosen = _configured(scenario, settings)
    people = other_people() if asking == "auto" else []
    server_settings = ServerSettings(
        host=host,
        port=port,
        shared=shared,
        token=asking,
        origins=origin,
        places=max_sessions,
        of_one_address=per_address,
        copies=copies,
        classes=classes,
        idle_minutes=idle_minutes,
        given=given_token(token_file, os.environ),
        crowded=bool(people),
    )
    try:
        check_fps(fps)
    except ValueError as error:
        raise ScenarioError(f"--{error}") from error
    if people and Names(host).local and not origin:
        say(f"{', '.join(people[:3])} can use this machine, too: the link has a token (--token never: none)")
    if server_settings.open:
        from app.gateway.serve import serve as serve_others

        serve_others(chosen, PageStyle(chosen_theme, fps), server_settings, None if stateless else state_dir)
        return DONE
    from app.dashboard import local_server
    from app.dashboard.page import Dashboard

    open_files.require(FILES, "for the session and its pages")
    dashboard = Dashboard(host=host, port=port, theme=chosen_theme, fps=fps, tokens=server_settings.tokens)
    local_server.serve(chosen, dashboard, state_dir=state_dir, stateless=stateless)
    return DONE


def run(
    scenario: tyro.conf.Positional[str | None] = None,
    /,
    *,
    out: Path,
    from_: Annotated[Path | None, tyro.conf.arg(name="from")] = None,
    row: int | None = None,
    duration: float | None = None,
    blend_to: str | None = None,
    blend_at: float = 0.0,
    blend_over: float = 2.0,
    strict: bool = False,
    engine: Annotated[str, tyro.conf.arg(metavar=_braces(ENGINES))] = "pinocchio",
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Simulate a scenario without a screen; writes recording.npz, metrics.json and scenario.toml.

    Args:
        scenario: a shipped scenario (see `vsmrc list`) or a .toml file
        out: folder for the files
        from_: a folder of `vsmrc sweep`, in place of a scenario: the same run again
        row: number of that run
        duration: simulated time in s, instead of the scenario's
        blend_to: go over to the target model of this scenario; see also the fields of `blend`
        blend_at: when that begins, s
        blend_over: how long it takes, s
        strict: end with status 4 when what the theorem promises is broken, 5 when it promises nothing
        engine: pinocchio; or compiled, faster, and its digits differ by rounding (docs/command-line.md)
        use: a file with a control law of your own (docs/extending.md)
    """
    from app.session import headless_run
    from app.session.changes import blending_to
    from app.storage.constants_store import kept_memory

    by: Engine = one_of("--engine", engine, ENGINES)
    _use(use)
    if from_ is not None:
        if scenario is not None or row is None or settings or duration is not None:
            raise ScenarioError("--from: with a scenario or settings, or without --row; allowed: --from FOLDER --row N")
        chosen, by = _of_sweep(from_, row)
    elif scenario is None:
        raise ScenarioError("run: no scenario; allowed: one (see `vsmrc list`), or --from FOLDER --row N")
    else:
        chosen = _configured(scenario, settings, duration)
    if blend_to is not None:
        chosen = blending_to(chosen, load(blend_to), blend_at, blend_over)
    loop, metrics = headless_run.simulate(chosen, engine=by, show_progress=True, memory=kept_memory())
    try:
        headless_run.write(loop, metrics, out)
    except OSError as error:
        raise ScenarioError(f"--out {out}: cannot be written: {error.strerror}") from error
    _print_figures(metrics, loop.system)
    _print_promise(metrics)
    for violation in loop.standing.outsiders:
        print(f"the truth is outside what was declared: {violation}")
    if loop.warning:
        print(f"flagged: {loop.warning}")
    print(f"written to {out}")
    if strict and metrics.promise.verdict != "holds":
        return BROKEN if metrics.promise.verdict == "broken" else UNPROMISED
    return STOPPED if loop.stopped else DONE


def _of_sweep(folder: Path, row: int) -> tuple[Scenario, Engine]:
    """Scenario and engine of a run of a sweep."""
    from app.sweep import question

    asked = question.read(folder / question.FILE)
    if asked.program != question.fingerprint():
        say("this sweep was computed by another version of the program: digits may differ")
    whole = question.Question(asked)
    return whole.scenario(whole.row(row)), asked.engine


def _print_figures(metrics: Metrics, system: System) -> None:
    from app.analysis.metrics import METRICS

    for figure in METRICS:
        value = figure.of(metrics)
        unit = "" if value is None else figure.units([system])
        print(f"{figure.title:{TITLE}s} {_shown(value)} {unit}".rstrip())
    print(f"{'variation of the torques, per joint':{TITLE}s} {_shown(metrics.torque_total_variation)} N·m/s")
    if metrics.stopped is not None:
        print(f"{'stopped':{TITLE}s} {metrics.stopped}")


def _print_promise(metrics: Metrics) -> None:
    """The verdict on the theorem's promise, and each premise that failed."""
    promise = metrics.promise
    print(f"{'promise':{TITLE}s} {promise.verdict}: {promise.because}")
    print(f"{'promised share of the run':{TITLE}s} {100 * promise.share:.4g} %")
    for finding in metrics.premises:
        if finding.failed is not None:
            print(
                f"premise failed at {finding.failed:.4g} s: {finding.title}, least margin {_shown(finding.margin)} "
                f"{finding.unit}".rstrip()
            )


def compare(
    scenarios: Annotated[tuple[str, ...], tyro.conf.Positional],
    /,
    *,
    last: float | None = None,
    duration: float | None = None,
    engine: Annotated[str, tyro.conf.arg(metavar=_braces(ENGINES))] = "pinocchio",
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Simulate scenarios and put their figures side by side, as the tab Runs does with pinned runs.

    Args:
        scenarios: shipped scenarios or .toml files
        last: how much of the end counts, in s, instead of the whole run
        duration: simulated time in s, instead of the scenarios'
        engine: pinocchio; or compiled, faster, and its digits differ by rounding (docs/command-line.md)
        use: a file with a control law of your own (docs/extending.md)
    """
    from app.analysis.metrics import FIGURES, account
    from app.session import headless_run
    from app.storage.constants_store import kept_memory

    if last is not None and not last > 0:
        raise ScenarioError(f"--last {last:g}: allowed: more than 0 s")
    if not scenarios:
        raise ScenarioError("compare: no scenario; allowed: one or more (see `vsmrc list`)")
    by: Engine = one_of("--engine", engine, ENGINES)
    _use(use)
    systems, accounts, stopped = [], [], False
    for name, scenario in [(name, _configured(name, settings, duration)) for name in scenarios]:
        loop, _ = headless_run.simulate(scenario, engine=by, show_progress=True, memory=kept_memory())
        since = -math.inf if last is None else loop.t - last
        systems.append(loop.system)
        accounts.append(account(loop.system, loop.recording, since, loop.t))
        if loop.stopped:
            stopped = True
            print(f"{name} stopped: {loop.stopped}")
    table = Table("", *(escape(name) for name in scenarios))
    for figure in FIGURES:
        table.add_row(escape(f"{figure.title} [{figure.units(systems)}]"), *(_shown(figure.of(a)) for a in accounts))
    Console().print(table)
    return STOPPED if stopped else DONE


def export(
    run: tyro.conf.Positional[str],
    /,
    *,
    out: Path,
    to: Annotated[tuple[str, ...], tyro.conf.arg(metavar=_braces(KINDS_OF_FILES))] = ("pdf",),
    plots: tuple[str, ...] = (ALL_PLOTS,),
    series: tuple[str, ...] = (),
    width: str | None = None,
    height: str | None = None,
    type_size: float = 7.0,
    letters: bool = False,
    caption: bool = True,
    start: float = 0.0,
    end: float = math.inf,
    engine: Annotated[str, tyro.conf.arg(metavar=_braces(ENGINES))] = "pinocchio",
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Make what the page's Export tab makes, from a recording or a scenario, which is simulated first.

    Args:
        run: a recording.npz of `vsmrc run` or of the page, a shipped scenario or a .toml file
        out: folder for the files
        to: svg, pdf, png: figures; csv, npz: data; html: 3-D playback; toml: scenario
        plots: what a figure shows: plots by their names, tabs of the page by their titles (docs/export.md), or all
        series: only these lines, by their names in the legends; psi_1 is ψ₁
        width: of a figure: single (85 mm) or double (180 mm) column, or a length such as 120mm or 5in
        height: of a figure, such as 60mm, instead of what its plots need
        type_size: of a figure's text, pt
        letters: (a), (b), … before the titles of the plots
        caption: the scenario's numbers below the figure
        start: first instant, s
        end: last instant, s
        engine: pinocchio; or compiled, faster, and its digits differ by rounding (docs/command-line.md)
        use: a file with a control law of your own (docs/extending.md)
    """
    from app.dashboard.export import FigureChoice, Stretch, write
    from app.dashboard.plots.paper_figures import plots_of
    from app.export.figures import FigureOptions
    from app.session import headless_run
    from app.storage.constants_store import kept_memory
    from app.storage.recording_files import read_npz

    by: Engine = one_of("--engine", engine, ENGINES)
    kinds: list[Kind] = [one_of("--to", kind, KINDS_OF_FILES) for kind in to]
    plots_of(plots)  # before the simulation, which would be in vain
    with scenario_errors():
        wide, high = _inches("--width", width), _inches("--height", height)
        options = FigureOptions(wide, high, type_size, letters, caption)
    _use(use)
    status = DONE
    if run.endswith(".npz"):
        if settings:
            raise ScenarioError("--set: a recording cannot be changed any more; allowed: with a scenario")
        scenario, recording = read_npz(Path(run))
    else:
        scenario = _configured(run, settings)
        loop, _ = headless_run.simulate(scenario, engine=by, show_progress=True, memory=kept_memory())
        recording = loop.recording
        if loop.stopped:
            print(f"stopped: {loop.stopped}")
            status = STOPPED
    try:
        for path in write(Stretch(scenario, recording, start, end), kinds, FigureChoice(plots, series, options), out):
            print(f"written: {path}")
    except OSError as error:
        raise ScenarioError(f"--out {out}: cannot be written: {error.strerror}") from error
    return status


def response(
    scenario: tyro.conf.Positional[str],
    /,
    *,
    out: Path,
    at: float = 0.0,
    measure: tuple[float, ...] = (),
    chirp: tuple[float, float] | None = None,
    newtons: float = 2.0,
    use: Files = (),
    settings: Settings = (),
) -> int:
    """Compare the impedance that the tool has with that of the target model, and find the force loop's margins: writes
    response.svg and response.csv, and force_loop.csv where the contact's force is fed back.

    Args:
        scenario: a shipped scenario or a .toml file
        out: folder for the files
        at: the instant of the run whose posture is looked at, s
        measure: frequencies, Hz, at which whole runs under a sinusoidal push measure it, too
        chirp: lowest and highest frequency, Hz, of a push that sweeps from one to the other and measures it between
        newtons: size of that push, N
        use: a file with a control law of your own (docs/extending.md)
    """
    from app.export.figures import render
    from app.export.response_files import figure_of, force_table_of, table_of, told
    from app.process.atomic_write import write_whole
    from app.scenario.caption import title_of
    from app.session import push_measurement
    from app.session.push_measurement import Chirp, PushExperiment
    from app.simulation import force_margin
    from app.simulation.closed_loop import ClosedLoop
    from app.simulation.sampled_stability import oscillations, sampled_loop
    from app.storage.constants_store import kept_memory

    if not 0.0 <= at < math.inf:
        raise ScenarioError(f"--at {at:g}: allowed: 0 s or more")
    if not 0.0 < newtons < math.inf:
        raise ScenarioError(f"--newtons {newtons:g}: allowed: more than 0 N")
    _use(use)
    chosen, memory = _configured(scenario, settings), kept_memory()
    loop = ClosedLoop(chosen, memory=memory)
    while loop.t < at - 0.5 * loop.period and not loop.stopped:
        loop.step()
    seen = sampled_loop(loop.system, loop.state.arm.views.q.copy(), loop.t)
    if seen.response is None:
        raise ScenarioError(f"response: {scenario} has none: the law chatters, the sensor is late, or J_q is singular")
    experiment = PushExperiment(loop.state, seen.response.directions, newtons, memory)
    points = [experiment.sine(each) for each in measure]
    points += [] if chirp is None else experiment.chirp(Chirp(*chirp))
    for line in told(seen.response):
        print(line)
    if points:
        print(push_measurement.told(points, seen.response))
    for pole in oscillations(seen):
        print(
            f"poles of the target model at {pole.omega:.4g} 1/s, damping {pole.zeta:.3g}: in the sampled loop "
            f"{pole.sampled_omega:.4g} 1/s, damping {pole.sampled_zeta:.3g}"
        )
    if math.isfinite(seen.force_factor):
        print(f"force loop: a sample multiplies an error by {seen.force_factor:.3g}; allowed below 1 in size")
    if seen.force_loop is not None:
        print(force_margin.told(seen.force_loop))
    caption = f"{title_of(chosen, shipped().get(chosen.name)).text}, at t = {loop.t:.3g} s."
    try:
        out.mkdir(parents=True, exist_ok=True)
        files = {
            "response.svg": render(figure_of(seen, seen.response, points, caption), "svg"),
            "response.csv": table_of(seen.response, points).encode(),
        }
        if seen.force_loop is not None:
            files["force_loop.csv"] = force_table_of(seen.force_loop).encode()
        for name, content in files.items():
            write_whole(out / name, lambda file, content=content: file.write(content))
    except OSError as error:
        raise ScenarioError(f"--out {out}: cannot be written: {error.strerror}") from error
    print(f"written to {out}")
    return DONE


def figures(
    *,
    out: Path,
    only: tuple[str, ...] = (),
    thin: int = 1,
    engine: Annotated[str, tyro.conf.arg(metavar=_braces(ENGINES))] = "pinocchio",
) -> int:
    """Compute the evidence anew: evidence.md with every figure and number of docs/evidence.md, on all cores.

    Args:
        out: folder for the files
        only: sections, by name, instead of all
        thin: one in so many of the cases, to look quickly
        engine: pinocchio; or compiled, faster, and its digits differ by rounding (docs/command-line.md)
    """
    from app.evidence.make import make
    from app.evidence.sections import SECTIONS

    by: Engine = one_of("--engine", engine, ENGINES)
    names = [section.name for section in SECTIONS]
    if unknown := [name for name in only if name not in names]:
        raise ScenarioError(f"--only {unknown[0]}: {allowed(unknown[0], names)}")
    if thin < 1:
        raise ScenarioError(f"--thin {thin}: allowed: 1 or more")
    try:
        page = make([section for section in SECTIONS if not only or section.name in only], thin, out, engine=by)
    except OSError as error:
        raise ScenarioError(f"--out {out}: cannot be written: {error.strerror}") from error
    print(f"written: {page}")
    return DONE


def lesson(
    action: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="{list,check,run}")],
    lessons: Annotated[tuple[str, ...], tyro.conf.Positional] = (),
    /,
    *,
    figures: Path | None = None,
) -> int:
    """List the lessons, check them, or play one without a screen.

    Args:
        action: list; check: play the runs, score the reference answers and the planted wrong ones, read the texts; run:
            play the runs and show what they measure
        lessons: shipped lessons, by name, or lesson.md files; for check, all shipped ones without a name
        figures: folder for an SVG of each run, for run
    """
    from app.dashboard.plots.lesson_figures import figure_of_run, name_of_figure
    from app.export.figures import render
    from app.lessons.answers import Notebook
    from app.lessons.checking import check
    from app.lessons.course import Course
    from app.lessons.lesson import load as load_lesson
    from app.lessons.lesson import shipped_lessons
    from app.lessons.playing import play, runs
    from app.process.atomic_write import write_whole
    from app.storage.constants_store import kept_memory

    actions = ("list", "check", "run")
    doing = one_of("lesson", action, actions)
    if doing == "list":
        for name, each in shipped_lessons().items():
            print(f"{name:24s} {each.head.minutes:3.0f} min  {each.head.title}")
        return DONE
    if not lessons and doing == "run":
        raise ScenarioError("lesson run: no lesson; allowed: one or more (see `vsmrc lesson list`)")
    if figures is not None and doing != "run":
        raise ScenarioError(f"lesson {doing}: --figures {figures}; allowed: with `lesson run`")
    memory, problems = kept_memory(), 0
    for each in [load_lesson(name) for name in lessons or shipped_lessons()]:
        print(f"{each.name}: {each.head.title}")
        if doing == "check":
            checked = check(each, memory)
            problems += len(checked.problems)
            for problem in checked.problems:
                print(f"  {printable(problem)}")
            print(f"  about {checked.minutes:.0f} minutes, {len(checked.told)} numbers measured")
        else:
            course = Course(each, Notebook())
            for step in runs(each):
                outcome = play(step, memory)
                course.take(step, outcome)
                told = ", ".join(f"{name} = {value}" for name, value in outcome.told.items())
                ended = " ".join(filter(None, (outcome.refusal, outcome.stopped)))
                print(f"  {printable(getattr(step.block, 'title', ''))}: {told}  {printable(ended)}".rstrip())
                if figures is not None:
                    drawn = figure_of_run(each, step, outcome, course.traces(step), ())
                    path = figures / name_of_figure(each, step, "svg")
                    try:
                        figures.mkdir(parents=True, exist_ok=True)
                        write_whole(path, lambda file, drawn=drawn: file.write(render(drawn, "svg")))
                    except OSError as error:
                        raise ScenarioError(f"--figures {figures}: cannot be written: {error.strerror}") from error
                    print(f"  written: {path}")
    return BAD_INPUT if problems else DONE


def sweep(
    scenario: tyro.conf.Positional[str],
    folder: tyro.conf.Positional[Path | None] = None,
    /,
    *,
    vary: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    design: Annotated[str, tyro.conf.arg(metavar="{grid,latin,sobol}")] = "grid",
    points: int = 0,
    draw: int = 0,
    corners: bool = False,
    seed: int = 0,
    out: Path | None = None,
    duration: float | None = None,
    engine: Annotated[str, tyro.conf.arg(metavar=_braces(ENGINES))] = "compiled",
    workers: int | None = None,
    scheduler: str | None = None,
    dry_run: bool = False,
    of: str = "motion_error",
    within: float | None = None,
    show: Annotated[str | None, tyro.conf.arg(metavar="{share,median,worst}")] = None,
    over: tuple[str, ...] = (),
    kind: Annotated[str | None, tyro.conf.arg(name="as", metavar="{map,slices,scatter,parallel}")] = None,
    to: Annotated[str, tyro.conf.arg(metavar="{svg,pdf,png}")] = "svg",
    settings: Settings = (),
) -> int:
    """Simulate a scenario with many settings and true arms, on all cores; the same command goes on where it was
    stopped. `vsmrc sweep plot FOLDER` draws what was found.

    Args:
        scenario: a shipped scenario, a .toml file, or a sweep.toml; or the word plot
        folder: of a sweep, for plot
        vary: PATH=LOW:HIGH:COUNT, with :log behind for even steps of the logarithm, or PATH=VALUE,VALUE; PATH=LOW:HIGH
            for a design other than the grid
        design: the grid of all values, or so many points by a Latin hypercube or Sobol's sequence
        points: of such a design
        draw: true arms drawn inside the declared set, the same at every point
        corners: draw them at its corners
        seed: of arms and points
        out: folder for the runs; for plot, the file
        duration: simulated time of each run in s, instead of the scenario's
        engine: compiled, or pinocchio, whose digits differ by rounding
        workers: processes, instead of one for each core
        scheduler: tcp://HOST:PORT of a Dask scheduler, whose workers compute the runs (docs/scale.md)
        dry_run: only say what it would take
        of: for plot, the metric (docs/sweeps.md)
        within: for plot, a limit in SI units: the share of arms that keep it is shown
        show: for plot, what is shown of the arms of a point
        over: for plot, the fields that are the axes
        kind: for plot, the chart
        to: for plot, the form of the file
    """
    if scenario == "plot":
        return _plot_sweep(folder, out, of, within, show, over, kind, to)
    if folder is not None:
        raise ScenarioError(f"sweep: {folder} behind a scenario; allowed: `vsmrc sweep plot FOLDER`")
    from app.sweep import question, running
    from app.sweep.cluster import Cluster

    program = question.fingerprint()
    if scenario.endswith(question.FILE):
        if vary or draw or settings or points or duration is not None:
            raise ScenarioError(f"sweep: {scenario} is the whole question; allowed: without --vary, --draw, --set, ...")
        asked = question.read(Path(scenario))
    else:
        asked = question.Sweep(
            scenario=_configured(scenario, settings, duration),
            vary=tuple(map(question.axis_of, vary)),
            design=one_of("--design", design, get_args(question.Design)),
            points=points,
            draw=draw,
            corners=corners,
            seed=seed,
            engine=one_of("--engine", engine, ENGINES),
            program=program,
        )
    if asked.program != program:
        raise ScenarioError(f"sweep: {scenario} was asked of another version of the program; allowed: ask it anew")
    if min(points, draw, seed) < 0 or (workers is not None and workers < 1):
        raise ScenarioError("--points, --draw, --seed: allowed: 0 or more; --workers: 1 or more")
    if scheduler is not None and workers is not None:
        raise ScenarioError("--workers beside --scheduler; allowed: one of them: a cluster has workers of its own")
    count = question.Question(asked).count
    if out is None and not dry_run:
        raise ScenarioError("sweep: no folder for the runs; allowed: --out FOLDER, or --dry-run")
    with Cluster(scheduler) if scheduler is not None else nullcontext(workers) as on:
        if out is None or dry_run:
            print(running.estimated(asked, count, on))
            return DONE
        return _sweep_into(out, asked, on)


def _sweep_into(out: Path, asked: Sweep, on: int | Cluster | None) -> int:
    from app.sweep import running
    from app.sweep.run_store import RunStore

    try:
        with RunStore(out, asked) as store:
            count, left = len(store.done), int((~store.done).sum())
            if left < count:
                print(f"{count - left} of {count} runs are there already")
            print(running.estimated(asked, left, on))
            try:
                failed = running.run(store, asked, on, show_progress=True)
            except KeyboardInterrupt:
                print(f"stopped with {int(store.done.sum())} of {count} runs; the same command goes on")
                raise
    except OSError as error:
        raise ScenarioError(f"--out {out}: cannot be written: {error.strerror}; what is there stays") from error
    print(f"{count} runs in {out}" + (f", {failed} of the last {left} stopped or refused" if failed else ""))
    return DONE


def _plot_sweep(
    folder: Path | None,
    out: Path | None,
    of: str,
    within: float | None,
    show: str | None,
    over: tuple[str, ...],
    kind: str | None,
    to: str,
) -> int:
    from app.export.formats import Format
    from app.process.atomic_write import write_whole
    from app.sweep import charts, points
    from app.sweep.run_store import table_of

    if folder is None:
        raise ScenarioError("sweep plot: no folder; allowed: the folder of a sweep")
    form: Format = one_of("--to", to, get_args(Format))
    view = points.View(
        metric=of,
        within=within,
        statistic=None if show is None else one_of("--show", show, get_args(points.Statistic)),
        over=over,
        kind=None if kind is None else one_of("--as", kind, get_args(points.Kind)),
    )
    path, drawn = out or folder / f"{of}.{form}", charts.chart(*table_of(folder), view, form)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda file: file.write(drawn))
    except OSError as error:
        raise ScenarioError(f"--out {path}: cannot be written: {error.strerror}") from error
    print(f"written: {path}")
    return DONE


def tune(
    scenario: Annotated[str, tyro.conf.Positional],
    /,
    *,
    move: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    aims: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(name="for", metavar="METRIC")] = (),
    draw: int = 0,
    budget: int = 120,
    unseen: int = 32,
    seed: int = 0,
    out: Path | None = None,
    duration: float | None = None,
    workers: int | None = None,
    dry_run: bool = False,
    settings: Settings = (),
) -> int:
    """Search for better gains of a scenario, judged by the worst of many true arms, and try them on arms that the
    search has not seen; the same command goes on where it was stopped.

    Args:
        scenario: a shipped scenario or a .toml file, whose gains are to be beaten
        move: gain that may move, PATH=LOW:HIGH, with :log behind where its logarithm is to be drawn evenly
        aims: figure that counts, the smaller the better (docs/tuning.md); two give a front
        draw: true arms drawn inside the declared set, the same for every candidate; 0: the scenario's own one
        budget: candidates besides the scenario's own gains
        unseen: further true arms, on which the own gains and those that are offered are compared
        seed: of arms and search: the same seed gives the same answer, with any number of processes
        out: folder for the runs, the scenarios that are offered, and a figure
        duration: simulated time of each run in s, instead of the scenario's
        workers: processes, instead of one for each core
        dry_run: only say what it would take
    """
    from app.tune import question, running

    for name, given, least in (("draw", draw, 0), ("budget", budget, 1), ("unseen", unseen, 1), ("seed", seed, 0)):
        if given < least:
            raise ScenarioError(f"--{name} {given}; allowed: {least} or more")
    if workers is not None and workers < 1:
        raise ScenarioError(f"--workers {workers}; allowed: 1 or more")
    asked = question.Tuning(
        scenario=_configured(scenario, settings, duration),
        vary=tuple(map(question.moved, move)),
        points=budget + 1,
        draw=draw,
        seed=seed,
        program=question.program(),
        aims=aims,
        unseen=unseen,
    )
    question.require_sound(asked)
    if dry_run:
        print(f"at most {running.estimated(asked, running.most_runs(asked), workers)}")
        return DONE
    if out is None:
        raise ScenarioError("tune: no folder for the runs; allowed: --out FOLDER, or --dry-run")
    return _tune_into(out, asked, workers)


def _tune_into(out: Path, asked: Tuning, workers: int | None) -> int:
    from app.sweep.run_store import RunStore
    from app.tune import outcome, running

    try:
        with RunStore(out, asked) as store:
            if done := int(store.done.sum()):
                print(f"{done} runs are there already")
            else:
                print(f"at most {running.estimated(asked, running.most_runs(asked), workers)}")
            try:
                found = running.run(store, asked, workers, show_progress=True)
            except KeyboardInterrupt:
                print(f"stopped with {int(store.done.sum())} runs; the same command goes on")
                raise
            outcome.write(asked, found, out)
    except OSError as error:
        raise ScenarioError(f"--out {out}: cannot be written: {error.strerror}; what is there stays") from error
    head, *rows = outcome.told(asked, found)
    table = Table(*map(escape, head))
    for row in rows:
        table.add_row(*map(escape, row))
    Console().print(table)
    for sentence in outcome.verdict(asked, found):
        print(sentence)
    print(f"written to {out}")
    return DONE


def list_() -> int:
    """Show the robots and the scenarios."""
    from environments.robots import CATALOGUE

    print("robots")
    for name, entry in CATALOGUE.items():
        print(f"  {name:34s} {entry.title}")
    print("scenarios")
    for name, scenario in shipped().items():
        print(f"  {name:34s} {scenario.title}")
    return DONE


def _inches(flag: str, text: str | None) -> float | None:
    """Length of a flag in inches, None without one. Raises ValueError."""
    from app.export.figures import inches_of

    try:
        return None if text is None else inches_of(text)
    except ValueError as error:
        raise ValueError(f"{flag} {error}") from error


def _use(files: tuple[Path, ...]) -> None:
    if files:
        from app.process import own_code

        own_code.use(files)


def _configured(name_or_file: str, settings: Settings, duration: float | None = None) -> Scenario:
    scenario = load(name_or_file)
    changes = [_setting(setting) for group in settings for setting in group]
    # the arm first, all its fields at once: everything else may depend on it
    if robot := {path.removeprefix("robot."): value for path, value in changes if path.startswith("robot.")}:
        from app.session.changes import with_robot

        scenario = with_robot(scenario, robot)
    for path, value in changes:
        if not path.startswith("robot."):
            scenario = edited(scenario, path, value)
    if scenario.controller.law not in KINDS:
        from app.simulation.controller_builder import law_of

        law_of(scenario)
    return scenario if duration is None else edited(scenario, "simulation.duration", duration)


def _setting(text: str) -> tuple[str, object]:
    path, equals, value = text.partition("=")
    if not equals:
        raise ScenarioError(f"--set {text}: no '='; allowed: KEY=VALUE")
    return path.strip(), _value(value.strip())


def _value(text: str) -> object:
    """TOML value of a text; a text that is no TOML value is taken as it is."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def _shown(value: object) -> str:
    if isinstance(value, list):
        return "  ".join(_shown(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float) else "—" if value is None else str(value)


def execute(arguments: list[str]) -> int:
    """Exit status of the command with these arguments, as `app.__main__` has it. Raises KeyboardInterrupt."""
    log.configure_as_parent()
    commands = {
        "serve": serve,
        "run": run,
        "compare": compare,
        "export": export,
        "response": response,
        "sweep": sweep,
        "tune": tune,
        "figures": figures,
        "lesson": lesson,
        "list": list_,
    }
    if not arguments or (arguments[0].startswith("-") and arguments[0] not in ("-h", "--help")):
        arguments = ["serve", *arguments]
    if arguments[0] not in (*commands, "-h", "--help"):
        print(f"vsmrc: {printable(arguments[0])}: no such command; {allowed(arguments[0], commands)}", file=sys.stderr)
        return BAD_INPUT
    try:
        return tyro.extras.subcommand_cli_from_dict(commands, args=arguments, prog="vsmrc")
    except (ScenarioError, PortTaken) as error:
        print(f"vsmrc: {printable(str(error))}", file=sys.stderr)
        return BAD_INPUT
    except Exception as error:
        events.info("fault", stage=arguments[0], exc_info=error)
        print(f"vsmrc: internal error: {printable(f'{type(error).__name__}: {error}')}", file=sys.stderr)
        return FAULT
