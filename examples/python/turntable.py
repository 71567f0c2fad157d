"""A film of a turn around a scene: PNG files, which any encoder takes.

python turntable.py helmet.gltf frames --frames 120
ffmpeg -framerate 30 -i frames/%04d.png turntable.mp4
"""

import argparse
import math
from pathlib import Path

import gpugi
import numpy as np


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480))
    parser.add_argument("--technique", action="append", help="instead of those that suit the scene")
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)

    scene = gpugi.Scene.load(options.scene)
    middle = np.mean(scene.bounds, axis=0)
    first = np.array(scene.camera(aspect=options.size[0] / options.size[1]).position)
    renderer = gpugi.Renderer(scene, size=tuple(options.size), techniques=options.technique)
    for number in range(options.frames):
        angle = 2 * math.pi * number / options.frames
        x, y, z = first - middle
        turned = (x * math.cos(angle) + z * math.sin(angle), y, z * math.cos(angle) - x * math.sin(angle))
        frame = renderer.render(gpugi.Camera.look_at(middle + turned, middle, fov=40))
        # Automatic exposure would flicker.
        gpugi.save(frame.color, options.folder / f"{number:04}.png", settings={"exposure.value": 0})


if __name__ == "__main__":
    main()
