"""The nginx that the tests of the proxy run: one that is there, else Debian's."""

import os
import shutil
import subprocess
from pathlib import Path

_WHERE = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/usr/local/sbin"])


class NoNginxError(RuntimeError):
    """There is no nginx, or no openssl for its certificate, and it could not be installed."""


def find_or_install() -> tuple[Path, Path]:
    """The executables of nginx and of openssl. Raises NoNginxError."""
    found = _found()
    if None in found and os.geteuid() == 0 and shutil.which("apt-get"):
        quiet = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
        apt_get = ("apt-get", "-qq", "-o", "DPkg::Lock::Timeout=300")
        for arguments in (("update",), ("install", "--yes", "--no-install-recommends", "nginx-light", "openssl")):
            print("tests.support.nginx:", *apt_get, *arguments, flush=True)
            subprocess.run([*apt_get, *arguments], env=quiet, stdin=subprocess.DEVNULL)
        found = _found()
    nginx, openssl = found
    if nginx is None or openssl is None:
        missing = " and ".join(name for name, path in (("nginx", nginx), ("openssl", openssl)) if path is None)
        raise NoNginxError(
            f"The tests of the proxy need {missing}: install it (Debian: apt install nginx-light openssl)."
        )
    return nginx, openssl


def _found() -> tuple[Path | None, Path | None]:
    nginx, openssl = (shutil.which(name, path=_WHERE) for name in ("nginx", "openssl"))
    return Path(nginx) if nginx else None, Path(openssl) if openssl else None
