"""The package as its users see it. Small pictures: the GPU may be a processor."""

import gc
import os
import pickle
import subprocess
import sys
import threading
import time
from pathlib import Path

import gpugi
import numpy as np
import pytest

SIZE = (32, 24)
DIRECT = ["shadow-map"]


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "gpugi", *arguments, "--quiet"]
    return subprocess.run(line, capture_output=True, text=True, check=False)


def command_out(*arguments: str) -> str:
    return command(*arguments).stdout


def quad() -> tuple[np.ndarray, np.ndarray]:
    vertices = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], np.float64)
    return vertices, np.array([[0, 1, 2], [0, 2, 3]])


def lit_floor() -> gpugi.Scene:
    scene = gpugi.Scene("floor")
    vertices, triangles = quad()
    scene.add_mesh(vertices, triangles, material=gpugi.Material(name="grey", base_color=0.5, specular=0), name="floor")
    scene.add_light(gpugi.Light("point", position=(0, 1, 0), intensity=3.0, name="lamp"))
    scene.add_camera(gpugi.Camera.look_at((0, 3, 1), (0, 0, 0), name="above"))
    return scene


def test_import_takes_no_numpy_and_opens_no_gpu() -> None:
    code = "import sys, gpugi; early = 'numpy' in sys.modules; print(early, [name for name in gpugi.__all__ if not hasattr(gpugi, name)])"
    line = [sys.executable, "-c", code]
    # No driver is there for it to find.
    run = subprocess.run(line, capture_output=True, text=True, env={"VK_DRIVER_FILES": "/nothing"}, check=True)
    assert run.stdout == "False []\n"
    assert set(gpugi.__all__) <= set(dir(gpugi)) and not hasattr(gpugi, "nothing")


@pytest.mark.parametrize(
    ("techniques", "options", "samples"),
    [(None, [], 2), ("shadow-map", ["--technique", "shadow-map"], 4), ("path-tracer", ["--technique", "path-tracer"], 8)],
)
def test_pictures_are_those_of_the_command(tmp_path: Path, techniques, options, samples) -> None:
    path = tmp_path / "picture.exr"
    settings = {"radiosity.resolution": 64} if techniques is None else {}
    words = [word for name, value in settings.items() for word in ("--set", f"{name}={value}")]
    run = command(
        "render", "cornell", "-o", str(path), "--size", "32x24", "--samples", str(samples), "--seed", "3", *options, *words
    )
    assert run.returncode == 0, run.stderr
    image = gpugi.render("cornell", size=SIZE, techniques=techniques, settings=settings, samples=samples, seed=3)
    assert image.shape == (24, 32, 3) and image.dtype == np.float32
    assert np.array_equal(image, gpugi.read(path)), "not the same bits"


def test_the_command_is_there() -> None:
    run = command("list", "scenes")
    assert run.returncode == 0 and "cornell" in run.stdout
    assert [name for name, _ in gpugi.builtin_scenes()][0] in run.stdout
    assert command("render", "nothing", "-o", "x.png").returncode == 2


def test_a_scene_of_arrays_has_the_light_of_theory() -> None:
    scene = lit_floor()
    frame = gpugi.Renderer(scene, size=(33, 33), techniques=DIRECT).render(samples=1, aovs=["depth", "normal", "instance"])
    # I rho / (pi d^2), below the lamp.
    assert frame.color[16, 16] == pytest.approx(3.0 * 0.5 / np.pi, rel=0.01)
    assert frame.normal[16, 16] == pytest.approx([0, 1, 0], abs=0.01)
    assert frame.depth[16, 16] == pytest.approx(np.sqrt(10), rel=0.01)
    assert frame.instance[16, 16] == 0 and frame.instance[0, 0] == -1
    with pytest.raises(AttributeError, match="albedo"):
        frame.albedo


def test_edits_show_what_a_new_renderer_shows() -> None:
    scene = lit_floor()
    renderer = gpugi.Renderer(scene, size=SIZE, techniques=DIRECT)
    before = renderer.render(samples=1).color
    scene.lights["lamp"].position = (0.5, 1, 0)
    scene.materials["grey"].base_color = (0.1, 0.5, 0.9)
    scene.objects["floor"].transform = np.diag([0.8, 1, 1, 1])
    vertices, triangles = quad()
    scene.add_mesh(vertices * 0.2, triangles, transform=np.eye(4) + np.eye(4, k=3) * 0.3)
    after = renderer.render(samples=1).color
    assert not np.array_equal(before, after)
    anew = gpugi.render(scene, size=SIZE, techniques=DIRECT, samples=1)
    assert np.array_equal(after, anew)
    tracer = gpugi.PathTracer(scene, size=SIZE)
    traced = tracer.render(samples=4).color
    scene.lights["lamp"].intensity = (0, 0, 9)
    changed = tracer.render(samples=4).color
    assert np.array_equal(changed, gpugi.render(scene, size=SIZE, techniques="path-tracer", samples=4))
    assert not np.array_equal(traced, changed)


def test_a_seed_gives_the_same_picture_whatever_was_before() -> None:
    settings = {"radiosity.resolution": 32, "radiosity.iterations": 4}
    renderer = gpugi.Renderer("cornell", size=SIZE, settings=settings)
    first, other, again = (renderer.render(samples=1, seed=seed).color for seed in (1, 2, 1))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_adapters_are_chosen_by_number() -> None:
    options = {"size": SIZE, "techniques": DIRECT, "samples": 1}
    assert np.array_equal(gpugi.render("cornell", adapter="#0", **options), gpugi.render("cornell", **options))
    assert "#0 " + gpugi.adapters()[0] in command_out("list", "adapters")
    with pytest.raises(gpugi.GpuError, match="number 99"):
        gpugi.render("cornell", adapter="#99", **options)


def test_copies_and_pickles_are_scenes_of_their_own() -> None:
    scene = gpugi.Scene.load("cornell")
    picture = gpugi.render(scene, size=SIZE, techniques=DIRECT, samples=1)
    copy, travelled = scene.copy(), pickle.loads(pickle.dumps(scene))
    scene.materials[0].base_color = 0.0
    for other in (copy, travelled):
        assert np.array_equal(gpugi.render(other, size=SIZE, techniques=DIRECT, samples=1), picture)


@pytest.mark.parametrize(
    ("argument", "wrong"),
    [
        ("size", lambda: gpugi.render("cornell", size=(-3, 4))),
        ("size", lambda: gpugi.render("cornell", size=3)),
        ("size", lambda: gpugi.render("cornell", size=(16.5, 4))),
        ("seed", lambda: gpugi.render("cornell", size=SIZE, seed=-1)),
        ("techniques", lambda: gpugi.render("cornell", size=SIZE, techniques=[3])),
        ("reference_samples", lambda: gpugi.measure("cornell", size=SIZE, reference_samples=0)),
        ("nothing", lambda: gpugi.render("nothing")),
        ("samples", lambda: gpugi.render("cornell", size=SIZE, samples=0)),
        ("no-such", lambda: gpugi.render("cornell", size=SIZE, techniques=["no-such"])),
        ("resolution", lambda: gpugi.render("cornell", size=SIZE, settings={"shadow-map.resolution": -1})),
        ("settings", lambda: gpugi.render("cornell", size=SIZE, settings={"resolution": 1})),
        ("camera", lambda: gpugi.render("cornell", size=SIZE, camera="nobody")),
        ("denoise", lambda: gpugi.render("cornell", size=SIZE, denoise=True)),
        ("aovs", lambda: gpugi.Renderer("cornell", size=SIZE).render(aovs=["beauty"])),
        ("vertices", lambda: gpugi.Scene().add_mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]])),
        ("vertices", lambda: gpugi.Scene().add_mesh([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])),
        ("triangles", lambda: gpugi.Scene().add_mesh(np.eye(3), [[0, 1, 3]])),
        ("triangles", lambda: gpugi.Scene().add_mesh(np.eye(3), [[0, 1, -1]])),
        ("triangles", lambda: gpugi.Scene().add_mesh(np.eye(3), [[0.0, 1.0, 2.0]])),
        ("normals", lambda: gpugi.Scene().add_mesh(np.eye(3), [[0, 1, 2]], normals=np.zeros((3, 3)))),
        ("transform", lambda: gpugi.Scene().add_mesh(np.eye(3), [[0, 1, 2]], transform=np.zeros((4, 4)))),
        ("transform", lambda: gpugi.Scene().add_mesh(np.eye(3), [[0, 1, 2]], transform=np.eye(3))),
        ("base_color", lambda: gpugi.Material(base_color=(0, 0, 2))),
        ("roughness", lambda: gpugi.Material(roughness=np.nan)),
        ("kind", lambda: gpugi.Light("lamp")),
        ("intensity", lambda: gpugi.Light("point", intensity=-1)),
        ("cone", lambda: gpugi.Light("spot", cone=(1, 0.5))),
        ("target", lambda: gpugi.Camera.look_at((0, 0, 0), (0, 0, 0))),
        ("fov", lambda: gpugi.Camera.look_at((0, 0, 0), (0, 0, 1), fov=180)),
        ("vertices", lambda: gpugi.Scene().add_mesh(np.eye(3) * 1j, [[0, 1, 2]])),
        ("focus", lambda: gpugi.Camera.look_at((0, 0, 0), (0, 0, 1), aperture=1, focus=-1)),
        ("noise", lambda: gpugi.measure("cornell", size=SIZE, noise=float("nan"))),
        ("reference", lambda: gpugi.compare(np.zeros((4, 4, 3)), np.zeros((4, 4, 3), np.uint8))),
        ("test", lambda: gpugi.compare(np.zeros((4, 4)), np.zeros((4, 4, 3)))),
        ("reference", lambda: gpugi.compare(np.zeros((4, 4, 3)), np.full((4, 4, 3), np.inf))),
        ("metrics", lambda: gpugi.compare(np.zeros((4, 4, 3)), np.zeros((4, 4, 3)), metrics=["beauty"])),
        ("image", lambda: gpugi.develop(np.zeros((4, 4, 2)))),
        ("atlas-size", lambda: gpugi.bake("cornell", "x.glb", atlas_size=-1)),
        ("glb", lambda: gpugi.bake("cornell", "x.obj")),
        ("techniques", lambda: gpugi.measure("cornell", size=SIZE, techniques="path-tracer")),
    ],
)
def test_wrong_arguments_are_named(argument: str, wrong) -> None:
    with pytest.raises(gpugi.ArgumentError, match=argument):
        wrong()


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.glb"
    broken.write_bytes(b"nothing of the kind")
    for path in (broken, tmp_path / "missing.gltf"):
        with pytest.raises(gpugi.SceneError, match=path.name):
            gpugi.Scene.load(path)
    assert issubclass(gpugi.SceneError, gpugi.Error) and issubclass(gpugi.ArgumentError, ValueError)


def test_arrays_of_any_strides_are_read() -> None:
    vertices, triangles = quad()
    scenes = [gpugi.Scene(), gpugi.Scene()]
    scenes[0].add_mesh(vertices, triangles)
    padded = np.zeros((4, 6))
    padded[:, ::2] = vertices
    scenes[1].add_mesh(padded[:, ::2], np.asfortranarray(triangles.astype(np.uint8)))
    assert scenes[0].bounds == scenes[1].bounds == ([-1, 0, -1], [1, 0, 1])


def test_what_the_callback_raises_ends_the_work() -> None:
    class Enough(Exception):
        pass

    parts: list[float] = []

    def stop(part: float, words: str) -> None:
        parts.append(part)
        if len(parts) == 3:
            raise Enough(words)

    tracer = gpugi.PathTracer("cornell", size=SIZE)
    with pytest.raises(Enough):
        tracer.render(samples=4096, progress=stop)
    assert len(parts) == 3 and parts == sorted(parts)
    # It is as good as new.
    again = tracer.render(samples=4).color
    assert np.array_equal(again, gpugi.render("cornell", size=SIZE, techniques="path-tracer", samples=4))


def test_what_was_broken_off_leaves_nothing_behind() -> None:
    scene = gpugi.Scene.load("cornell")
    lamp = next(material for material in scene.materials if max(material.emission) > 0)
    settings = {"radiosity.resolution": 32, "radiosity.iterations": 4}
    renderer = gpugi.Renderer(scene, size=SIZE, settings=settings)
    before = renderer.render(samples=1).color
    emission = lamp.emission
    lamp.emission = (0, 0, 50)
    calls: list[str] = []

    def stop(_: float, words: str) -> None:
        calls.append(words)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        renderer.render(samples=8, progress=stop)
    assert calls == ["maps"], "it went on"
    lamp.emission = emission
    assert renderer.render(samples=1).color == pytest.approx(before, rel=0.2, abs=0.02)


def test_callbacks_cannot_use_what_has_called_them() -> None:
    renderer = gpugi.Renderer("cornell", size=SIZE, techniques=DIRECT)
    with pytest.raises(gpugi.Error, match="callback"):
        renderer.render(samples=1, progress=lambda *_: renderer.render(samples=1))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_forked_processes_say_that_they_cannot_render() -> None:
    gpugi.render("cornell", size=SIZE, techniques=DIRECT, samples=1)
    child = os.fork()
    if child == 0:
        try:
            gpugi.render("cornell", size=SIZE, techniques=DIRECT, samples=1)
        except gpugi.Error as error:
            os._exit(7 if "spawn" in str(error) else 1)
        os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7


def test_another_scene_gets_the_techniques_that_suit_it() -> None:
    scene = lit_floor()
    settings: dict[str, int] = {}
    renderer = gpugi.Renderer(scene, size=SIZE, settings=settings)
    renderer.render(samples=1)
    scene.set_environment(np.ones((8, 16, 3)))
    renderer.render(samples=1)
    assert renderer.techniques == gpugi.Renderer(scene, size=SIZE).techniques != ["shadow-map", "radiosity"]


def test_views_of_what_was_removed_say_so() -> None:
    scene = lit_floor()
    for name in ("two", "three"):
        scene.add_light(gpugi.Light("point", position=(0, 2, 0), name=name))
    view = scene.lights["two"]
    scene.remove("lamp")
    with pytest.raises(gpugi.Error, match="removed"):
        view.position = (1, 1, 1)
    assert [light.name for light in scene.lights] == ["two", "three"]


def test_threads_work_side_by_side_and_python_goes_on() -> None:
    expected = gpugi.render("cornell", size=SIZE, techniques=DIRECT, samples=2)
    pictures: list[np.ndarray] = []

    def work() -> None:
        pictures.append(gpugi.Renderer("cornell", size=SIZE, techniques=DIRECT).render(samples=2).color)

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    turns = 0
    while any(thread.is_alive() for thread in threads):
        turns += 1
        time.sleep(0.001)
    assert turns > 3, "the lock was held"
    assert len(pictures) == 3 and all(np.array_equal(picture, expected) for picture in pictures)


def test_comparisons_and_measurements() -> None:
    truth = np.full((16, 16, 3), 0.5, np.float32)
    found = gpugi.compare(truth * 1.1, truth)
    assert found["rmse"] == pytest.approx(0.05, rel=1e-4) and found.maps["rel-mse"].shape == (16, 16)
    assert gpugi.compare(truth, truth, metrics=["psnr"])["psnr"] == np.inf
    frame = gpugi.Renderer("cornell", size=SIZE, techniques=DIRECT).render(samples=1)
    assert gpugi.compare(frame, frame.color)["flip"] == 0
    measured = gpugi.measure("cornell", size=SIZE, techniques=DIRECT, samples=4, reference_samples=16)
    assert 0 < measured.metrics["rel-mse"] < 1 and measured.color.shape == measured.reference.shape
    assert measured.memory["scene"] > 0


def test_images_show_themselves(tmp_path: Path) -> None:
    image = gpugi.render("cornell", size=SIZE, techniques=DIRECT, samples=1)
    png = image._repr_png_()
    assert png is not None and png.startswith(b"\x89PNG")
    assert (image * 2)._repr_png_() == png or isinstance(image * 2, gpugi.Image)
    gpugi.save(image, tmp_path / "image.png")
    assert (tmp_path / "image.png").read_bytes() == png
    assert gpugi.develop(image).shape == (24, 32, 4)
    # No copy: DLPack hands over the same memory.
    assert np.shares_memory(np.from_dlpack(image), image)


def test_bakes(tmp_path: Path) -> None:
    steps: list[str] = []
    scene = lit_floor()
    baked = gpugi.bake(
        scene, tmp_path / "baked.glb", techniques=DIRECT, samples=1, atlas_size=64, progress=lambda _, words: steps.append(words)
    )
    assert (baked.pages, baked.size) == (1, 64) and "unwrapping" in steps
    shown = gpugi.Scene.load(tmp_path / "baked.glb")
    assert shown.statistics["triangles"] == 2 and shown.statistics["images"] > 0
    assert gpugi.export(scene, tmp_path / "plain.glb") == []
    assert gpugi.Scene.load(tmp_path / "plain.glb").lights.names == ["lamp"]
    # What is not in the file is not taken from there.
    moved = gpugi.Scene.load(tmp_path / "plain.glb", edit=["light.lamp.position=0.5,1,0"])
    gpugi.bake(moved, tmp_path / "moved.glb", techniques=DIRECT, samples=1, atlas_size=64)
    assert gpugi.Scene.load(tmp_path / "moved.glb").lights[0].position == [0.5, 1, 0]


def test_the_command_runs_and_raises(tmp_path: Path) -> None:
    assert "cornell" in gpugi.command("list", "scenes")
    with pytest.raises(gpugi.ArgumentError, match="--no-such"):
        gpugi.command("render", "cornell", "--no-such")
    with pytest.raises(gpugi.ArgumentError, match="^there is no technique"):
        gpugi.command("render", "cornell", "--technique", "nothing", "-o", tmp_path / "picture.png")
    with pytest.raises(gpugi.Error, match="^.*nothing.glb"):
        gpugi.command("info", tmp_path / "nothing.glb")


def test_numpy_booleans_are_settings() -> None:
    renderer = gpugi.Renderer("cornell", size=(8, 8), techniques="path-tracing", settings={"path-tracing.cache": np.bool_(False)})
    renderer.set({"path-tracing.cache": np.bool_(True)})


@pytest.mark.parametrize(("shown", "count"), [(False, 1000), (True, 100)])
def test_dropped_scenes_leave_no_memory(shown: bool, count: int) -> None:
    def resident() -> int:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * 4096

    def use(times: int) -> None:
        for _ in range(times):
            scene = gpugi.Scene.load("cornell")
            if shown:
                gpugi.Renderer(scene, size=(16, 12), techniques="path-tracing").render(samples=1)
        gc.collect()

    if not Path("/proc/self/statm").exists():
        pytest.skip("only Linux tells")
    use(count // 5)
    before = resident()
    use(count)
    assert resident() < 1.02 * before
