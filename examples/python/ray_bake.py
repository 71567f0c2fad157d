"""A bake over all GPUs of this machine, or of the cluster that `ray start` made.

python ray_bake.py room baked.glb --samples 256
"""

import argparse

from gpugi import distributed


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene")
    parser.add_argument("output")
    parser.add_argument("--samples", type=int, default=128)
    parser.add_argument("--atlas-size", type=int, default=1024)
    parser.add_argument("--workers", type=int)
    options = parser.parse_args(arguments)

    size = {"samples": options.samples, "atlas_size": options.atlas_size}
    baked = distributed.bake(options.scene, options.output, workers=options.workers, progress=True, **size)
    for note in baked.notes:
        print(note)


if __name__ == "__main__":
    main()
