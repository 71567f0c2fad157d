"""Pictures, their errors, and what techniques cost."""

from __future__ import annotations

import operator
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpugi import _gpugi
from gpugi._errors import ArgumentError
from gpugi._gpugi import Camera, Scene
from gpugi._picture import Image, Setting, words_of

Progress = bool | Callable[[float, str], object]
"""True draws a bar; a callable takes the part that is done (0 to 1) and what is being done. What it raises ends the work."""

Techniques = str | Sequence[str] | None
"""Names of techniques; None: those that suit the scene; "path-tracer": all light; "none" or []: none."""


def _progress(progress: Progress) -> Callable[[float, str], object] | None:
    if callable(progress):
        return progress
    if not progress:
        return None

    def draw(part: float, words: str) -> None:
        done = int(40 * part)
        end = "\n" if part >= 1.0 else ""
        print(f"\r{'#' * done}{'.' * (40 - done)} {words}\x1b[K", end=end, file=sys.stderr, flush=True)

    return draw


def _names(techniques: Techniques) -> list[str]:
    if techniques is None:
        return []
    names = [techniques] if isinstance(techniques, str) else list(techniques)
    for name in names:
        if not isinstance(name, str):
            raise ArgumentError(f"techniques: {name!r} is not the name of one")
    return names or ["none"]


def _whole(argument: str, value: int, least: int, most: int) -> int:
    """A whole number in a range."""
    try:
        number = operator.index(value)
    except TypeError:
        raise ArgumentError(f"{argument}: {value!r} is not a whole number") from None
    if not least <= number <= most:
        raise ArgumentError(f"{argument}: {number} does not lie between {least} and {most}")
    return number


def _samples(samples: int, argument: str = "samples", least: int = 1) -> int:
    return _whole(argument, samples, least, 16_777_216)


def _seed(seed: int) -> int:
    return _whole("seed", seed, 0, 0xFFFFFFFF)


SceneLike = Scene | str | os.PathLike[str]
"""A Scene, a file, or the name of a built-in scene."""


def _scene(scene: SceneLike) -> Scene:
    return scene if isinstance(scene, Scene) else Scene.load(scene)


def _camera(scene: Scene, camera: Camera | str | int | None, size: tuple[int, int]) -> Camera:
    if isinstance(camera, Camera):
        return camera
    width, height = size
    return scene.camera(camera, aspect=width / height)


def _size(size: tuple[int, int]) -> tuple[int, int]:
    try:
        width, height = size
    except (TypeError, ValueError):
        raise ArgumentError(f"size: {size!r} is not (width, height)") from None
    return _whole("size", width, 1, 1 << 20), _whole("size", height, 1, 1 << 20)


@dataclass
class Frame:
    """A picture, and what is known of it.

    color: linear radiance, (height, width, 3). layers: what else was asked for, by name, float32, means over samples:
    albedo, normal (world space), position (m, in the file's coordinates), denoising_albedo, denoising_normal and variance
    with three channels; depth (m along the view's axis) with one; instance: the index of the object that the last sample
    saw, int32, -1 where none is. Layers are attributes, too: frame.depth.
    """

    color: Image
    samples: int
    left_out: list[str]
    """Light of the scene that the picture lacks: a few words each."""
    notes: list[str]
    noise: float | None = None
    """Estimated relative mean squared error; of the path tracer alone."""
    layers: dict[str, NDArray[Any]] = field(default_factory=dict)

    def __getattr__(self, name: str) -> NDArray[Any]:
        layers = self.__dict__.get("layers", {})
        if name in layers:
            layer: NDArray[Any] = layers[name]
            return layer
        raise AttributeError(f"the frame has no layer {name!r}; ask for it with aovs=[{name!r}]")

    def _repr_png_(self) -> bytes | None:
        return self.color._repr_png_()


def _frame(made: dict[str, Any]) -> Frame:
    return Frame(
        color=made.pop("color").view(Image),
        samples=made.pop("samples"),
        left_out=made.pop("left_out"),
        notes=made.pop("notes"),
        noise=made.pop("noise", None),
        layers=made,
    )


class Renderer:
    """Renders a scene by techniques, picture after picture.

    Keeps the scene on the GPU and follows it: what changes in the scene between two pictures costs no more than the
    change. The pictures of a scene that has not changed since are those of the command, to the bit. After a change, maps
    that improve step by step, such as radiosity's, go on from those before: pictures differ from the command's by the
    noise of these maps.
    """

    def __init__(
        self,
        scene: SceneLike,
        *,
        size: tuple[int, int] = (1024, 768),
        techniques: Techniques = None,
        settings: Mapping[str, Setting] | None = None,
        adapter: str = "best",
    ) -> None:
        """size: (width, height) in pixels. settings: such as {"radiosity.resolution": 256}. adapter: part of a GPU's name,
        "software", "discrete" or "best".

        Raises ArgumentError for names and settings that do not exist, SceneError for a file that cannot be read, GpuError
        if the GPU does not hold the scene.
        """
        self.scene = _scene(scene)
        self.size = _size(size)
        self._renderer = _gpugi.Renderer(self.scene, self.size, _names(techniques), words_of(settings), adapter)

    @property
    def techniques(self) -> list[str]:
        """Names of the techniques in use."""
        return self._renderer.techniques

    def set(self, settings: Mapping[str, Setting]) -> None:
        """Changes settings: {"shadow-map.filter": "pcss"}."""
        for word in words_of(settings):
            path, value = word.split("=", 1)
            technique, name = path.split(".", 1)
            self._renderer.set(technique, name, value)

    def render(
        self,
        camera: Camera | str | int | None = None,
        *,
        samples: int | None = None,
        seed: int = 0,
        aovs: Iterable[str] = (),
        progress: Progress = False,
    ) -> Frame:
        """A picture of the scene as it is now. samples: per pixel, once all maps are final; 4 by default, 64 if a lens or
        an open shutter blurs it."""
        seen = _camera(self.scene, camera, self.size)
        made = self._renderer.render(seen, None if samples is None else _samples(samples), _seed(seed), list(aovs), _progress(progress))
        return _frame(made)

    def render_all(self, cameras: Iterable[Camera | str | int], **options: Any) -> list[Frame]:
        """A picture for each camera."""
        return [self.render(camera, **options) for camera in cameras]


class PathTracer:
    """Renders a scene with all light: the reference."""

    def __init__(
        self,
        scene: SceneLike,
        *,
        size: tuple[int, int] = (1024, 768),
        settings: Mapping[str, Setting] | None = None,
        adapter: str = "best",
    ) -> None:
        """settings: such as {"path-tracer.max-bounces": 8}; the rest as for Renderer."""
        self.scene = _scene(scene)
        self.size = _size(size)
        self._tracer = _gpugi.PathTracer(self.scene, self.size, words_of(settings), adapter)

    def render(
        self,
        camera: Camera | str | int | None = None,
        *,
        samples: int = 256,
        noise: float = 0.0,
        seed: int = 0,
        denoise: bool = False,
        aovs: Iterable[str] = (),
        progress: Progress = False,
    ) -> Frame:
        """A picture of the scene as it is now: of so many samples per pixel, or fewer once its estimated relative mean
        squared error falls to `noise`."""
        seen = _camera(self.scene, camera, self.size)
        of, seeded = _samples(samples), _seed(seed)
        made = self._tracer.render(seen, of, noise, seeded, denoise, list(aovs), _progress(progress))
        return _frame(made)


def render(
    scene: SceneLike,
    *,
    size: tuple[int, int] = (1024, 768),
    camera: Camera | str | int | None = None,
    techniques: Techniques = None,
    settings: Mapping[str, Setting] | None = None,
    samples: int | None = None,
    seed: int = 0,
    denoise: bool = False,
    adapter: str = "best",
    progress: Progress = False,
) -> Image:
    """Linear radiance of a scene: the picture that `gpugi render SCENE -o FILE.exr` writes, to the bit.

    scene: a Scene, a file, or the name of a built-in scene. camera: a Camera, or one of the scene by name or index.
    techniques: names, "path-tracer", or None for those that suit the scene. samples: per pixel; by
    default 4, 64 with a lens or an open shutter, 256 for the path tracer. denoise: filters the path tracer's picture.
    """
    loaded = _scene(scene)
    if _names(techniques) == ["path-tracer"]:
        tracer = PathTracer(loaded, size=size, settings=settings, adapter=adapter)
        of = 256 if samples is None else samples
        return tracer.render(camera, samples=of, seed=seed, denoise=denoise, progress=progress).color
    if denoise:
        raise ArgumentError('denoise: filters pictures of techniques="path-tracer"')
    renderer = Renderer(loaded, size=size, techniques=techniques, settings=settings, adapter=adapter)
    return renderer.render(camera, samples=samples, seed=seed, progress=progress).color


@dataclass
class Comparison:
    """The error of a picture: its values by metric, such as comparison["flip"], and the errors of all pixels."""

    values: dict[str, float]
    maps: dict[str, NDArray[np.float32]]
    """Shape (height, width). 0: no error; 1: an error as large as the reference, or the largest of the metric."""

    def __getitem__(self, metric: str) -> float:
        return self.values[metric]


def compare(test: ArrayLike | Frame, reference: ArrayLike | Frame, *, metrics: Iterable[str] | None = None) -> Comparison:
    """How far an image, or that of a frame, is from its reference, by rel-mse, rel-mse-4, rmse, psnr, ssim and flip, or those in `metrics`.

    Floats of shape (height, width, 3) are radiance, bytes are what displays show.
    """
    test, reference = (image.color if isinstance(image, Frame) else image for image in (test, reference))
    found = _gpugi.compare(test, reference, None if metrics is None else list(metrics))
    return Comparison(
        values={name: value for name, (value, _) in found.items()},
        maps={name: errors for name, (_, errors) in found.items()},
    )


@dataclass
class Measurement:
    """The error of techniques against the path tracer, and their cost."""

    metrics: dict[str, float]
    passes: dict[str, float]
    """GPU milliseconds of each pass, medians."""
    memory: dict[str, int]
    """Bytes on the GPU."""
    reference_noise: float
    """Estimated relative mean squared error of the reference itself."""
    notes: list[str]
    color: Image
    reference: Image


def measure(
    scene: SceneLike,
    *,
    size: tuple[int, int] = (320, 240),
    camera: Camera | str | int | None = None,
    techniques: Techniques = None,
    settings: Mapping[str, Setting] | None = None,
    samples: int = 64,
    reference_samples: int = 1024,
    noise: float = 0.0,
    all_light: bool = False,
    seed: int = 0,
    adapter: str = "best",
    progress: Progress = False,
) -> Measurement:
    """Measures techniques against the path tracer on the same light paths; with all_light, on all of the scene."""
    loaded = _scene(scene)
    size = _size(size)
    if not noise >= 0.0:
        raise ArgumentError(f"noise: {noise!r} is no relative mean squared error")
    made = _gpugi.measure(
        loaded,
        _camera(loaded, camera, size),
        size,
        _names(techniques),
        words_of(settings),
        _samples(samples),
        _samples(reference_samples, "reference_samples", least=16),
        noise,
        _seed(seed),
        all_light,
        adapter,
        _progress(progress),
    )
    images = {name: made.pop(name).view(Image) for name in ("color", "reference")}
    return Measurement(**made, **images)
