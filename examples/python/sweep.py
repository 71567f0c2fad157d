"""A strip of pictures that sweep a material from smooth to rough.

python sweep.py spheres 0 strip.png --steps 6
"""

import argparse

import gpugi
import numpy as np


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene")
    parser.add_argument("material", help="name or index")
    parser.add_argument("output")
    parser.add_argument("--steps", type=int, default=6)
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240))
    parser.add_argument("--samples", type=int, default=64)
    options = parser.parse_args(arguments)

    scene = gpugi.Scene.load(options.scene)
    key = int(options.material) if options.material.isdigit() else options.material
    material = scene.materials[key]
    tracer = gpugi.PathTracer(scene, size=tuple(options.size))
    pictures = []
    for roughness in np.linspace(0.0, 1.0, options.steps):
        material.roughness = roughness
        pictures.append(tracer.render(samples=options.samples, denoise=True).color)
    gpugi.save(np.concatenate(pictures, axis=1), options.output)


if __name__ == "__main__":
    main()
