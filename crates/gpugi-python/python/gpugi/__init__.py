"""gpugi: real-time and baked global illumination on any GPU.

    >>> import gpugi
    >>> image = gpugi.render("cornell", size=(512, 512))
    >>> gpugi.show(image)

Images are NumPy arrays of shape (height, width, 3) with linear radiance (Rec. 709) as 32-bit floats, rows from the top.
World space is right-handed, +Y up, in metres; angles are in degrees where a name says fov or rotation, else in radians.
"""

import os

if not os.path.isabs(os.environ.get("XDG_RUNTIME_DIR", "")):
    # Without it, Mesa's layer that sorts adapters complains for each; gpugi sorts them itself.
    os.environ.setdefault("NODEVICE_SELECT", "1")

from gpugi._bake import Baked, bake, export
from gpugi._errors import ArgumentError, Error, GpuError, SceneError
from gpugi._gpugi import Camera, Light, Material, Object, Scene, SceneList, __version__, adapters, builtin_scenes, techniques
from gpugi._picture import Image, develop, read, save, show
from gpugi._render import (
    Comparison,
    Frame,
    Measurement,
    PathTracer,
    Renderer,
    compare,
    measure,
    render,
)

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
