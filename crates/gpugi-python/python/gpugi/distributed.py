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
    from ray.exceptions import ActorDiedError, ObjectLostError, RayActorError, RayTaskError, WorkerCrashedError
except ImportError as error:
    raise ImportError("gpugi.distributed needs Ray: pip install gpugi[ray]") from error

from gpugi import _gpugi
from gpugi._bake import Baked, words_of_options
from gpugi._errors import ArgumentError, Error
from gpugi._gpugi import Camera, Scene
from gpugi._picture import Image, Setting, words_of
from gpugi._render import (
    Frame,
    PathTracer,
    Progress,
    Renderer,
    Techniques,
    _camera,
    _names,
    _progress,
    _scene,
    _size,
)

_LOST = (RayActorError, ActorDiedError, WorkerCrashedError, ObjectLostError)
_MOST_LOSSES_IN_A_ROW = 5
"""Workers that die one after another, without a result between them, die of what they are given."""

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


class _Share:
    """What a worker does; made in its process."""

    def adapter(self) -> str:
        raise NotImplementedError

    def run(self, task: Any) -> Any:
        raise NotImplementedError


class _Worker:
    """An actor: device, scene, and what is made of them."""

    def __init__(self, make: Callable[..., _Share], arguments: Sequence[Any]) -> None:
        self.share = make(*arguments)

    def adapter(self) -> str:
        return self.share.adapter()

    def process(self) -> int:
        return os.getpid()

    def run(self, task: Any) -> Any:
        return self.share.run(task)


class _Pool(Generic[_Task, _Result]):
    """Workers that run tasks."""

    def __init__(
        self, make: Callable[..., _Share], arguments: Sequence[Any], workers: int | None, gpus: float | None
    ) -> None:
        if not ray.is_initialized():
            ray.init(log_to_driver=False)
        resources = ray.cluster_resources()
        found = int(resources.get("GPU", 0))
        if workers is not None and workers < 1:
            raise ArgumentError(f"workers: {workers} can do nothing")
        # A processor renders on all its cores: one worker per node.
        self._count = workers or found or len(ray.nodes())
        of_gpu = gpus if gpus is not None else (1.0 if found else 0.0)
        self._actor = ray.remote(num_cpus=0, num_gpus=of_gpu, max_restarts=0)(_Worker)
        # Scenes travel once per node.
        self._arguments = (make, [ray.put(argument) for argument in arguments])
        self.workers = [self._new() for _ in range(self._count)]
        self.losses = 0

    def _new(self) -> Any:
        make, references = self._arguments
        return self._actor.remote(_on_worker, [make, *references])

    def check(self) -> None:
        """Waits until all workers have begun, and refuses GPUs of several kinds."""
        adapters = []
        for place in range(self._count):
            while True:
                try:
                    adapters.append(ray.get(self.workers[place].adapter.remote()))
                    break
                except _LOST as error:
                    self.losses += 1
                    if self.losses > _MOST_LOSSES_IN_A_ROW:
                        raise Error(f"workers cannot begin: {error}") from None
                    self.workers[place] = self._new()
                except RayTaskError as error:
                    raise error.as_instanceof_cause() from None
        if len(set(adapters)) > 1:
            kinds = ", ".join(sorted(set(adapters)))
            raise Error(f"these GPUs do not compute the same bits: {kinds}; choose one kind with adapter=")

    def run(self, tasks: Sequence[_Task], report: Callable[[float, str], object] | None) -> Iterator[tuple[int, _Result]]:
        """Runs tasks; yields their numbers and results as they come, each once."""
        waiting = deque(range(len(tasks)))
        idle = list(self.workers)
        running: dict[Any, tuple[Any, int, float]] = {}
        done: set[int] = set()
        in_a_row = 0
        began = time.monotonic()
        while len(done) < len(tasks):
            while idle:
                number = self._next(waiting, running, done)
                if number is None:
                    break
                worker = idle.pop()
                running[worker.run.remote(tasks[number])] = (worker, number, time.monotonic())
            ready, _ = ray.wait(list(running), num_returns=1, timeout=1.0)
            for reference in ready:
                worker, number, _ = running.pop(reference)
                try:
                    result = ray.get(reference)
                except _LOST as error:
                    self.losses += 1
                    in_a_row += 1
                    if in_a_row > _MOST_LOSSES_IN_A_ROW:
                        raise Error(f"{in_a_row} workers died one after another: {error}") from None
                    self.workers.remove(worker)
                    self.workers.append(self._new())
                    idle.append(self.workers[-1])
                    if number not in done:
                        waiting.appendleft(number)
                    continue
                except RayTaskError as error:
                    raise error.as_instanceof_cause() from None
                idle.append(worker)
                in_a_row = 0
                if number in done:
                    continue
                done.add(number)
                if report is not None:
                    part = len(done) / len(tasks)
                    left = (time.monotonic() - began) * (1.0 / part - 1.0)
                    report(part, f"{len(done)} of {len(tasks)} tasks, {left:.0f} s left")
                yield number, result

    @staticmethod
    def _next(waiting: deque[int], running: dict[Any, tuple[Any, int, float]], done: set[int]) -> int | None:
        """The next task: one that waits, or else the one that has run longest, by one worker alone."""
        while waiting:
            number = waiting.popleft()
            if number not in done:
                return number
        numbers = [number for _, number, _ in running.values()]
        alone = [(since, number) for _, number, since in running.values() if numbers.count(number) == 1]
        alone = [(since, number) for since, number in alone if number not in done]
        return min(alone)[1] if alone else None

    def close(self) -> None:
        for worker in self.workers:
            ray.kill(worker)


def _on_worker(make: Callable[..., _Share], *references: Any) -> _Share:
    return make(*ray.get(list(references)))


class _Bake(_Share):
    def __init__(
        self,
        scene: Scene,
        order: tuple[list[str], list[str], list[str], str],
        atlas: bytes,
        maps: bytes,
    ) -> None:
        techniques, settings, options, adapter = order
        self.name = _gpugi.adapter_of(adapter)
        self.bake = _gpugi.SharedBake(scene, techniques, settings, options, adapter, None, atlas, None)
        self.bake.merge(maps)

    def adapter(self) -> str:
        return self.name

    def run(self, task: bytes) -> bytes:
        return self.bake.run(task)


def bake(
    scene: Scene | str,
    output: str | os.PathLike[str],
    *,
    techniques: Techniques = None,
    settings: Mapping[str, Setting] | None = None,
    adapter: str = "best",
    workers: int | None = None,
    gpus_per_worker: float | None = None,
    progress: Progress = False,
    **options: bool | int | float | str,
) -> Baked:
    """Bakes the light of a scene as gpugi.bake does, to the same bits with the same options.

    This process solves the maps, on a GPU of the same kind; then workers light texels. memory: MiB for the texels of a task (64 by default): less
    makes more tasks. workers: one per GPU of the cluster, or per node without GPUs.
    """
    loaded = _scene(scene)
    words = words_of_options({"memory": 64, **options})
    order = (_names(techniques), words_of(settings), words, adapter)
    report = _progress(progress)
    merged = _gpugi.SharedBake(loaded, *order, output, None, report)
    first, *others = merged.tasks()
    maps = merged.run(first)
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
    scene: Scene | str,
    *,
    cameras: Iterable[Camera | str | int] | None = None,
    times: Iterable[float] | None = None,
    camera: Camera | str | int | None = None,
    size: tuple[int, int] = (1024, 768),
    techniques: Techniques = None,
    settings: Mapping[str, Setting] | None = None,
    samples: int = 4,
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
    if per_task < 1:
        raise ArgumentError(f"per_task: {per_task} pictures are none")
    tasks = [shots[first : first + per_task] for first in range(0, len(shots), per_task)]
    options = {"size": _size(size), "techniques": _names(techniques), "settings": dict(settings or {}), "adapter": adapter}
    picture = {"samples": samples, "seed": seed, "aovs": list(aovs)}
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
        self.name = _gpugi.adapter_of(options["adapter"])
        self.camera = camera
        self.tracer = PathTracer(scene, **options)

    def adapter(self) -> str:
        return self.name

    def run(self, task: tuple[int, int]) -> tuple[Image, int, float | None]:
        seed, samples = task
        frame = self.tracer.render(self.camera, samples=samples, seed=seed)
        return frame.color, frame.samples, frame.noise


def path_trace(
    scene: Scene | str,
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
    if samples < 1 or per_task < 1:
        raise ArgumentError(f"samples: {samples} in tasks of {per_task} are none")
    loaded, pixels = _scene(scene), _size(size)
    firsts = range(0, samples, per_task)
    tasks = [
        ((seed ^ (number * 0x9E3779B1)) & 0xFFFFFFFF, min(per_task, samples - first)) for number, first in enumerate(firsts)
    ]
    options = {"size": pixels, "settings": dict(settings or {}), "adapter": adapter}
    seen = _camera(loaded, camera, pixels)
    pool: _Pool[tuple[int, int], tuple[Image, int, float | None]]
    pool = _Pool(_Trace, [loaded, seen, options], workers, gpus_per_worker)
    try:
        pool.check()
        results = dict(pool.run(tasks, _progress(progress)))
    finally:
        pool.close()
    total = np.zeros((pixels[1], pixels[0], 3), np.float64)
    noise: float | None = 0.0
    # In the order of the tasks: sums depend on it.
    for number in range(len(tasks)):
        color, count, of_task = results[number]
        share = count / samples
        total += color.astype(np.float64) * share
        noise = None if noise is None or of_task is None else noise + of_task * share**2
    color = total.astype(np.float32).view(Image)
    return Frame(color=color, samples=samples, left_out=[], notes=[], noise=noise)
