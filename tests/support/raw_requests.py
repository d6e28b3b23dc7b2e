"""Bytes at a port: requests that no library would send."""

from __future__ import annotations

import socket

from drivers.visitors import PATIENCE


def answer_to(port: int, request: bytes) -> bytes:
    """All that comes back until the other side ends the connection, as the request is to make it."""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as connection:
        connection.sendall(request)
        answer = b""
        try:
            while more := connection.recv(65536):
                answer += more
        except ConnectionResetError:  # it was not read to its end
            pass
    return answer
