"""Chromium for the browser tests: an installed one, else Playwright's, else Debian's.

`python -m drivers.browser` finds or installs it before the tests start, so that no two workers install it at once.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import Error, sync_playwright

# WebGL in software, as not every machine has a graphics card, and no requests to Google.
LAUNCH_ARGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-unsafe-swiftshader",
)
ON_PATH = ("chromium", "chromium-browser", "google-chrome")


class NoBrowserError(RuntimeError):
    """Error of a machine on which no Chromium is installed, and none could be installed."""


def find_or_install() -> Path | None:
    """Path of the browser's executable, installed where it is missing; None for the one that Playwright finds
    itself."""
    if named := os.environ.get("VSMRC_CHROMIUM"):
        if not shutil.which(named):
            raise NoBrowserError(f"VSMRC_CHROMIUM is {named!r}, which cannot be executed.")
        return Path(named)
    if present := _on_path():
        return present
    if _playwright_starts() or (_install_playwrights() and _playwright_starts()):
        return None
    if _install_debians() and (installed := _on_path()):
        return installed
    raise NoBrowserError(
        "No browser for the tests: install Chromium, or set VSMRC_CHROMIUM to one "
        "(neither Playwright's download nor Debian's package could be installed here)."
    )


def _on_path() -> Path | None:
    return next((Path(found) for name in ON_PATH if (found := shutil.which(name))), None)


def _playwright_starts() -> bool:
    """Whether Playwright's browser starts: on a bare machine its libraries may be missing."""
    with sync_playwright() as playwright:
        try:
            playwright.chromium.launch(args=LAUNCH_ARGS).close()
        except Error:
            return False
    return True


def _install_playwrights() -> bool:
    return _succeeds(sys.executable, "-m", "playwright", "install", "chromium")


def _install_debians() -> bool:
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        return False
    apt_get = ("apt-get", "-qq", "-o", "DPkg::Lock::Timeout=300")
    _succeeds(*apt_get, "update")  # a failure is ignored, since an old list may still hold the package
    return _succeeds(*apt_get, "install", "--yes", "--no-install-recommends", "chromium")


def _succeeds(*command: str) -> bool:
    print("drivers.browser:", *command, flush=True)
    quiet = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    return subprocess.run(command, env=quiet, stdin=subprocess.DEVNULL).returncode == 0


if __name__ == "__main__":
    try:
        print("drivers.browser:", find_or_install() or "Playwright's own Chromium")
    except NoBrowserError as error:
        sys.exit(str(error))
