"""Bakes, films, data sets and references over many GPUs and machines, with Ray: `pip install gpugi[ray]`.

    >>> from gpugi import distributed
    >>> distributed.bake("room.glb", "baked.glb", samples=256)

Works on this machine, or on the cluster of `ray start`. Long-lived actors hold device and scene; work is cut into tasks
that do not depend on how many there are, so results have the same bits with any number of workers of one kind of GPU.
A task whose worker dies runs again; when there is nothing else to do, the slowest tasks run twice.
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Generic, TypeVar

import numpy as np

try:
    import ray
    from ray.exceptions import (
        ActorDiedError,
        GetTimeoutError,
        ObjectLostError,
        OutOfMemoryError,
        RayActorError,
        WorkerCrashedError,
    )
except ImportError as error:
    raise ImportError("gpugi.distributed needs Ray: pip install gpugi[ray]") from error

from gpugi import _gpugi
from gpugi._bake import Baked, Option, words_of_options
from gpugi._errors import ArgumentError, Error
from gpugi._gpugi import Camera, Scene
from gpugi._picture import Image, Setting, words_of
from gpugi._render import (
    Frame,
    PathTracer,
    Progress,
    Renderer,
    SceneLike,
    Techniques,
    _camera,
    _names,
    _progress,
    _samples,
    _scene,
    _seed,
    _size,
    _whole,
)

_LOST = (RayActorError, ActorDiedError, WorkerCrashedError, ObjectLostError, OutOfMemoryError)
_PATIENCE = 300
"""Seconds in which a worker begins: Ray waits forever for what the cluster does not have."""
_AHEAD = 2
"""Tasks that a worker is given: it goes on with the second while nobody asks for the result of the first."""
_MOST_LOSSES = 5
"""Per worker, without a result between them: such workers die of what they are given."""

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


class _Share:
    """What a worker does; made in its process."""

    def adapter(self) -> str:
        raise NotImplementedError

    def run(self, task: Any) -> Any:
        raise NotImplementedError


class _Worker:
    """An actor: device, scene, and what is made of them. Exceptions are values: Ray's would hide their class."""

    def __init__(self, make: Callable[..., _Share], references: Sequence[Any]) -> None:
        self.share: _Share | None = None
        self.make, self.references = make, references

    def adapter(self) -> str | Exception:
        try:
            self.share = self.make(*ray.get(list(self.references)))
            return self.share.adapter()
        except Exception as error:
            return error

    def run(self, task: Any) -> Any:
        try:
            if self.share is None:
                # It takes the place of a worker that died.
                self.share = self.make(*ray.get(list(self.references)))
            return self.share.run(task)
        except Exception as error:
            return _Raised(error)


class _Raised:
    """What a task raised."""

    def __init__(self, error: Exception) -> None:
        self.error = error


class _Pool(Generic[_Task, _Result]):
    """Workers that run tasks."""

    def __init__(
        self, make: Callable[..., _Share], arguments: Sequence[Any], workers: int | None, gpus: float | None
    ) -> None:
        if workers is not None:
            workers = _whole("workers", workers, 1, 1_000_000)
        if not ray.is_initialized():
            ray.init(log_to_driver=False)
        found = int(ray.cluster_resources().get("GPU", 0))
        # A processor renders on all its cores: one worker per node.
        self._count = workers or found or sum(node["Alive"] for node in ray.nodes())
        of_gpu = gpus if gpus is not None else (1.0 if found else 0.0)
        self._actor = ray.remote(num_cpus=0, num_gpus=of_gpu, max_restarts=0, scheduling_strategy="SPREAD")(_Worker)
        # Scenes travel once per node.
        self._arguments = (make, [ray.put(argument) for argument in arguments])
        self.workers = [self._new() for _ in range(self._count)]
        self.losses = 0

    def _new(self) -> Any:
        return self._actor.remote(*self._arguments)

    def check(self) -> None:
        """Waits until all workers have begun, and refuses GPUs of several kinds."""
        adapters = []
        for place in range(self._count):
            while True:
                try:
                    found = ray.get(self.workers[place].adapter.remote(), timeout=_PATIENCE)
                except _LOST as error:
                    self.losses += 1
                    if self.losses > _MOST_LOSSES * self._count:
                        raise Error(f"workers cannot begin: {error}") from None
                    self.workers[place] = self._new()
                    continue
                except GetTimeoutError:
                    have = ray.cluster_resources()
                    raise Error(
                        f"worker {place + 1} of {self._count} does not begin within {_PATIENCE} s; the cluster has {have}"
                    ) from None
                if isinstance(found, Exception):
                    raise found
                adapters.append(found)
                break
        if len(set(adapters)) > 1:
            kinds = ", ".join(sorted(set(adapters)))
            raise Error(f"these GPUs do not compute the same bits: {kinds}; choose one kind with adapter=")

    def run(self, tasks: Sequence[_Task], report: Callable[[float, str], object] | None) -> Iterator[tuple[int, _Result]]:
        """Runs tasks; yields their numbers and results as they come, each once."""
        waiting = deque(range(len(tasks)))
        idle = list(self.workers) * _AHEAD
        running: dict[Any, tuple[Any, int, float]] = {}
        done: set[int] = set()
        in_a_row = 0
        began = time.monotonic()
        while len(done) < len(tasks):
            for worker in idle.copy():
                number = self._next(worker, waiting, running, done)
                if number is None:
                    continue
                idle.remove(worker)
                running[worker.run.remote(tasks[number])] = (worker, number, time.monotonic())
            ready, _ = ray.wait(list(running), num_returns=1, timeout=1.0)
            for reference in ready:
                worker, number, _ = running.pop(reference)
                try:
                    result = ray.get(reference)
                except _LOST as error:
                    if number not in done:
                        waiting.appendleft(number)
                    if worker not in self.workers:
                        continue
                    self.losses += 1
                    in_a_row += 1
                    if in_a_row > _MOST_LOSSES * self._count:
                        raise Error(f"{in_a_row} workers died one after another: {error}") from None
                    self.workers.remove(worker)
                    self.workers.append(self._new())
                    idle = [other for other in idle if other is not worker] + self.workers[-1:] * _AHEAD
                    continue
                idle.append(worker)
                in_a_row = 0
                if number in done:
                    continue
                if isinstance(result, _Raised):
                    raise result.error
                done.add(number)
                if report is not None:
                    part = len(done) / len(tasks)
                    left = (time.monotonic() - began) * (1.0 / part - 1.0)
                    report(part, f"{len(done)} of {len(tasks)} tasks, {left:.0f} s left")
                yield number, result

    @staticmethod
    def _next(worker: Any, waiting: deque[int], running: dict[Any, tuple[Any, int, float]], done: set[int]) -> int | None:
        """The next task of a worker: one that waits, or else, if it has none, the one that has run longest, by another worker
        alone."""
        while waiting:
            number = waiting.popleft()
            if number not in done:
                return number
        if any(worker is other for other, _, _ in running.values()):
            return None
        numbers = [number for _, number, _ in running.values()]
        alone = [(since, number) for _, number, since in running.values() if numbers.count(number) == 1]
        alone = [(since, number) for since, number in alone if number not in done]
        return min(alone)[1] if alone else None

    def close(self) -> None:
        for worker in self.workers:
            ray.kill(worker)


def _own(adapter: str) -> str:
    """The adapter of this worker: Ray gives it GPUs by number, and Vulkan knows nothing of that."""
    numbers = ray.get_gpu_ids()
    return f"#{numbers[0]}" if adapter in ("best", "discrete") and numbers else adapter


class _Bake(_Share):
    def __init__(
        self,
        scene: Scene,
        order: tuple[list[str], list[str], list[str], str],
        atlas: bytes,
        maps: bytes,
    ) -> None:
        techniques, settings, options, adapter = order
        adapter = _own(adapter)
        self.name = _gpugi.adapter_of(adapter)
        self.bake = _gpugi.SharedBake(scene, techniques, settings, options, adapter, None, atlas, None)
        self.bake.merge(maps)

    def adapter(self) -> str:
        return self.name

    def run(self, task: bytes) -> bytes:
        return self.bake.run(task)


def bake(
    scene: SceneLike,
    output: str | os.PathLike[str],
    *,
    techniques: Techniques = None,
    settings: Mapping[str, Setting] | None = None,
    adapter: str = "best",
    workers: int | None = None,
    gpus_per_worker: float | None = None,
    progress: Progress = False,
    **options: Option,
) -> Baked:
    """Bakes the light of a scene into the file that gpugi.bake writes with the same options, to the bit.

    This process lays out the atlas and solves the maps, on a GPU of the same kind; then workers light texels. A task is up
    to 64 samples of one tile. memory=8 cuts pages into tiles of 8 MiB, where 512 make few: more tiles share better. The noise
    of path-tracing differs with the tiles. workers: one per GPU of the cluster, or per node without GPUs.
    """
    loaded = _scene(scene)
    for option in ("resume", "dump_maps"):
        if option in options:
            raise ArgumentError(f"{option}: not of a bake that workers share")
    words = words_of_options(options)
    order = (_names(techniques), words_of(settings), words, adapter)
    report = _progress(progress)
    merged = _gpugi.SharedBake(loaded, *order, output, None, report)
    first, *others = merged.tasks()
    maps = merged.run(first, report)
    merged.merge(maps)
    if others:
        pool: _Pool[bytes, bytes] = _Pool(_Bake, [loaded, order, merged.atlas(), maps], workers, gpus_per_worker)
        try:
            pool.check()
            for _, result in pool.run(others, report):
                merged.merge(result)
        finally:
            pool.close()
    return Baked(**merged.finish(output))


class _Render(_Share):
    def __init__(self, scene: Scene, options: dict[str, Any], picture: dict[str, Any]) -> None:
        options = {**options, "adapter": _own(options["adapter"])}
        self.scene, self.options, self.picture = scene, options, picture
        self.name = _gpugi.adapter_of(options["adapter"])

    def adapter(self) -> str:
        return self.name

    def run(self, task: list[tuple[Camera | str | int | None, float | None]]) -> list[Frame]:
        # Maps of a renderer go on from those before: each task has its own.
        renderer = None
        frames = []
        for camera, moment in task:
            if moment is not None:
                self.scene.pose(moment)
            if renderer is None or moment is not None:
                renderer = Renderer(self.scene, **self.options)
            frames.append(renderer.render(camera, **self.picture))
        return frames


def render(
    scene: SceneLike,
    *,
    cameras: Iterable[Camera | str | int] | None = None,
    times: Iterable[float] | None = None,
    camera: Camera | str | int | None = None,
    size: tuple[int, int] = (1024, 768),
    techniques: Techniques = None,
    settings: Mapping[str, Setting] | None = None,
    samples: int | None = None,
    seed: int = 0,
    aovs: Iterable[str] = (),
    adapter: str = "best",
    per_task: int = 8,
    workers: int | None = None,
    gpus_per_worker: float | None = None,
    progress: Progress = False,
) -> Iterator[Frame]:
    """Pictures of a scene by many cameras, or at many times (s) of its animation: an iterator, in order.

    per_task: pictures that one worker makes one after another; of cameras, they share maps.
    """
    if (cameras is None) == (times is None):
        raise ArgumentError("cameras: give these, or times")
    shots: list[tuple[Camera | str | int | None, float | None]]
    shots = [(one, None) for one in cameras] if cameras is not None else [(camera, float(t)) for t in times or ()]
    per_task = _samples(per_task, "per_task")
    tasks = [shots[first : first + per_task] for first in range(0, len(shots), per_task)]
    options = {"size": _size(size), "techniques": _names(techniques), "settings": dict(settings or {}), "adapter": adapter}
    picture = {"samples": samples and _samples(samples), "seed": _seed(seed), "aovs": list(aovs)}
    return _in_order(_scene(scene), tasks, options, picture, workers, gpus_per_worker, progress)


def _in_order(
    scene: Scene,
    tasks: list[Any],
    options: dict[str, Any],
    picture: dict[str, Any],
    workers: int | None,
    gpus: float | None,
    progress: Progress,
) -> Iterator[Frame]:
    if not tasks:
        return
    pool: _Pool[Any, list[Frame]] = _Pool(_Render, [scene, options, picture], workers, gpus)
    try:
        pool.check()
        early: dict[int, list[Frame]] = {}
        expected = 0
        for number, frames in pool.run(tasks, _progress(progress)):
            early[number] = frames
            while expected in early:
                yield from early.pop(expected)
                expected += 1
    finally:
        pool.close()


class _Trace(_Share):
    def __init__(self, scene: Scene, camera: Camera, options: dict[str, Any]) -> None:
        options = {**options, "adapter": _own(options["adapter"])}
        self.name = _gpugi.adapter_of(options["adapter"])
        self.camera = camera
        self.tracer = PathTracer(scene, **options)

    def adapter(self) -> str:
        return self.name

    def run(self, task: tuple[int, int]) -> tuple[Image, int, float | None, list[str]]:
        seed, samples = task
        frame = self.tracer.render(self.camera, samples=samples, seed=seed)
        return frame.color, frame.samples, frame.noise, frame.left_out


def path_trace(
    scene: SceneLike,
    *,
    camera: Camera | str | int | None = None,
    size: tuple[int, int] = (1024, 768),
    settings: Mapping[str, Setting] | None = None,
    samples: int = 1024,
    seed: int = 0,
    adapter: str = "best",
    per_task: int = 64,
    workers: int | None = None,
    gpus_per_worker: float | None = None,
    progress: Progress = False,
) -> Frame:
    """A picture of the path tracer whose samples many workers share: the mean of pictures of `per_task` samples each,
    with seeds of their own."""
    samples, per_task, seed = _samples(samples), _samples(per_task, "per_task"), _seed(seed)
    loaded, pixels = _scene(scene), _size(size)
    firsts = range(0, samples, per_task)
    tasks = [
        ((seed ^ (number * 0x9E3779B1)) & 0xFFFFFFFF, min(per_task, samples - first)) for number, first in enumerate(firsts)
    ]
    options = {"size": pixels, "settings": dict(settings or {}), "adapter": adapter}
    seen = _camera(loaded, camera, pixels)
    pool: _Pool[tuple[int, int], tuple[Image, int, float | None, list[str]]]
    pool = _Pool(_Trace, [loaded, seen, options], workers, gpus_per_worker)
    total = np.zeros((pixels[1], pixels[0], 3), np.float64)
    counts, noise, expected = 0, 0.0, 0
    early: dict[int, tuple[Image, int, float | None, list[str]]] = {}
    left_out: list[str] = []
    try:
        pool.check()
        for number, result in pool.run(tasks, _progress(progress)):
            early[number] = result
            # In the order of the tasks: sums depend on it.
            while expected in early:
                color, count, of_task, left_out = early.pop(expected)
                total += color.astype(np.float64) * count
                counts += count
                noise += (np.nan if of_task is None else of_task) * count**2
                expected += 1
    finally:
        pool.close()
    color = (total / counts).astype(np.float32).view(Image)
    known = None if np.isnan(noise) else float(noise) / counts**2
    return Frame(color=color, samples=counts, left_out=left_out, notes=[], noise=known)
