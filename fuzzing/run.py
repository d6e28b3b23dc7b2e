"""Run of one target, in a process that a crash may end: `python -m fuzzing.run TARGET SECONDS FOLDER`."""

import sys
import tempfile
from importlib import import_module
from pathlib import Path

import atheris

from fuzzing import TARGETS

PATIENCE = 20  # s for one input: more is a finding
MEMORY = 3000  # MB: more is one, too


def main() -> None:
    name, seconds, found = sys.argv[1:]
    with atheris.instrument_imports(include=TARGETS[name], enable_loader_override=False):
        target = import_module(f"fuzzing.{name}")
    with tempfile.TemporaryDirectory(prefix="vsmrc-fuzz-") as folder:
        corpus, words = Path(folder) / "corpus", Path(folder) / "words"
        corpus.mkdir()
        for number, seed in enumerate(target.SEEDS):
            (corpus / str(number)).write_bytes(seed)
        words.write_text("".join(f'"{_quoted(word)}"\n' for word in target.DICTIONARY))
        options = (
            f"-max_total_time={seconds}",
            f"-timeout={PATIENCE}",
            f"-rss_limit_mb={MEMORY}",
            f"-artifact_prefix={found}/{name}-",
            f"-dict={words}",
            "-print_final_stats=1",
        )
        atheris.Setup([sys.argv[0], *options, str(corpus)], target.read)
        atheris.Fuzz()


def _quoted(word: str) -> str:
    return "".join(c if c.isascii() and c.isalnum() else "".join(f"\\x{b:02x}" for b in c.encode()) for c in word)


if __name__ == "__main__":
    main()
