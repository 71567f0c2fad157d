"""gpugi: real-time and baked global illumination on any GPU.

    >>> import gpugi
    >>> image = gpugi.render("cornell", size=(512, 512))
    >>> gpugi.show(image)

Images are NumPy arrays of shape (height, width, 3) with linear radiance (Rec. 709) as 32-bit floats, rows from the top.
World space is right-handed, +Y up, in metres; angles are in degrees where a name says fov or rotation, else in radians.
"""

import importlib
import os
from typing import TYPE_CHECKING

if not os.path.isabs(os.environ.get("XDG_RUNTIME_DIR", "")):
    # Without it, Mesa's layer that sorts adapters complains for each; gpugi sorts them itself.
    os.environ.setdefault("NODEVICE_SELECT", "1")

from gpugi._command import command
from gpugi._errors import ArgumentError, Error, GpuError, SceneError
from gpugi._gpugi import Camera, Light, Material, Object, Scene, SceneList, __version__, adapters, builtin_scenes, techniques

if TYPE_CHECKING:
    from gpugi._bake import Baked, bake, export
    from gpugi._picture import Image, develop, read, save, show
    from gpugi._render import Comparison, Frame, Measurement, PathTracer, Renderer, compare, measure, render
else:
    # NumPy takes longer to import than all else, and the command does without it.
    _PLACES = {
        "_bake": ["Baked", "bake", "export"],
        "_picture": ["Image", "develop", "read", "save", "show"],
        "_render": ["Comparison", "Frame", "Measurement", "PathTracer", "Renderer", "compare", "measure", "render"],
    }

    def __getattr__(name: str) -> object:
        for place, names in _PLACES.items():
            if name in names:
                module = importlib.import_module(f"gpugi.{place}")
                globals().update({name: getattr(module, name) for name in names})
                return globals()[name]
        raise AttributeError(f"module 'gpugi' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})


__all__ = [
    "ArgumentError",
    "Baked",
    "Camera",
    "Comparison",
    "Error",
    "Frame",
    "GpuError",
    "Image",
    "Light",
    "Material",
    "Measurement",
    "Object",
    "PathTracer",
    "Renderer",
    "Scene",
    "SceneError",
    "SceneList",
    "__version__",
    "adapters",
    "bake",
    "builtin_scenes",
    "command",
    "compare",
    "develop",
    "export",
    "measure",
    "read",
    "render",
    "save",
    "show",
    "techniques",
]
