"""What is read as code or as one's own: folders in which other users of the machine have no hand."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from app.dashboard import local_server
from app.gateway.session_store import SessionStore
from app.process import kernel_cache
from app.process.private_folder import NotOwnError, own, private
from app.scenario.data import load
from app.scenario.errors import ScenarioError
from app.storage import uploaded_urdfs
from app.storage.session_index import StateError, occupied

pytestmark = pytest.mark.slow  # processes of its own

OTHER = 65_534  # "nobody"
ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder to another user")
TELL = "import os, app, app.process.kernel_cache as k; print(os.environ[k.VARIABLE])"
INHERIT = f"import app, subprocess, sys; subprocess.run([sys.executable, '-c', {TELL!r}]); exec({TELL!r})"


def by_link(path: Path) -> None:
    (target := path.with_name("elsewhere")).mkdir()
    path.symlink_to(target)


def writable_by_all(path: Path) -> None:
    path.mkdir()
    path.chmod(0o777)


def anothers(path: Path) -> None:
    path.mkdir()
    os.chown(path, OTHER, OTHER)


def below_anothers(path: Path) -> None:
    path.mkdir()
    os.chown(path.parent, OTHER, OTHER)


def below_one_for_all(path: Path) -> None:
    path.mkdir()
    path.parent.chmod(0o777)


PLANTED = [
    (by_link, "is a symbolic link"),
    (writable_by_all, r"can be written by others \(mode 777\)"),
    (below_one_for_all, "is below .*, in which others can put another folder"),
    pytest.param(anothers, f"belongs to another user .uid {OTHER}.", marks=ROOT),
    pytest.param(below_anothers, "is below .*, in which others can put another folder", marks=ROOT),
]


@pytest.mark.parametrize(("plant", "message"), PLANTED)
def test_a_folder_in_which_others_have_a_hand_is_neither_trusted_nor_used(
    plant: Callable[[Path], None], message: str, tmp_path: Path
) -> None:
    folder = tmp_path / "shelf" / "vsmrc-lab"
    folder.parent.mkdir()
    plant(folder)
    with pytest.raises(NotOwnError, match=message):
        own(folder)
    with pytest.raises(
        StateError, match=f"--state-dir .*: {message}.*; allowed: a folder that only its owner can write"
    ):
        occupied(folder)
    with pytest.raises(StateError, match=message):
        SessionStore(folder / "shared")
    assert not list(folder.iterdir())
    folders = kernels_of(INHERIT, XDG_CACHE_HOME=str(folder.parent))
    assert len(set(folders)) == 1  # the processes beside use the same one
    assert folder not in Path(folders[0]).parents
    assert not Path(folders[0]).exists()  # it has ended with its maker


def test_ones_own_folder_is_made_private_and_lasts(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "vsmrc-lab"
    assert own(folder).stat().st_mode & 0o777 == 0o700
    folder.chmod(0o755)
    assert private(folder).stat().st_mode & 0o777 == 0o700
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "new")  # a link above may be anything: its target is looked at, and used
    assert own(link / "vsmrc-lab") == folder.resolve()
    folders = kernels_of(TELL, XDG_CACHE_HOME=str(tmp_path / "new"))
    assert Path(folders[0]).parent == folder
    assert Path(folders[0]).stat().st_mode & 0o777 == 0o700


def test_without_a_home_that_can_be_written_no_shared_folder_is_used(tmp_path: Path) -> None:
    """The folder that others could foresee below the temporary one, as it was planted once."""
    (tmp_path / "vsmrc-lab").mkdir(mode=0o777)
    folders = kernels_of(INHERIT, XDG_CACHE_HOME="/dev/null/none", TMPDIR=str(tmp_path))
    assert len(set(folders)) == 1
    assert Path(folders[0]).parent == tmp_path
    assert Path(folders[0]).name != "vsmrc-lab"
    assert not list((tmp_path / "vsmrc-lab").iterdir())


def test_a_user_without_a_home_has_a_session_that_is_not_kept_and_no_uploads(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", homeless)
    for variable in ("XDG_CACHE_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.delenv(kernel_cache.VARIABLE, raising=False)
    kernel_cache.choose()
    assert Path(os.environ[kernel_cache.VARIABLE]).name.startswith("vsmrc-kernels-")  # only for this process
    assert capsys.readouterr().err == (
        "vsmrc: the user's cache cannot be written: there is no home folder; allowed: with HOME or XDG_CACHE_HOME; "
        "compiled kernels are not kept for the next start\n"
    )
    assert local_server._state_folder(None) is None
    notice = "this session is not kept: there is no home folder; allowed: with HOME or XDG_STATE_HOME\n"
    assert capsys.readouterr().out == notice
    arm = (Path(__file__).parents[1] / "support" / "robots" / "bent3r.urdf").read_bytes()
    refusal = "robot.urdf: arm.urdf cannot be kept: there is no home folder; allowed: with HOME or XDG_DATA_HOME"
    with pytest.raises(ScenarioError, match=f"^{refusal}$"):
        uploaded_urdfs.keep("arm.urdf", arm)
    with pytest.raises(ScenarioError, match="not on this server; allowed: a URDF that was uploaded"):
        uploaded_urdfs.FileAccess().require("/some/arm.urdf")
    (file := tmp_path / "arm.urdf").touch()
    before = file.stat().st_mtime_ns
    uploaded_urdfs.note_use(str(file))
    uploaded_urdfs.lock_while_used(load("ur5-motion").robot, str(file))  # pyright: ignore[reportArgumentType]
    assert file.stat().st_mtime_ns == before


def test_temporary_folders_of_killed_processes_are_removed_at_start(tmp_path: Path) -> None:
    """Killed or alive, own or planted: only what nobody holds any more is removed."""
    environment = os.environ | {"XDG_CACHE_HOME": "/dev/null/none", "TMPDIR": str(tmp_path)}
    environment.pop("NUMBA_CACHE_DIR", None)
    waiting = f"{TELL}; sys.stdout.flush(); sys.stdin.read()".replace("import os,", "import os, sys,")
    began = [
        subprocess.Popen(
            [sys.executable, "-c", waiting], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    killed, alive = (Path(process.stdout.readline().strip()) for process in began if process.stdout)
    began[0].kill()
    began[0].wait()
    (killed / "kernel").write_text("")
    (kept := tmp_path / "kept").mkdir(mode=0o700)
    (kept / "file").write_text("")
    (tmp_path / "vsmrc-kernels-link").symlink_to(kept)
    (tmp_path / "vsmrc-kernels-open").mkdir(mode=0o755)
    (tmp_path / "vsmrc-kernels-file").write_text("")
    others = [] if os.geteuid() else [tmp_path / "vsmrc-kernels-theirs"]
    for folder in others:
        folder.mkdir(mode=0o700)
        os.chown(folder, OTHER, OTHER)
    assert killed.exists()
    (own_one,) = kernels_of(TELL, XDG_CACHE_HOME="/dev/null/none", TMPDIR=str(tmp_path))
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {
        alive.name, "kept", *(f"vsmrc-kernels-{what}" for what in ("link", "open", "file")), *(o.name for o in others)
    }  # fmt: skip
    assert (kept / "file").exists()
    assert own_one not in (str(killed), str(alive))
    began[1].communicate(timeout=60)
    assert not alive.exists()


def kernels_of(program: str, **environment: str) -> list[str]:
    """What a program prints of where its kernels are kept."""
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=inherited | environment, capture_output=True, text=True, check=True
    )
    return done.stdout.split()
