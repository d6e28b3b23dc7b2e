"""Atomic write: whoever reads meanwhile sees one of the written values, whole."""

from __future__ import annotations

import threading
from pathlib import Path

from app.process.atomic_write import write_whole

ROUNDS = 100


def test_threads_that_write_one_file_leave_it_whole(tmp_path: Path) -> None:
    file, faults = tmp_path / "progress.json", list[str]()
    contents = [letter * 200_000 for letter in (b"a", b"b")]
    write_whole(file, lambda into: into.write(contents[0]))

    def write(content: bytes) -> None:
        try:
            for _ in range(ROUNDS):
                write_whole(file, lambda into: into.write(content), synced=False)
        except OSError as error:
            faults.append(str(error))

    writers = [threading.Thread(target=write, args=(content,)) for content in contents]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        if file.read_bytes() not in contents:
            faults.append("torn")
    assert not faults
    assert list(tmp_path.iterdir()) == [file]
