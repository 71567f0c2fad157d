"""Baked light, as files that other programs show."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gpugi import _gpugi
from gpugi._picture import Setting, words_of
from gpugi._render import Progress, SceneLike, Techniques, _names, _progress, _scene


Option = bool | int | float | str | list[str] | tuple[str, ...] | None


# Options that may be true without being named.
_ON_BY_DEFAULT = ("drop_baked_lights", "prune")


@dataclass
class Baked:
    """A bake that is done."""

    pages: int
    size: int
    """Width and height of a page (texels)."""
    notes: list[str]
    """What is to be known of it, one sentence each."""


def words_of_options(options: Mapping[str, Option]) -> list[str]:
    """Options as on the command line."""
    words = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is None:
            continue
        if isinstance(value, (bool, np.bool_)):
            if value:
                words.append(option)
            elif name in _ON_BY_DEFAULT:
                words.append(f"{option}=false")
        elif isinstance(value, (list, tuple)):
            words.append(f"{option}={','.join(map(str, value))}")
        else:
            words.append(f"{option}={value}")
    return words


def bake(
    scene: SceneLike,
    output: str | os.PathLike[str],
    *,
    techniques: Techniques = None,
    settings: Mapping[str, Setting] | None = None,
    adapter: str = "best",
    progress: Progress = False,
    **options: Option,
) -> Baked:
    """Bakes the light of a scene into the textures of a .glb that other programs show.

    options: those of `gpugi bake` with underscores, such as atlas_size=1024, texel_density=32, bake_mode="lightmap",
    samples=256, denoise=True, include="indirect", resume=True. A scene as its glTF file has it keeps everything else of
    that file; another one is written anew.

    Raises ArgumentError for what makes no sense. A bake that an exception of `progress` or Ctrl-C ends leaves a
    checkpoint, from which resume=True goes on.
    """
    words = words_of_options(options)
    return Baked(
        **_gpugi.bake(
            _scene(scene), output, _names(techniques), words_of(settings), words, adapter, _progress(progress)
        )
    )


def export(scene: SceneLike, output: str | os.PathLike[str]) -> list[str]:
    """Writes a scene as a .glb, without environment and animation. Returns what the file cannot hold, one sentence each."""
    return _gpugi.export(_scene(scene), output)
