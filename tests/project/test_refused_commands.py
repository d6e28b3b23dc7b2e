"""Wrong input to the `vsmrc` command: one sentence that names it and what is allowed."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from app.cli.commands import COMMANDS
from tests.support.commands import Done, vsmrc

pytestmark = pytest.mark.slow  # processes of its own


def test_a_frame_rate_that_makes_no_sense_is_refused(here: Callable[..., Done]) -> None:
    done = here("serve", "--port", "0", "--fps", "0")
    assert done.returncode == 2
    assert "--fps: 0; allowed: 1 to 60" in done.stderr


def test_a_misspelt_choice_of_a_flag_is_refused_with_what_was_meant(here: Callable[..., Done]) -> None:
    for arguments, message in (
        (("serve", "--theme", "drak"), "--theme 'drak'; allowed: dark, light; did you mean dark?"),
        (
            ("serve", "--log-level", "inf"),
            "--log-level 'inf'; allowed: debug, info, warning, error; did you mean info?",
        ),
        (("serve", "--token", "allways"), "did you mean always?"),
        (("compare", "ur5-hybrid", "--engine", "compild"), "allowed: pinocchio, compiled; did you mean compiled?"),
        (("figures", "--out", "x", "--only", "theorm"), "did you mean theorem?"),
    ):
        done = here(*arguments)
        assert done.returncode == 2
        assert message in done.stderr
        assert done.stderr.count("\n") == 1


def test_a_port_that_is_none_is_refused(here: Callable[..., Done]) -> None:
    for port, command in (("70000", vsmrc), ("-1", here)):
        done = command("serve", "--port", port)
        assert (done.returncode, done.stderr) == (2, f"vsmrc: --port {port}; allowed: 0 to 65535\n")


def test_limits_of_many_sessions_are_refused_where_there_is_one(here: Callable[..., Done]) -> None:
    for option in ("--max-sessions", "--per-address", "--idle-minutes"):
        done = here("serve", "--port", "0", option, "3")
        assert done.returncode == 2
        assert done.stderr == f"vsmrc: {option}: this server has one session; allowed: with --shared\n"


@pytest.mark.parametrize("command", ["run", "export", "response", "sweep"])
def test_a_folder_without_a_name_is_refused(command: str, here: Callable[..., Done]) -> None:
    for out in (("--out", ""), ("--out=",)):  # a variable of a script that is not set
        done = here(command, "ur5-hybrid", *out)
        assert (done.returncode, done.stderr) == (
            2,
            "vsmrc: --out: an empty text; allowed: the name of a folder\n",
        )


def test_an_unknown_law_may_be_in_a_file_for_the_commands_that_take_one(here: Callable[..., Done]) -> None:
    done = here("sweep", "ur5-hybrid", "--set", "controller.law=mine", "--dry-run")
    named = re.search(r"by --use FILE of ([\w, ]+)\)", done.stderr)
    assert named
    takers = {name for name, command in COMMANDS.items() if "use" in inspect.signature(command).parameters}
    assert set(re.findall(r"\w+", named[1])) - {"and"} == takers


def test_nothing_to_compare_is_said(here: Callable[..., Done]) -> None:
    for arguments, message in (
        ((), "compare: no scenario"),
        (("ur5-hybrid", "--last", "-1"), "allowed: more than 0 s"),
    ):
        done = here("compare", *arguments)
        assert done.returncode == 2
        assert message in done.stderr


def test_a_part_of_the_run_without_figures_is_refused_and_the_least_one_has_them(here: Callable[..., Done]) -> None:
    for arguments, message in (
        (("--last", "0.0005"), "--last 0.0005: fewer than two control periods of planar3r-hybrid; allowed: 0.002 s or"),
        (("--last", "0.0019"), "--last 0.0019: fewer than two control periods of planar3r-hybrid; allowed: 0.002 s or"),
        (("--duration", "0.001"), "simulation.duration: 0.001: fewer than two control periods of planar3r-hybrid"),
        (("--last", "0.002", "--set", "controller.period=0.002"), "allowed: 0.004 s or more"),
    ):
        done = here("compare", "planar3r-hybrid", *arguments)
        assert done.returncode == 2
        assert message in done.stderr
        assert done.stderr.count("\n") == 1
    for duration in ("0.002", "0.013", "0.3"):  # whatever the instants of the rows are rounded to
        done = here("compare", "planar3r-hybrid", "--duration", duration, "--last", "0.002")
        assert done.returncode == 0, done.stderr
        figures = {
            line.split("│")[1].strip(): line.split("│")[2].strip() for line in done.stdout.splitlines() if "│" in line
        }
        assert re.fullmatch(r"[\d.]+(·10⁻.)?", figures["path error, RMS [mm]"]), duration


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "FILE.toml", "--out", "OUT"),
        ("run", "ur5-hybrid", "--blend-to", "FILE.toml", "--out", "OUT"),
        ("run", "ur5-hybrid", "--use", "FILE.py", "--out", "OUT"),
        ("run", "ur5-hybrid", "--set", "robot.urdf=FILE.urdf", "--out", "OUT"),
        ("run", "--from", "FOLDER", "--row", "0", "--out", "OUT"),
        ("compare", "FILE.toml"),
        ("export", "FILE.toml", "--out", "OUT"),
        ("response", "FILE.toml", "--out", "OUT"),
        ("serve", "FILE.toml", "--port", "0"),
        ("sweep", "FILE.toml", "--dry-run"),
        ("sweep", "FOLDER/sweep.toml", "--out", "OUT"),
        ("sweep", "plot", "FOLDER"),
        ("tune", "FILE.toml", "--dry-run"),
        ("lesson", "check", "FOLDER"),
        ("lesson", "run", "FOLDER/lesson.md"),
    ],
)
def test_a_text_that_is_not_in_utf_8_is_refused_with_the_files_name(
    arguments: tuple[str, ...], tmp_path: Path, here: Callable[..., Done]
) -> None:
    for name in ("file.toml", "file.py", "file.urdf", "sweep.toml", "lesson.md"):
        (tmp_path / name).write_bytes("name = 'f\xfcnf'\n".encode("latin-1"))
    places = {"FILE": str(tmp_path / "file"), "FOLDER": str(tmp_path), "OUT": str(tmp_path / "out")}
    typed = [re.sub("FILE|FOLDER|OUT", lambda found: places[found[0]], each) for each in arguments]
    done = here(*typed)
    assert done.returncode == 2
    assert re.search(r"\bfile\.|sweep\.toml|lesson\.md", done.stderr)
    assert ("utf-8" if "FILE.py" in arguments else "UTF-8") in done.stderr  # Python's own sentence
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "nothing"), "allowed: a .toml file or"),
        (("run", "ur5-hybird"), "; did you mean ur5-hybrid?"),
        (
            ("run", "docs/examples/cone.py"),
            "scenario 'docs/examples/cone.py': is no .toml file; allowed: a file whose name ends in .toml, or a name "
            "of `vsmrc list`\n",
        ),
        (("run", "."), "scenario '.': is a folder; allowed: a file whose name ends in .toml"),
        (("run", "ur5-hybrid", "--blend-to", "docs"), "scenario 'docs': is a folder; allowed: a file whose name"),
        (("run", "UR5-Motion"), "; did you mean ur5-motion?"),
        (
            ("exprt", "ur5-hybrid"),
            "no such command; allowed: serve, run, compare, export, response, sweep, tune, figures, lesson, list; did",
        ),
        (("sweep", "ur5-hybrid", "--vary", "contact.K_e=1e4:1e5:3", "--draw", "-1"), "--draw -1; allowed: 0 or more"),
        (("tune", "ur5-hybrid", "--seed", "5000000000"), "--seed 5000000000; allowed: at most 4294967295"),
        (
            ("run", "ur5-hybrid", "--blend-to", "ur5-hybrid-moving"),
            "blend.to: ur5-hybrid-moving has the target model of ur5-hybrid; allowed: another one",
        ),
        (
            ("run", "ur5-hybrid", "--blend-to", "ur5-hybrid-moving", "--blend-at", "2", "--duration", "1"),
            "--blend-at 2: the run ends at 1 s; allowed: an instant before",
        ),
        (
            ("run", "ur5-hybrid", "--duration", "1e-5"),
            "simulation.duration: 10⁻⁵ s; allowed: at least a control period, 0.001 s",
        ),
        (("run", "ur5-hybrid", "--blend-at", "3"), "--blend-at or --blend-over without --blend-to; allowed: with"),
        # also where the value is the one that the option has without
        (("run", "ur5-hybrid", "--blend-at", "0"), "--blend-at or --blend-over without --blend-to; allowed: with"),
        (("export", "ur5-hybrid", "--to", "csv", "--type-size", "7"), "--type-size: with --to csv; allowed: with --to"),
        (
            ("export", "ur5-hybrid", "--to", "csv", "--no-letters"),
            "--no-letters: with --to csv; allowed: with --to svg",
        ),
        (("export", "ur5-hybrid", "--to", "csv", "--caption"), "--caption: with --to csv; allowed: with --to svg, pdf"),
        (("export", "ur5-hybrid", "--end", "-1"), "--start, --end: from 0 to -1 s; allowed: the start before the end"),
        (("export", "ur5-hybrid", "--end", "-inf"), "--end: -inf; allowed: an instant of the run in s"),
        (("export", "ur5-hybrid", "--start", "inf"), "--start: inf; allowed: an instant of the run in s"),
        (("export", "ur5-hybrid", "--height", "single"), "--height 'single': the width of a column or a page; allowed"),
        (
            ("run", "ur5-corner", "--set", "second.surface.kind=sphere", "force.value=30\nfoo=3"),
            "force.value: '30\\nfoo=3'; allowed: a number",
        ),
        (
            ("sweep", "ur5-hybrid", "--set", "motion.period=3", "--vary", "motion=circle,line"),
            "--set motion.period: motion is varied, too; allowed: one of both",
        ),
        (
            ("response", "planar2r-semicircle", "--measure", "2", "--newton-metres", "5"),
            "--newton-metres 5: no moment acts on a coordinate of planar2r-semicircle; allowed: --newtons",
        ),
        (("export", "ur5-hybrid", "--to", "toml", "--start", "0"), "--start: with --to toml; allowed: with --to svg"),
        (
            ("export", "a.npz", "--engine", "pinocchio"),
            "--engine pinocchio: a recording is not computed again; allowed",
        ),
        (("sweep", "ur5-hybrid", "--vary", "robot.urdf=\udcff"), "robot.urdf: '\\udcff'; allowed: a text in UTF-8"),
        (("response", "ur5-hybrid", "--at", "1e9"), "--at 10⁹: allowed: 0 to 10 s, the duration of the run"),
        (("run", "ur5-hybrid", "--duration", "abc"), "vsmrc: --duration 'abc'; allowed: a number\n"),
        (("run", "ur5-hybrid", "--duration=None"), "vsmrc: --duration 'None'; allowed: a number\n"),
        (("run", "--row", "x"), "vsmrc: --row 'x'; allowed: a whole number\n"),
        (("run", "ur5-hybrid", "--durtion", "3"), "vsmrc: run: --durtion: no such option; allowed: --out, --from"),
        (("run", "ur5-hybrid", "--durtion", "3"), "; did you mean --duration?"),
        (
            ("sweep", "map", "--of", "residual"),
            "vsmrc: sweep: --of: no such option; allowed: with `vsmrc sweep plot`\n",
        ),
        (
            ("sweep", "plot", "map", "--vary", "x=1,2"),
            "sweep plot: --vary: no such option; allowed: with `vsmrc sweep`",
        ),
        (("export",), "vsmrc: export: no run; allowed: one, see `vsmrc export --help`\n"),
        (("tune", "--budget", "3"), "vsmrc: tune: no scenario; allowed: one, see `vsmrc tune --help`\n"),
        (("export", "ur5-hybrid", "--to"), "--to: no value; allowed: svg, pdf, png, csv, npz, html, toml; one or more"),
        (("export", "ur5-hybrid", "--plots"), "--plots: no value; allowed: a text; one or more"),
        (("sweep", "plot", "map", "--over"), "--over: no value; allowed: a text; one or more"),
        (("sweep", "plot"), "sweep plot: no folder; allowed: the folder of a sweep"),
        (("sweep", "ur5-hybrid", "map"), "sweep: 'map' is one name too many; allowed: 1, see `vsmrc sweep --help`"),
        (("response", "ur5-hybrid", "--measure"), "--measure: no value; allowed: a number; one or more"),
        (("response", "ur5-hybrid", "--chirp", "1"), "--chirp: 1; allowed: 2 numbers"),
        (("figures", "--only"), "--only: no value; allowed: a text; one or more"),
        (("run", ""), "vsmrc: run: an empty text; allowed: a name, see `vsmrc run --help`"),
        (("run", "--from", "", "--row", "1"), "--from: an empty text; allowed: the name of a file or a folder"),
        (
            ("export", "ur5-hybrid", "--to", "csv", "--to", "toml"),
            "--to: --to was typed before; allowed: once, with all its values behind it\n",
        ),
        (("run", "ur5-hybrid", "--duration", "1", "--duration", "2"), "--duration was typed before; allowed: once\n"),
        (
            ("sweep", "ur5-hybrid", "--vary", "contact.K_e=1e3", "force.value=1,2"),
            "'force.value=1,2' is one name too many; allowed: 1, and --vary before each of its values, see",
        ),
        (
            ("sweep", "ur5-hybrid", "--vary", "contact.K_e=1e4:1e5:3", "--points", "0"),
            "--points: 0 in a grid; allowed: with --design latin or sobol",
        ),
        (
            ("response", "ur5-hybrid", "--measure", "1", "--newtons", "1e300"),
            "--newtons 10³⁰⁰: allowed: more than 0 N, at most 10⁶ N",
        ),
        (
            ("run", "--from", "map", "--row", "1", "--use", "docs/examples/pid_gravity.py"),
            "--from: with --use; allowed: the same run again, as it was\n",
        ),
        (
            ("response", "ur5-hybrid", "--newtons", "2"),
            "--newtons 2: nothing is pushed; allowed: with --measure or --ch",
        ),
        (
            ("sweep", "ur5-hybrid", "--vary", "contact.K_e=1e4:1e5:3", "--seed", "0"),
            "--seed 0: nothing is drawn; allowed: with --draw, or --design latin or sobol",
        ),
        (("run", "ur5-hybrid", "--row", "3"), "--row 3 without --from; allowed: --from FOLDER --row N"),
        (("run", "--from", "map"), "vsmrc: --from: without --row; allowed: --from FOLDER --row N\n"),
        (("run", "ur5-hybrid", "--from", "map"), "--from: with the scenario 'ur5-hybrid'; allowed: the same run again"),
        (("run", "--from", "map", "--row", "1", "--set", "mode=motion"), "--from: with --set; allowed: the same run"),
        (
            ("sweep", "ur5-hybrid", "--vary", "contact.K_e=1e3:1e5:9:log", "--design", "latin", "--points", "4"),
            "--vary contact.K_e: 1e3:1e5:9:log with --design latin, whose number of points is --points; allowed: "
            "contact.K_e=1e3:1e5:log, without a number of values\n",
        ),
        (("sweep", "any/sweep.toml", "--seed", "7"), "is the whole question; allowed: without --vary, --draw, --seed"),
    ],
)
def test_wrong_input_is_refused_in_one_sentence(
    arguments: tuple[str, ...], message: str, refuses: Callable[[tuple[str, ...], str], None]
) -> None:
    refuses(arguments, message)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("",), "vsmrc: an empty text: no such command; allowed: serve, run"),
        (("run", "ur5-hybrid"), "vsmrc: run: no --out; allowed: --out with the name of a folder\n"),
        (("serve", "--host", ""), "--host: an empty text; allowed: ADDRESS"),
        (("serve", "--host", " "), "--host ' ': no address; allowed: an address, 0.0.0.0 for all of this machine"),
        (("serve", "--no-copies"), "--no-copies: this server has one session; allowed: with --shared"),
        (
            ("serve", "--stateless", "--state-dir", "x"),
            "--state-dir x: --stateless keeps nothing; allowed: one of both",
        ),
        (
            ("serve", "--shared", "--max-sessions", "2", "--per-address", "3"),
            "--per-address 3; allowed: at most 2, as --max-sessions says",
        ),
        (("serve", "--state-dir", "README.md"), "--state-dir README.md: is a file; allowed: a folder"),
        (("serve", "--shared", "--copies", "--no-copies"), "--no-copies: --copies was typed before; allowed: once\n"),
        (("sweep", "plot", "map", "--out", "README.md/x.svg"), "--out README.md: is a file; allowed: a folder"),
        (
            ("compare", "planar3r-hybrid", "--last", "11"),
            "--last 11: longer than the run of planar3r-hybrid; allowed: at",
        ),
        (("lesson", "run", ""), "lesson run: an empty text; allowed: a name"),
    ],
)
def test_what_has_no_folder_is_refused_in_one_sentence_too(
    arguments: tuple[str, ...], message: str, here: Callable[..., Done]
) -> None:
    done = here(*arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "ur5-hybrid", "--out"),
        ("export", "ur5-hybrid", "--out"),
        ("response", "ur5-hybrid", "--out"),
        ("sweep", "ur5-hybrid", "--vary", "contact.K_e=1e4:1e5:3", "--out"),
        ("figures", "--out"),
        ("lesson", "run", "01-target-model", "--figures"),
    ],
)
def test_a_file_in_place_of_the_folder_is_refused_before_anything_runs(
    arguments: tuple[str, ...], tmp_path: Path, here: Callable[..., Done]
) -> None:
    (file := tmp_path / "file").write_text("")
    for out, named in ((file, ""), (file / "below", f"{file} ")):
        done = here(*arguments, str(out))
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == f"vsmrc: {arguments[-1]} {out}: {named}is a file; allowed: a folder\n"


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc, in which not even root can make a folder")
def test_a_folder_that_cannot_be_made_is_refused_before_anything_runs(here: Callable[..., Done]) -> None:
    done = here("run", "ur5-hybrid", "--out", "/proc/nothing")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("vsmrc: --out /proc/nothing: /proc cannot be written")
    assert done.stderr.count("\n") == 1  # no bar of a simulation either


def test_the_attempt_to_write_leaves_nothing(tmp_path: Path, here: Callable[..., Done]) -> None:
    assert here("run", "ur5-hybrid", "--duration", "1e-5", "--out", str(tmp_path / "a" / "b")).returncode == 2
    assert list(tmp_path.iterdir()) == []


def test_a_chart_goes_to_a_file_with_a_known_ending(tmp_path: Path, here: Callable[..., Done]) -> None:
    for out, message in (
        (tmp_path, "is a folder; allowed: a file"),
        (tmp_path / "x", "no ending; allowed: a name that ends in .svg, .pdf, .png"),
        (tmp_path / "x.jpg", "ends in .jpg; allowed: a name that ends in .svg, .pdf, .png"),
    ):
        done = here("sweep", "plot", str(tmp_path), "--out", str(out))
        assert (done.returncode, done.stderr) == (2, f"vsmrc: --out {out}: {message}\n")


def test_a_run_of_a_search_for_gains_cannot_be_repeated(tmp_path: Path, here: Callable[..., Done]) -> None:
    (tmp_path / "tune.toml").write_text("")
    done = here("run", "--from", str(tmp_path), "--row", "0", "--out", str(tmp_path / "out"))
    assert (done.returncode, done.stderr) == (
        2,
        f"vsmrc: --from {tmp_path}: holds runs of `vsmrc tune`, which cannot be repeated; allowed: the folder of a "
        "sweep\n",
    )
