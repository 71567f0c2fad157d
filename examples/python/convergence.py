"""Error over samples: the path tracer, the same filtered, and techniques; a plot, if matplotlib is there.

python convergence.py cornell error.png
"""

import argparse

import gpugi


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene")
    parser.add_argument("output")
    parser.add_argument("--size", type=int, nargs=2, default=(160, 120))
    parser.add_argument("--most", type=int, default=256, help="samples per pixel")
    options = parser.parse_args(arguments)

    scene, size = gpugi.Scene.load(options.scene), tuple(options.size)
    tracer = gpugi.PathTracer(scene, size=size)
    # Another seed: noise that both have would not count.
    truth = tracer.render(samples=16 * options.most, seed=1).color
    renderer = gpugi.Renderer(scene, size=size)
    ways = {
        "path tracer": lambda samples: tracer.render(samples=samples),
        "path tracer, filtered": lambda samples: tracer.render(samples=samples, denoise=True),
        ", ".join(renderer.techniques): lambda samples: renderer.render(samples=samples),
    }
    counts = [2**power for power in range(1, options.most.bit_length())]
    errors = {
        name: [gpugi.compare(render(count).color, truth)["flip"] for count in counts] for name, render in ways.items()
    }
    for name, values in errors.items():
        print(name, *(f"{value:.4f}" for value in values))
    try:
        from matplotlib import pyplot
    except ImportError:
        print("pip install matplotlib draws the plot")
        return
    for name, values in errors.items():
        pyplot.loglog(counts, values, marker="o", label=name)
    pyplot.xlabel("samples per pixel")
    pyplot.ylabel("HDR-FLIP")
    pyplot.legend()
    pyplot.savefig(options.output)


if __name__ == "__main__":
    main()
