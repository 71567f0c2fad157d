"""Work over several workers on this machine. Ray takes seconds to begin, so all tests share one cluster."""

import os
import random
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gpugi
import numpy as np
import pytest

ray = pytest.importorskip("ray")
from gpugi import distributed  # noqa: E402

# Workers do not have this file.
ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])

SIZE = (16, 12)
BAKE = {"techniques": ["shadow-map"], "samples": 4, "atlas_size": 64, "texel_density": 5, "memory": 1}


@pytest.fixture(scope="module", autouse=True)
def cluster() -> Iterator[None]:
    try:
        ray.init(num_cpus=4, num_gpus=0, log_to_driver=False, include_dashboard=False)
    except (RuntimeError, OSError, TimeoutError) as error:
        pytest.skip(f"Ray does not start on this machine: {error}")
    yield
    ray.shutdown()


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_bakes_merge_to_the_bits_of_one_process(tmp_path: Path, workers: int) -> None:
    gpugi.bake("cornell", tmp_path / "plain.glb", **BAKE)
    baked = distributed.bake("cornell", tmp_path / "shared.glb", workers=workers, **BAKE)
    assert baked.pages >= 2, "something to share out"
    assert (tmp_path / "plain.glb").read_bytes() == (tmp_path / "shared.glb").read_bytes()


def test_pictures_and_references_do_not_depend_on_the_workers() -> None:
    cameras = [gpugi.Camera.look_at((x, 2.7, 8), (0, 2.7, 0)) for x in (-1.0, 0.0, 1.0)]
    options = {"size": SIZE, "techniques": ["shadow-map"], "samples": 1, "per_task": 1, "aovs": ["depth"]}
    films = [list(distributed.render("cornell", cameras=cameras, workers=count, **options)) for count in (1, 3)]
    for camera, one, three in zip(cameras, *films, strict=True):
        alone = gpugi.render("cornell", camera=camera, size=SIZE, techniques=["shadow-map"], samples=1)
        assert np.array_equal(one.color, alone) and np.array_equal(three.color, alone)
        assert np.array_equal(one.depth, three.depth)
    pictures = [distributed.path_trace("cornell", size=SIZE, samples=24, per_task=8, workers=count) for count in (1, 2)]
    assert np.array_equal(pictures[0].color, pictures[1].color)
    assert pictures[0].noise is not None and 0 < pictures[0].noise < 1
    # Tasks that end early weigh less: the picture is as bright.
    early = distributed.path_trace("cornell", size=SIZE, samples=96, per_task=48, settings={"path-tracer.noise": 0.5}, workers=1)
    assert early.samples < 96 and early.color.mean() == pytest.approx(pictures[0].color.mean(), rel=0.3)
    # The first task is the plain picture.
    first = distributed.path_trace("cornell", size=SIZE, samples=8, per_task=8, seed=5, workers=1)
    assert np.array_equal(first.color, gpugi.PathTracer("cornell", size=SIZE).render(samples=8, seed=5).color)


class Slow(distributed._Share):
    """Squares numbers, slowly, and kills its own process at times."""

    def __init__(self, folder: str) -> None:
        self.folder = folder

    def adapter(self) -> str:
        return "none"

    def run(self, task: int) -> int:
        # Each time once per task.
        flag = Path(self.folder, f"{task}")
        if task % 2 == 0 and not flag.exists():
            flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.05)
        return task * task


def test_killed_workers_lose_nothing(tmp_path: Path) -> None:
    # Twenty of forty tasks kill their worker.
    pool: distributed._Pool[int, int] = distributed._Pool(Slow, [str(tmp_path)], 3, None)
    try:
        pool.check()
        found = dict(pool.run(range(40), None))
    finally:
        pool.close()
    assert found == {number: number * number for number in range(40)}
    assert pool.losses >= 20


class Marking(distributed._Share):
    def __init__(self, folder: str) -> None:
        self.folder = folder

    def adapter(self) -> str:
        return "none"

    def run(self, task: int) -> int:
        Path(self.folder, f"{task}").touch()
        return task


def test_workers_go_on_while_the_caller_is_busy(tmp_path: Path) -> None:
    pool: distributed._Pool[int, int] = distributed._Pool(Marking, [str(tmp_path)], 1, None)
    try:
        results = pool.run(range(3), None)
        assert next(results) == (0, 0)
        began = time.monotonic()
        while not (tmp_path / "1").exists():
            assert time.monotonic() - began < 60, "the worker waits for the caller"
            time.sleep(0.01)
        assert not (tmp_path / "2").exists()
        assert list(results) == [(1, 1), (2, 2)]
    finally:
        pool.close()


def test_workers_that_are_killed_while_they_bake_lose_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gpugi.bake("cornell", tmp_path / "plain.glb", **BAKE)
    deaths = tmp_path / "deaths"
    deaths.mkdir()
    losses: list[int] = []

    class Mortal(distributed._Bake):
        """Dies in the midst of its first task, or right after it, until four have died."""

        def run(self, task: Any) -> Any:
            if len(list(deaths.iterdir())) < 4:
                (deaths / str(os.getpid())).touch()
                threading.Timer(random.uniform(0.0, 1.0), os.kill, [os.getpid(), signal.SIGKILL]).start()
                super().run(task)
                os.kill(os.getpid(), signal.SIGKILL)
            return super().run(task)

    class Counting(distributed._Pool):
        def close(self) -> None:
            losses.append(self.losses)
            super().close()

    monkeypatch.setattr(distributed, "_Bake", Mortal)
    monkeypatch.setattr(distributed, "_Pool", Counting)
    distributed.bake("cornell", tmp_path / "shared.glb", workers=2, **BAKE)
    # Two of four die at the latest after others took the place of the first two.
    assert losses[0] >= 2, "nobody took the place of the dead"
    assert (tmp_path / "plain.glb").read_bytes() == (tmp_path / "shared.glb").read_bytes()


class Broken(distributed._Share):
    def adapter(self) -> str:
        return str(os.getpid())

    def run(self, task: int) -> int:
        raise gpugi.SceneError("there is nothing here")


def test_what_cannot_work_says_so() -> None:
    pool: distributed._Pool[int, int] = distributed._Pool(Broken, [], 2, None)
    try:
        with pytest.raises(gpugi.Error, match="do not compute the same bits"):
            pool.check()
        with pytest.raises(gpugi.SceneError, match="nothing here"):
            dict(pool.run([1], None))
    finally:
        pool.close()
    with pytest.raises(gpugi.ArgumentError, match="cameras"):
        list(distributed.render("cornell"))
    with pytest.raises(gpugi.GpuError, match="no such GPU"):
        list(distributed.render("cornell", times=[0], size=SIZE, adapter="no such GPU"))
    with pytest.raises(gpugi.ArgumentError, match="resume"):
        distributed.bake("cornell", "baked.glb", resume=True)
    with pytest.raises(gpugi.ArgumentError, match="workers"):
        distributed.path_trace("cornell", size=SIZE, workers=0)
