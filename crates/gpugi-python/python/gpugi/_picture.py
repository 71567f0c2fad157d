"""Images: arrays that notebooks show."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpugi import _gpugi
from gpugi._errors import ArgumentError

Setting = bool | int | float | str


def words_of(settings: Mapping[str, Setting] | None) -> list[str]:
    """Settings as the command takes them: name=value."""
    words = []
    for name, value in (settings or {}).items():
        if not isinstance(name, str) or "." not in name or "=" in name:
            raise ArgumentError(f"settings: {name!r} is not of the form technique.setting")
        text = str(value).lower() if isinstance(value, (bool, np.bool_)) else str(value)
        words.append(f"{name}={text}")
    return words


class Image(np.ndarray[Any, np.dtype[np.float32]]):
    """Linear radiance, shape (height, width, 3), float32. A notebook shows it with automatic exposure."""

    def _repr_png_(self) -> bytes | None:
        if self.ndim != 3 or self.shape[2] != 3 or 0 in self.shape:
            return None
        try:
            return _gpugi.png(develop(self))
        except ArgumentError:
            # It holds what is not finite.
            return None


def develop(image: ArrayLike, *, settings: Mapping[str, Setting] | None = None, adapter: str = "best") -> NDArray[np.uint8]:
    """What a display shows of an image: sRGB bytes of shape (height, width, 4), as in the command's PNG files.

    settings: of effects, such as {"exposure.value": 0, "tone-map.operator": "aces"}; exposure is automatic by default.
    Raises ArgumentError if the shape is another one, or a value is not finite.
    """
    developed: NDArray[np.uint8] = _gpugi.develop(image, words_of(settings), adapter)
    return developed


def read(path: str | os.PathLike[str]) -> Image:
    """An image file (.exr, .hdr, .ktx2, .png, .jpg) as linear values, without alpha. Raises SceneError if it cannot be read."""
    image: Image = _gpugi.read(path).view(Image)
    return image


def save(image: ArrayLike, path: str | os.PathLike[str], *, settings: Mapping[str, Setting] | None = None) -> None:
    """Writes an image as a PNG file, developed; or as .npy, with its linear radiance."""
    path = os.fspath(path)
    if path.lower().endswith(".npy"):
        np.save(path, np.asarray(image))
    elif path.lower().endswith(".png"):
        with open(path, "wb") as file:
            file.write(_gpugi.png(develop(image, settings=settings)))
    else:
        raise ArgumentError(f"path: {path!r} must end in .png or .npy")


def show(image: ArrayLike, *, settings: Mapping[str, Setting] | None = None) -> None:
    """Shows an image: in a notebook below the cell, else in the program that this system has for PNG files."""
    png = _gpugi.png(develop(image, settings=settings))
    try:
        from IPython import get_ipython
        from IPython.display import Image as Shown
        from IPython.display import display
    except ImportError:
        pass
    else:
        if get_ipython() is not None:
            display(Shown(data=png))
            return
    import tempfile
    import webbrowser

    with tempfile.NamedTemporaryFile(suffix=".png", delete=False) as file:
        file.write(png)
    webbrowser.open(f"file://{file.name}")
