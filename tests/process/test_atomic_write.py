"""Atomic write: whoever reads meanwhile sees one of the written values, whole."""

from __future__ import annotations

import errno
import os
import stat
import threading
from pathlib import Path

import pytest

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


def test_a_folder_that_cannot_be_flushed_is_no_reason_to_call_the_file_unwritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flush = os.fsync

    def of_files_only(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        flush(descriptor)

    def of_nothing(_: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    file = tmp_path / "link.json"
    monkeypatch.setattr(os, "fsync", of_files_only)
    write_whole(file, lambda into: into.write(b"new"))
    assert file.read_bytes() == b"new"
    monkeypatch.setattr(os, "fsync", of_nothing)
    with pytest.raises(OSError, match="Input/output error"):
        write_whole(file, lambda into: into.write(b"newer"))
    assert file.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [file]
