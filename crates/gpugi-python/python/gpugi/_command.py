"""The command, for what has no function of its own."""

from __future__ import annotations

import os
import subprocess
import sys

from gpugi._errors import ArgumentError, Error


def command(*words: str | os.PathLike[str]) -> str:
    """Runs the command `gpugi` in a process of its own, and returns what it prints: films, bakes of volumes, environments,
    transfer vectors and light paths, `list`, `info`, `doctor`, `bench`.

        >>> gpugi.command("film", "station", "--seconds", "2", "-o", "station.webp")

    Raises ArgumentError if the command does not understand its words, Error if it fails, both with its message.
    """
    line = [sys.executable, "-m", "gpugi", *(os.fspath(word) for word in words)]
    run = subprocess.run(line, capture_output=True, text=True, encoding="utf-8", errors="replace", check=False)
    if run.returncode == 0:
        return run.stdout
    # Notes and progress may come before it.
    begins = [place for word in ("gpugi: ", "error: ") if (place := f"\n{run.stderr}".rfind(f"\n{word}")) >= 0]
    message = run.stderr[max(begins, default=0) :].strip().removeprefix("gpugi: ").removeprefix("error: ")
    raise ArgumentError(message) if run.returncode == 2 else Error(message or f"ended with code {run.returncode}")
