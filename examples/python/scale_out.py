"""How far a bake scales: measures its tasks on this machine, and simulates 1 to 10,000 workers with failures and stragglers.

python scale_out.py room --atlas-size 1024 --samples 256
python scale_out.py --with tasks=10000 task_seconds=20 failures_per_hour=1
"""

import argparse
import heapq
import statistics
import time
from dataclasses import dataclass

import numpy as np


@dataclass
class Bake:
    """What a bake consists of."""

    tasks: int = 10_000
    task_seconds: float = 20.0
    spread: float = 0.2
    """Standard deviation over mean of the tasks' times."""
    task_bytes: float = 8e6
    setup_seconds: float = 3.0
    """Until a worker has scene, atlas, maps and shaders."""
    setup_bytes: float = 2e8
    maps_seconds: float = 30.0
    merge_seconds: float = 0.01
    """Of one result, by the process that merges: one after another."""


@dataclass
class Machines:
    """What it runs on."""

    network: float = 1.25e9
    """Bytes per second that reach, or leave, the process that merges."""
    start_seconds: float = 5.0
    """Until an actor runs."""
    failures_per_hour: float = 0.05
    """Of a worker."""
    stragglers: float = 0.01
    """Part of the tasks that take ten times as long."""


def simulate(bake: Bake, machines: Machines, workers: int, seed: int = 0) -> float:
    """Seconds until the last result is merged, with the rules of gpugi.distributed."""
    chance = np.random.default_rng(seed)
    sigma = np.sqrt(np.log1p(bake.spread**2))

    def duration() -> float:
        seconds = bake.task_seconds * chance.lognormal(-(sigma**2) / 2, sigma)
        return seconds * (10.0 if chance.random() < machines.stragglers else 1.0)

    begin = bake.maps_seconds + machines.start_seconds + bake.setup_seconds
    # The object store sends what workers need along a tree, so its time grows with the logarithm.
    begin += bake.setup_bytes / machines.network * (1.0 + np.log2(workers))
    free = [(begin, worker) for worker in range(workers)]
    waiting = list(range(bake.tasks))[::-1]
    running: dict[int, list[float]] = {}
    done: set[int] = set()
    events: list[tuple[float, int, int, bool]] = []
    arrived = merged = begin
    while len(done) < bake.tasks:
        while free and (waiting or any(len(begun) == 1 for task, begun in running.items() if task not in done)):
            now, worker = heapq.heappop(free)
            if waiting:
                task = waiting.pop()
            else:
                task = min((begun[0], task) for task, begun in running.items() if task not in done and len(begun) == 1)[1]
            running.setdefault(task, []).append(now)
            seconds = duration()
            dies = chance.exponential(3600.0 / machines.failures_per_hour) if machines.failures_per_hour else np.inf
            heapq.heappush(events, (now + min(seconds, dies), worker, task, bool(dies < seconds)))
        now, worker, task, died = heapq.heappop(events)
        if died:
            again = now + machines.start_seconds + bake.setup_seconds
            heapq.heappush(free, (again, worker))
            if task not in done:
                running[task] = running[task][1:]
                if not running[task]:
                    waiting.append(task)
            continue
        heapq.heappush(free, (now, worker))
        if task not in done:
            done.add(task)
            arrived = max(arrived, now) + bake.task_bytes / machines.network
            merged = max(merged, arrived) + bake.merge_seconds
    return float(merged)


def measured(scene_name: str, atlas_size: int, samples: int, memory: int) -> Bake:
    """Runs every eighth task of a bake here."""
    import gpugi
    from gpugi import _gpugi

    scene = gpugi.Scene.load(scene_name)
    words = [f"--atlas-size={atlas_size}", f"--samples={samples}", f"--memory={memory}"]
    order = ([], [], words, "best")
    bake = _gpugi.SharedBake(scene, *order, None, None, None)
    first, *others = bake.tasks()
    began = time.perf_counter()
    maps = bake.run(first)
    maps_seconds = time.perf_counter() - began
    bake.merge(maps)
    atlas = bake.atlas()
    began = time.perf_counter()
    share = _gpugi.SharedBake(scene, *order, None, atlas, None)
    share.merge(maps)
    setup = time.perf_counter() - began
    # Shaders are compiled in the first.
    share.run(others[0])
    times, merges, sizes = [], [], []
    for task in others[::8] or others:
        began = time.perf_counter()
        result = share.run(task)
        times.append(time.perf_counter() - began)
        began = time.perf_counter()
        bake.merge(result)
        merges.append(time.perf_counter() - began)
        sizes.append(len(result))
    mean = statistics.fmean(times)
    return Bake(
        tasks=len(others),
        task_seconds=mean,
        spread=statistics.pstdev(times) / mean,
        task_bytes=statistics.fmean(sizes),
        setup_seconds=setup,
        setup_bytes=len(scene.__reduce__()[1][0]) + len(atlas) + len(maps),
        maps_seconds=maps_seconds,
        merge_seconds=statistics.fmean(merges),
    )


def main(arguments: list[str] | None = None) -> list[float]:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", help="a bake of it is measured here (default: what --with says is simulated)")
    parser.add_argument("--atlas-size", type=int, default=1024)
    parser.add_argument("--samples", type=int, default=256)
    parser.add_argument("--memory", type=int, default=8, help="MiB for the texels of a task")
    parser.add_argument("--with", nargs="+", default=[], metavar="NAME=VALUE", dest="changes", help="other values of Bake and Machines")
    options = parser.parse_args(arguments)
    bake = measured(options.scene, options.atlas_size, options.samples, options.memory) if options.scene else Bake()
    machines = Machines()
    for change in options.changes:
        name, _, value = change.partition("=")
        subject = next((subject for subject in (bake, machines) if name in vars(subject)), None)
        try:
            number = float(value)
        except ValueError:
            subject = None
        if subject is None:
            parser.error(f"--with {change}: NAME=NUMBER is needed, and the names are {', '.join([*vars(bake), *vars(machines)])}")
        setattr(subject, name, int(number) if name == "tasks" else number)
    print(bake, machines)
    print("| workers | time [s] | speed-up | efficiency |\n|---|---|---|---|")
    counts = [1, 2, 4, 10, 30, 100, 300, 1000, 3000, 10_000]
    times = [simulate(bake, machines, count) for count in counts if count <= bake.tasks * 2 or count == 1]
    for count, seconds in zip(counts, times, strict=False):
        speed_up = times[0] / seconds
        print(f"| {count} | {seconds:.0f} | {speed_up:.1f} | {100 * speed_up / count:.0f} % |")
    return times


if __name__ == "__main__":
    main()
