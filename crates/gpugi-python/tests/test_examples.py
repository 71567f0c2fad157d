"""The examples, in small."""

import json
import runpy
from pathlib import Path

import gpugi
import numpy as np
import pytest

FOLDER = Path(__file__).parents[3] / "examples" / "python"
SMALL = ["--size", "16", "12"]
DIRECT = ["--technique", "shadow-map"]


def run(name: str, *arguments: object) -> object:
    return runpy.run_path(str(FOLDER / f"{name}.py"))["main"]([str(argument) for argument in arguments])


def test_data_set(tmp_path: Path) -> None:
    run("data_set", "cornell", tmp_path, "--count", 2, *SMALL, *DIRECT)
    views = json.loads((tmp_path / "poses.json").read_text())
    assert len(views["views"]) == 2 and np.array(views["views"][0]["world_from_camera"]).shape == (4, 4)
    with np.load(tmp_path / "00001.npz") as view:
        assert view["color"].shape == view["normal"].shape == (12, 16, 3) and view["depth"].shape == (12, 16)
        assert view["instance"].max() < len(views["objects"])


def test_read_data_set(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    run("data_set", "cornell", tmp_path, "--count", 1, *SMALL, *DIRECT)
    item = runpy.run_path(str(FOLDER / "read_data_set.py"))["Views"](tmp_path)[0]
    assert tuple(item["color"].shape) == (3, 12, 16) and tuple(item["depth"].shape) == (1, 12, 16)


def test_turntable(tmp_path: Path) -> None:
    run("turntable", "room", tmp_path, "--frames", 2, *SMALL, *DIRECT)
    first, second = (gpugi.read(tmp_path / f"{number:04}.png") for number in range(2))
    assert first.shape == (12, 16, 3) and not np.array_equal(first, second)


def test_sweep(tmp_path: Path) -> None:
    run("sweep", "spheres", 0, tmp_path / "strip.png", "--steps", 2, "--samples", 2, *SMALL)
    assert gpugi.read(tmp_path / "strip.png").shape == (12, 32, 3)


def test_convergence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("convergence", "cornell", tmp_path / "error.png", "--most", 4, *SMALL)
    assert capsys.readouterr().out.startswith("path tracer 0.")


def test_many_pictures() -> None:
    assert run("many_pictures", "cornell", "path-tracing", 1, 16, "--pictures", 3) > 0


def test_notebook(capsys: pytest.CaptureFixture[str]) -> None:
    cells = json.loads((FOLDER / "compare_techniques.ipynb").read_text())["cells"]
    names: dict[str, object] = {}
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code":
            # Maps of the others take seconds in software.
            small = "WAYS = {'direct light': ['shadow-map'], 'paths': ['path-tracing']}" if source.startswith("WAYS") else source
            small = small.replace("(256, 256)", "(24, 24)").replace("1024", "16").replace("samples=64", "samples=2")
            exec(compile(small, "compare_techniques.ipynb", "exec"), names)
        assert not cell.get("outputs")
    printed = capsys.readouterr().out
    assert "direct light: indirect light" in printed and "paths: nothing" in printed
    parts = [float(line.split()[1]) for line in printed.splitlines() if line.endswith("of the light")]
    assert len(parts) == 4 and parts[0] < parts[1] < parts[3]
    assert len(names["images"]) == 3  # type: ignore[arg-type]


def test_light_placement() -> None:
    first, least = run("light_placement", "--steps", 25, "--size", 24, 24)
    assert least < 0.5 * first


def test_scale_out() -> None:
    times = run("scale_out", "--with", "tasks=200", "task_seconds=10")
    # More workers take less time, but never less than the parts that nobody shares.
    assert 15 < times[0] / times[4] <= 30 and times[-1] > 38
    assert times == run("scale_out", "--with", "tasks=200", "task_seconds=10"), "not the same twice"


def test_ray_bake(tmp_path: Path) -> None:
    ray = pytest.importorskip("ray")
    ray.init(num_cpus=2, num_gpus=0, log_to_driver=False, include_dashboard=False)
    try:
        run("ray_bake", "cornell", tmp_path / "baked.glb", "--samples", 2, "--atlas-size", 64, "--workers", 1)
        direct = ["--technique", "shadow-map", "--film-technique", "shadow-map", "--film-samples", 1]
        small = ["--samples", 2, "--atlas-size", 64, "--frames", 2, "--per-task", 1, *SMALL]
        times = run("speed_up", "cornell", "--workers", 1, *direct, *small)
    finally:
        ray.shutdown()
    assert set(times) >= {"bake", "film"} and min(min(all) for all in times.values()) > 0
    assert gpugi.Scene.load(tmp_path / "baked.glb").statistics["images"] > 0
