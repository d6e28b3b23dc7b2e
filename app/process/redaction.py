"""Redaction of secrets (tokens, links, cookies, keys) from text that is to be written down.

Secrets are recognized by their context and, in any context, by their form: runs of 22 or more characters with capital
and small letters mixed as no name mixes them. `new_secret` draws only secrets of this form.
"""

from __future__ import annotations

import re
import secrets

SHORTEST = 22  # characters of a secret: 128 bits
HIDDEN = "[hidden]"

_NAMED = re.compile(
    r"""((?:token|vsmrc-(?:token|steer|session|visitor)-\d+|x-vsmrc-key)(?:=|%3d|:\s*)  # an address, a cookie, a header
        |/(?:s|watch|class|shared|everyone)/)                                     # a link, a folder
        [^\s/;,&'"\\?\#]+""",
    re.IGNORECASE | re.VERBOSE,
)
_LONG = re.compile(rf"[A-Za-z0-9_-]{{{SHORTEST},}}")
_NAME = re.compile(r"[a-z0-9_-]+|[A-Z0-9_-]+|_*(?:[A-Z][a-z]{2,})+")  # of a file, a scenario, a function, a class


def new_secret(size: int = 32) -> str:
    """Secret of `size` random bytes as characters of an address, one that `redacted` cannot take for a name."""
    while _NAME.fullmatch(secret := secrets.token_urlsafe(size)):
        pass
    return secret


def redacted(text: str) -> str:
    """The text without its secrets."""
    named = _NAMED.sub(rf"\1{HIDDEN}", text)
    return _LONG.sub(lambda found: found[0] if _NAME.fullmatch(found[0]) else HIDDEN, named)
