"""A hundred pictures of one scene by one renderer, and their time, beside that of gpugi's Rust example of this name: what
Python costs.

python many_pictures.py cornell shadow-map 1
"""

import argparse
import time

import gpugi


def main(arguments: list[str] | None = None) -> float:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="cornell")
    parser.add_argument("techniques", nargs="?", default="shadow-map")
    parser.add_argument("samples", nargs="?", type=int, default=1)
    parser.add_argument("side", nargs="?", type=int, default=256, help="width and height in pixels")
    parser.add_argument("--pictures", type=int, default=100)
    options = parser.parse_args(arguments)
    scene = gpugi.Scene.load(options.scene)
    renderer = gpugi.Renderer(scene, size=(options.side, options.side), techniques=options.techniques.split(","))
    # Shaders are compiled in the first.
    renderer.render(samples=options.samples)
    began = time.perf_counter()
    for _ in range(options.pictures):
        renderer.render(samples=options.samples)
    milliseconds = (time.perf_counter() - began) * 1000.0 / options.pictures
    print(f"{milliseconds:.3f} ms per picture")
    return milliseconds


if __name__ == "__main__":
    main()
