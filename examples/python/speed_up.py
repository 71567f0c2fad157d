"""How much faster more GPUs of this host, or of a cluster, are: a bake and a film by 1, 2, ... workers.

python speed_up.py station --workers 1 2 --samples 1024 --frames 200
"""

import argparse
import hashlib
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import gpugi
from gpugi import distributed


def bake(scene: gpugi.Scene, workers: int, options: argparse.Namespace) -> tuple[str, dict[str, float]]:
    """A bake: what it made, and its times (s)."""
    reports: list[float] = []

    def progress(part: float, words: str) -> None:
        if "tasks" in words:
            reports.append(time.perf_counter())

    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "baked.glb"
        began = time.perf_counter()
        distributed.bake(
            scene,
            output,
            techniques=options.technique,
            workers=workers,
            progress=progress,
            samples=options.samples,
            atlas_size=options.atlas_size,
            memory=options.memory,
        )
        seconds = time.perf_counter() - began
        times = {"bake": seconds}
        if len(reports) > 1:
            times["bake after its first task"] = reports[-1] - reports[0]
        return hashlib.sha256(output.read_bytes()).hexdigest(), times


def film(scene: gpugi.Scene, workers: int, options: argparse.Namespace) -> tuple[str, dict[str, float]]:
    """A film of a scene that moves: what it made, and its times (s)."""
    times = [number / 30.0 for number in range(options.frames)]
    checksum = hashlib.sha256()
    first = began = time.perf_counter()
    frames = distributed.render(
        scene,
        times=times,
        size=tuple(options.size),
        techniques=options.film_technique,
        samples=options.film_samples,
        workers=workers,
        per_task=options.per_task,
    )
    for number, frame in enumerate(frames):
        if number == 0:
            first = time.perf_counter()
        checksum.update(frame.color.tobytes())
    ended = time.perf_counter()
    return checksum.hexdigest(), {"film": ended - began, "film after its first task": ended - first}


def main(arguments: list[str] | None = None) -> dict[str, list[float]]:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="station")
    parser.add_argument("--workers", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--technique", nargs="+", default=["path-tracing"])
    parser.add_argument("--samples", type=int, default=1024)
    parser.add_argument("--atlas-size", type=int, default=1024)
    parser.add_argument("--memory", type=int, default=8, help="MiB for the texels of a task")
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--size", nargs=2, type=int, default=[640, 360])
    parser.add_argument("--film-technique", nargs="+", default=["path-tracing"])
    parser.add_argument("--film-samples", type=int, default=16)
    parser.add_argument("--per-task", type=int, default=8)
    options = parser.parse_args(arguments)
    scene = gpugi.Scene.load(options.scene)
    measured: dict[str, list[float]] = {}
    parts: list[Callable[..., tuple[str, dict[str, float]]]] = [bake] if options.samples else []
    parts += [film] if options.frames else []
    for part in parts:
        made = set()
        for workers in options.workers:
            what, times = part(scene, workers, options)
            made.add(what)
            for name, seconds in times.items():
                measured.setdefault(name, []).append(seconds)
                times_faster = measured[name][0] / max(seconds, 1e-9)
                print(f"{name}, workers: {workers}: {seconds:.1f} s, {times_faster:.2f} times", flush=True)
        print("the same bits" if len(made) == 1 else "OTHER BITS", flush=True)
    return measured


if __name__ == "__main__":
    main()
