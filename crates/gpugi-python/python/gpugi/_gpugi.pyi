"""The compiled part of gpugi."""

from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from typing import Any, Generic, TypeVar, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

_Vector = Sequence[float] | NDArray[Any]
_Color = float | _Vector
_Call = Callable[[float, str], object]
_Thing = TypeVar("_Thing", covariant=True)

@final
class SceneList(Generic[_Thing]):
    """A list of a scene's lights, materials, objects or cameras. Takes an index or a name."""

    @property
    def names(self) -> list[str]:
        """The names, in order; several may be the same."""

    def __len__(self) -> int: ...
    def __getitem__(self, which: int | str) -> _Thing: ...
    def __iter__(self) -> Iterator[_Thing]: ...

@final
class Light:
    """A light without extent: a point, a spot or a direction."""

    def __init__(
        self,
        kind: str,
        *,
        position: _Vector | None = None,
        target: _Vector | None = None,
        direction: _Vector | None = None,
        intensity: _Color | None = None,
        radius: float | None = None,
        cone: Sequence[float] | None = None,
        name: str = "",
    ) -> None:
        """kind: point, spot or directional. position, target: world space (m). intensity: linear Rec. 709, W/sr, or W/m²
        of directions. radius: of the emitter that soft shadows assume (m), of directions half its angle (rad). cone: half
        angles (rad) at which a spot begins to fade, and ends.

        Raises ArgumentError, which names the argument.
        """

    @property
    def name(self) -> str: ...
    @property
    def kind(self) -> str:
        """point, spot or directional."""

    @property
    def position(self) -> list[float]:
        """World space (m)."""

    @position.setter
    def position(self, value: _Vector) -> None: ...
    @property
    def direction(self) -> list[float]:
        """Where it shines to: a unit vector."""

    @direction.setter
    def direction(self, value: _Vector) -> None: ...
    @property
    def intensity(self) -> list[float]:
        """Linear Rec. 709: W/sr, or W/m² of directions."""

    @intensity.setter
    def intensity(self, value: _Color) -> None: ...
    @property
    def radius(self) -> float:
        """Radius of the emitter (m), or half its angle (rad) for directions."""

    @radius.setter
    def radius(self, value: float) -> None: ...

@final
class Material:
    """A surface as glTF 2.0 describes it, with extensions. Colours are linear Rec. 709."""

    def __init__(
        self,
        *,
        name: str = "",
        base_color: _Color | None = None,
        emission: _Color | None = None,
        metallic: float | None = None,
        roughness: float | None = None,
        ior: float | None = None,
        specular: float | None = None,
        transmission: float | None = None,
        diffuse_transmission: float | None = None,
    ) -> None:
        """A white, matt dielectric, but for what is given. Raises ArgumentError, which names the argument."""

    @property
    def name(self) -> str: ...
    @property
    def base_color(self) -> list[float]:
        """Albedo, or what a metal reflects."""

    @base_color.setter
    def base_color(self, value: _Color) -> None: ...
    @property
    def emission(self) -> list[float]:
        """Radiance that the front emits [W/sr/m²]."""

    @emission.setter
    def emission(self, value: _Color) -> None: ...
    @property
    def metallic(self) -> float:
        """0 dielectric, 1 metal."""

    @metallic.setter
    def metallic(self, value: float) -> None: ...
    @property
    def roughness(self) -> float:
        """Perceptual roughness; GGX's alpha is its square."""

    @roughness.setter
    def roughness(self, value: float) -> None: ...
    @property
    def ior(self) -> float:
        """Index of refraction."""

    @ior.setter
    def ior(self, value: float) -> None: ...
    @property
    def specular(self) -> float:
        """Strength of the dielectric reflection; 0 gives a pure Lambert surface."""

    @specular.setter
    def specular(self, value: float) -> None: ...
    @property
    def transmission(self) -> float:
        """Share of the light that enters the surface."""

    @transmission.setter
    def transmission(self, value: float) -> None: ...
    @property
    def diffuse_transmission(self) -> float:
        """Share of the diffuse light that leaves on the other side."""

    @diffuse_transmission.setter
    def diffuse_transmission(self, value: float) -> None: ...
    @property
    def double_sided(self) -> bool:
        """Both sides are visible."""

    @double_sided.setter
    def double_sided(self, value: bool) -> None: ...

@final
class Object:
    """A mesh in a place. Several objects may share a mesh and a material."""

    @property
    def name(self) -> str: ...
    @property
    def transform(self) -> NDArray[np.float32]:
        """World space (m) from the mesh's: (4, 4), which multiplies columns."""

    @transform.setter
    def transform(self, value: ArrayLike) -> None: ...
    @property
    def position(self) -> list[float]:
        """Where the mesh's origin is, in world space (m)."""

    @position.setter
    def position(self, value: _Vector) -> None: ...
    @property
    def material(self) -> Material:
        """Its material, which other objects may share. What is set is a material of its scene, or copied."""

    @material.setter
    def material(self, value: Material) -> None: ...

@final
class Camera:
    """A camera that looks along its local -Z; +Y is up."""

    @staticmethod
    def look_at(
        eye: _Vector,
        target: _Vector,
        *,
        up: _Vector | None = None,
        fov: float | None = None,
        aperture: float | None = None,
        focus: float | None = None,
        shutter: float | None = None,
        name: str = "",
    ) -> Camera:
        """A perspective camera at `eye` that looks at `target` (world space (m)). fov: vertical (degrees; 35). aperture:
        radius of the lens (m); focus: the distance that it sees sharply (m), by default that of the target; shutter: how
        long it is open (s).

        Raises ArgumentError, which names the argument.
        """

    @property
    def name(self) -> str: ...
    @property
    def transform(self) -> NDArray[np.float32]:
        """World space (m) from the camera's: (4, 4); columns are right, up, backward and the eye."""

    @transform.setter
    def transform(self, value: ArrayLike) -> None: ...
    @property
    def position(self) -> list[float]:
        """Where it is, in world space (m)."""

    @property
    def direction(self) -> list[float]:
        """Where it looks: a unit vector."""

    @property
    def fov(self) -> float | None:
        """Vertical field of view (degrees); None for parallel projections."""

    @fov.setter
    def fov(self, value: float) -> None: ...

@final
class Scene:
    """Everything that is lit, and its lights and cameras; world space is right-handed, +Y up, in metres."""

    def __init__(self, name: str = "scene") -> None:
        """An empty scene."""

    @staticmethod
    def load(
        scene: str | PathLike[str],
        *,
        environment: str | PathLike[str] | None = None,
        detail: int = 1,
        time: float = 0.0,
        without: str = "",
        edit: Sequence[str] = (),
        files_from: str | PathLike[str] | None = None,
        limits: str = "",
    ) -> Scene:
        """Loads a file (.gltf, .glb, .obj, .ply), or a built-in scene by its name. The options are those of the command.
        A scene without light gets a sky; notes says so.

        Raises SceneError if a file is missing or broken, ArgumentError for what makes no sense.
        """

    @property
    def name(self) -> str:
        """The name of the file, or of the built-in scene."""

    @property
    def notes(self) -> list[str]:
        """What loading had to say, one sentence each."""

    @property
    def statistics(self) -> dict[str, Any]:
        """Counts and sizes, as `gpugi info` prints them."""

    @property
    def origin(self) -> list[float]:
        """Where the origin of world space lies in the file's coordinates (m): not at 0 for scenes far away."""

    @property
    def bounds(self) -> tuple[list[float], list[float]]:
        """The corners of the box that holds all objects (m), in the file's coordinates."""

    @property
    def lights(self) -> SceneList[Light]:
        """Points, spots and directions."""

    @property
    def materials(self) -> SceneList[Material]:
        """What surfaces are made of."""

    @property
    def objects(self) -> SceneList[Object]:
        """Placed meshes."""

    @property
    def cameras(self) -> SceneList[Camera]:
        """Cameras, the default one first."""

    def camera(self, which: str | int | None = None, *, aspect: float = 1.0) -> Camera:
        """The camera of an index or a name; without, the first, or one that frames the scene for an image of this aspect
        ratio (width / height). Also takes the words of the command: "eye=0,1,3;target=0,0,0;fov=40"."""

    def add_mesh(
        self,
        vertices: ArrayLike,
        triangles: ArrayLike,
        *,
        material: Material | None = None,
        transform: ArrayLike | None = None,
        normals: ArrayLike | None = None,
        uvs: ArrayLike | None = None,
        name: str = "",
    ) -> Object:
        """Adds a mesh and places it, with a copy of the material. Triangles are counter-clockwise where they face the viewer.

        vertices: (N, 3) numbers (m). triangles: (M, 3) whole numbers, indices of vertices. normals: (N, 3); smooth ones
        without. uvs: (N, 2), v downward. transform: (4, 4), world space from the mesh's. Arrays may have any strides.

        Raises ArgumentError, which names the argument.
        """

    def add_light(self, light: Light) -> Light:
        """Adds a copy of a light, and returns that."""

    def add_camera(self, camera: Camera) -> Camera:
        """Adds a copy of a camera, and returns that."""

    def remove(self, names: str) -> None:
        """Removes the objects, lights and media of these names, separated by commas; * stands for any characters."""

    def edit(self, edit: str) -> None:
        """Edits as the command does: "light.0.position=0,2,0"."""

    def pose(self, time: float) -> None:
        """Sets what moves by animation to a time (s)."""

    def set_environment(
        self,
        image: str | PathLike[str] | ArrayLike | None,
        *,
        rotation: float | Sequence[float] | None = None,
        intensity: float | None = None,
    ) -> None:
        """Lights the scene by an equirectangular image (.hdr, .exr, .ktx2, .png, .jpg), or by linear radiance of shape
        (height, width, 3); None switches the environment off. rotation: degrees about +Y, or yaw, pitch and roll."""

    def copy(self) -> Scene:
        """A copy, which shares meshes and images until one of both changes."""

@final
class Renderer:
    def __init__(
        self, scene: Scene, size: tuple[int, int], techniques: list[str], settings: list[str], adapter: str
    ) -> None: ...
    @property
    def techniques(self) -> list[str]: ...
    def set(self, technique: str, name: str, value: str) -> None: ...
    def render(
        self, camera: Camera, samples: int | None, seed: int, aovs: list[str], progress: _Call | None
    ) -> dict[str, Any]: ...

@final
class PathTracer:
    def __init__(self, scene: Scene, size: tuple[int, int], settings: list[str], adapter: str) -> None: ...
    def render(
        self,
        camera: Camera,
        samples: int,
        noise: float,
        seed: int,
        denoise: bool,
        aovs: list[str],
        progress: _Call | None,
    ) -> dict[str, Any]: ...

@final
class SharedBake:
    def __init__(
        self,
        scene: Scene,
        techniques: list[str],
        settings: list[str],
        options: list[str],
        adapter: str,
        output: str | PathLike[str] | None,
        atlas: bytes | None,
        progress: _Call | None,
    ) -> None: ...
    def atlas(self) -> bytes: ...
    def tasks(self) -> list[bytes]: ...
    def run(self, task: bytes, progress: _Call | None = None) -> bytes: ...
    def merge(self, result: bytes) -> None: ...
    @property
    def is_complete(self) -> bool: ...
    def finish(self, output: str | PathLike[str]) -> dict[str, Any]: ...

def adapter_of(adapter: str) -> str: ...
def adapters() -> list[str]:
    """Names of the GPUs of this machine, and of its software adapter if there is one."""

def builtin_scenes() -> list[tuple[str, str]]:
    """Names of the built-in scenes, and what they show."""

def techniques() -> list[tuple[str, str]]:
    """Names of the techniques, and what they do."""

def bake(
    scene: Scene,
    output: str | PathLike[str],
    techniques: list[str],
    settings: list[str],
    options: list[str],
    adapter: str,
    progress: _Call | None,
) -> dict[str, Any]: ...
def export(scene: Scene, output: str | PathLike[str]) -> list[str]: ...
def command(arguments: list[str]) -> int: ...
def compare(
    test: ArrayLike, reference: ArrayLike, metrics: list[str] | None
) -> dict[str, tuple[float, NDArray[np.float32]]]: ...
def develop(radiance: ArrayLike, settings: list[str], adapter: str) -> NDArray[np.uint8]: ...
def read(path: str | PathLike[str]) -> NDArray[np.float32]: ...
def png(rgba: NDArray[np.uint8]) -> bytes: ...
def measure(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    techniques: list[str],
    settings: list[str],
    samples: int,
    reference_samples: int,
    noise: float,
    seed: int,
    all_light: bool,
    adapter: str,
    progress: _Call | None,
) -> dict[str, Any]: ...
def scene_from_bytes(bytes: bytes) -> Scene: ...
def camera_from_bytes(bytes: bytes) -> Camera: ...
