"""Moves a lamp until a picture is as bright as wished where it is wished: a search without gradients.

python light_placement.py
"""

import argparse

import gpugi
import numpy as np


def scene_with_lamp() -> gpugi.Scene:
    """The Cornell box, lit by a point."""
    scene = gpugi.Scene.load("cornell", without="light")
    scene.set_environment(None)
    scene.add_light(gpugi.Light("point", position=(0, 2.7, 0), intensity=20.0, name="lamp"))
    return scene


def main(arguments: list[str] | None = None) -> tuple[float, float]:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--size", type=int, nargs=2, default=(64, 64))
    options = parser.parse_args(arguments)

    scene = scene_with_lamp()
    renderer = gpugi.Renderer(scene, size=tuple(options.size), techniques=["shadow-map"])
    # The picture that is wished for has the lamp here.
    scene.lights["lamp"].position = (1.2, 3.6, 0.9)
    wished = renderer.render(samples=1).color

    def error(position: np.ndarray) -> float:
        scene.lights["lamp"].position = position
        return gpugi.compare(renderer.render(samples=1).color, wished, metrics=["rel-mse"])["rel-mse"]

    # (1+1) evolution: steps grow when they help, and shrink when they do not.
    chance = np.random.default_rng(1)
    best, reach = np.array([0.0, 2.7, 0.0]), 0.8
    first = least = error(best)
    for _ in range(options.steps):
        tried = np.clip(best + chance.normal(0.0, reach, 3), [-2.5, 0.2, -2.5], [2.5, 5.2, 2.5])
        found = error(tried)
        better = found < least
        best, least = (tried, found) if better else (best, least)
        reach *= 1.5 if better else 0.9
    print(f"lamp at {best.round(2)}, rel-mse {first:.4f} -> {least:.4f}")
    return first, least


if __name__ == "__main__":
    main()
