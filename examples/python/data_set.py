"""A data set: images with depth, normals, albedo, objects and poses, from cameras around a scene.

python data_set.py room views --count 1000
"""

import argparse
import json
from pathlib import Path

import gpugi
import numpy as np


def cameras(scene: gpugi.Scene, count: int, seed: int = 0) -> list[gpugi.Camera]:
    """Cameras inside of the scene's box that look at its middle."""
    low, high = (np.array(corner) for corner in scene.bounds)
    chance = np.random.default_rng(seed)
    middle = (low + high) / 2
    eyes = low + (high - low) * chance.uniform(0.15, 0.85, (count, 3))
    targets = middle + (high - low) * chance.uniform(-0.1, 0.1, (count, 3))
    return [gpugi.Camera.look_at(eye, target, fov=60) for eye, target in zip(eyes, targets, strict=True)]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--size", type=int, nargs=2, default=(256, 192))
    parser.add_argument("--technique", action="append", help="instead of those that suit the scene")
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)

    scene = gpugi.Scene.load(options.scene)
    renderer = gpugi.Renderer(scene, size=tuple(options.size), techniques=options.technique)
    poses = []
    for number, camera in enumerate(cameras(scene, options.count)):
        frame = renderer.render(camera, aovs=["depth", "normal", "albedo", "instance"])
        arrays = {name: layer.astype(np.float16) for name, layer in frame.layers.items() if name != "instance"}
        np.savez_compressed(
            options.folder / f"{number:05}.npz",
            color=frame.color.astype(np.float16),
            instance=frame.instance.astype(np.int16),
            **arrays,
        )
        poses.append({"world_from_camera": camera.transform.tolist(), "fov": camera.fov})
    (options.folder / "poses.json").write_text(json.dumps({"objects": scene.objects.names, "views": poses}))


if __name__ == "__main__":
    main()
