"""Compares gpugi with Mitsuba's volpath on small scenes with media and lenses, as in docs/techniques/path-tracer.md.

Usage: pip install mitsuba numpy
       python3 docs/compare_with_mitsuba.py GPUGI [SCENE...] [--samples 512] [--mitsuba-samples 2048]

GPUGI is the program, for example target/release/gpugi. Each scene is stated once, in `SCENES`, and written for both.
Prints a line of a table per scene:

- the mean radiance of both pictures;
- the difference of both pictures after averaging blocks of 8x8 pixels: its root mean square over that of Mitsuba's;
- the difference to be expected of pictures that differ by noise alone, from the spread between seeds;
- rel-mse of all seeds' mean, less what noise adds to it by that spread.
"""

import argparse
import base64
import json
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

BLOCK = 8


# What scenes are made of. Transforms are 4x4 matrices that act on columns.


def place(position=(0, 0, 0), turn=0.0, size=(1, 1, 1)):
    """Scales by `size`, turns about y by `turn` [rad], then moves to `position`."""
    c, s = np.cos(turn), np.sin(turn)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.diag(size)
    matrix[:3, 3] = position
    return matrix


def quad(corner, u, v, albedo=(0, 0, 0), radiance=None):
    """A matt parallelogram, seen and lit from the side of u x v."""
    return {"corner": np.array(corner, float), "u": np.array(u, float), "v": np.array(v, float),
            "albedo": albedo, "radiance": radiance}


def medium(box, extinction, albedo, g=0.0, rayleigh=False, density=None, emission=(0, 0, 0)):
    """`box` places the unit cube, -0.5 to 0.5; None: everywhere. `density` is indexed by z, y, x."""
    return {"box": box, "extinction": np.array(extinction, float), "albedo": albedo, "g": g,
            "rayleigh": rayleigh, "density": density, "emission": emission}


def room():
    """2 m wide, closed, with a lamp just below the ceiling."""
    white, red, green = (0.7, 0.7, 0.7), (0.6, 0.1, 0.1), (0.1, 0.5, 0.1)
    return [
        quad((-1, -1, 1), (2, 0, 0), (0, 0, -2), white),  # floor
        quad((-1, 1, -1), (2, 0, 0), (0, 0, 2), white),  # ceiling
        quad((-1, -1, -1), (2, 0, 0), (0, 2, 0), white),  # back
        quad((1, -1, 1), (-2, 0, 0), (0, 2, 0), white),  # front
        quad((-1, -1, 1), (0, 0, -2), (0, 2, 0), red),  # left
        quad((1, -1, -1), (0, 0, 2), (0, 2, 0), green),  # right
        quad((-0.4, 0.99, -0.4), (0.8, 0, 0), (0, 0, 0.8), radiance=(8, 7, 5)),
    ]


# They hang in that room, the first one emits light.
PANELS = [
    quad((-0.3, -0.2, 0.3), (0.25, 0, 0), (0, 0.35, 0), radiance=(3, 2, 1)),
    quad((0.2, -0.4, 0.0), (0.3, 0, 0.1), (0, 0.5, 0), (0.1, 0.3, 0.7)),
    quad((-0.8, -0.9, -0.6), (0.4, 0, -0.1), (0, 1.2, 0), (0.7, 0.7, 0.2)),
]
CLOUD = np.random.default_rng(7).uniform(0, 1, (4, 5, 6)) ** 2  # many thin cells, some dense
NO_MEDIUM = medium(None, [1] * 3, [0] * 3)
CLOUD_BOX = place(turn=0.5, size=(3, 2, 2))
CLOUD_ALBEDO = np.array([0.99, 0.9, 0.7])
FLOOR = quad((-3, -1.2, 3), (6, 0, 0), (0, 0, -6), (0.5, 0.5, 0.5))

# camera: eye, target, vertical field of view [degrees]. lens: radius of its aperture, distance at which it sees
# sharply [m]. sky: radiance of a constant environment. sun: direction of propagation, irradiance. point: position,
# intensity. glass: a box of index 1.5.
SCENES = {
    # Scatters isotropically.
    "fog": {
        "camera": ((2.5, 1.5, 4), (0, 0, 0), 35), "sky": 1.0,
        "medium": medium(place(size=(2, 2, 2)), [1.5] * 3, [0.9] * 3),
    },
    # Extinction and albedo by channel, and forward scattering.
    "mist": {
        "camera": ((2.5, 1.5, 4), (0, 0, 0), 35), "sun": ((-0.6, -1, -0.5), (5, 5, 5)),
        "medium": medium(place(size=(2, 2, 2)), [2, 1.5, 1], [0.95, 0.9, 0.7], g=0.6),
    },
    # A density.
    "cloud": {
        "camera": ((1, 1.5, 6), (0, 0, 0), 36), "sky": 1.0,
        "medium": medium(CLOUD_BOX, [6] * 3, CLOUD_ALBEDO, g=0.3, density=CLOUD),
    },
    # The same density above a floor.
    "shadow": {
        "camera": ((1, 2.5, 5), (0, -0.5, 0), 45), "sun": ((0.3, -1, -0.2), (3, 3, 3)), "quads": [FLOOR],
        "medium": medium(CLOUD_BOX, [6] * 3, CLOUD_ALBEDO, g=0.85, density=CLOUD),
    },
    # The same density as in "cloud" emits what it absorbs under a sky of radiance 1. Mitsuba's media do not emit, but
    # in thermal equilibrium radiance is 1 everywhere: this picture is 1 minus that of "cloud".
    "embers": {
        "camera": ((1, 1.5, 6), (0, 0, 0), 36), "sky": 0.0, "one_minus_sky": 1.0,
        "medium": medium(CLOUD_BOX, [6] * 3, CLOUD_ALBEDO, g=0.3, density=CLOUD,
                         emission=6 * (1 - CLOUD_ALBEDO)),
    },
    # Fog everywhere, with the camera in it.
    "room": {
        "camera": ((0.3, 0.1, 0.95), (0, -0.1, -1), 70), "quads": room(),
        "medium": medium(None, [0.5, 0.5, 0.8], [0.9, 0.9, 0.8], g=-0.3),
    },
    # The same with a point near the eye in place of the lamp.
    "point": {
        "camera": ((0.3, 0.1, 0.95), (0, -0.1, -1), 70), "quads": room()[:-1], "point": ((0.2, 0.3, 0.1), (3, 2.5, 2)),
        "medium": medium(None, [0.5, 0.5, 0.8], [0.9, 0.9, 0.8], g=0.4),
    },
    # No medium; a lens that sees the back of the room sharply, and one that sees what hangs before it.
    "far-lens": {"camera": ((0.3, 0.1, 0.95), (0, -0.1, -1), 70), "quads": room() + PANELS, "lens": (0.05, 1.9)},
    "near-lens": {"camera": ((0.3, 0.1, 0.95), (0, -0.1, -1), 70), "quads": room() + PANELS, "lens": (0.05, 0.8)},
    # A block of glass full of a medium that scatters as air does.
    "glass": {
        "camera": ((2, 1.5, 4), (0, -0.3, 0), 38), "glass": place(turn=0.4, size=(1.6, 1.6, 1.6)),
        "quads": [quad((-3, 3, -3), (6, 0, 0), (0, 0, 6), radiance=(2, 2, 2)),
                  quad((-3, -1, 3), (6, 0, 0), (0, 0, -6), (0.5, 0.5, 0.5))],
        "medium": medium(place(turn=0.4, size=(1.6, 1.6, 1.6)), [0.6, 0.8, 1.2], [0.9, 0.95, 0.98], rayleigh=True),
    },
}


# For gpugi: glTF and KTX2.


def ktx2(density):
    """A KTX2 file of a 3D texture, R32_SFLOAT."""
    depth, height, width = density.shape
    texels = density.astype("<f4").tobytes()
    # The data format descriptor: one sample of 32 bits, a signed float, linear.
    sample = struct.pack("<HBBIII", 0, 31, 0xC0, 0, 0xBF800000, 0x3F800000)
    block = struct.pack("<HHHHBBBB4B8B", 0, 0, 2, 24 + 16, 1, 1, 1, 0, 0, 0, 0, 0, 4, 0, 0, 0, 0, 0, 0, 0) + sample
    descriptor = struct.pack("<I", 4 + len(block)) + block
    at = 12 + 68 + 24  # identifier, header with index, one level
    texels_at = -(-(at + len(descriptor)) // 8) * 8
    head = b"\xabKTX 20\xbb\r\n\x1a\n"
    head += struct.pack("<9I", 100, 4, width, height, depth, 0, 1, 1, 0)  # 100: VK_FORMAT_R32_SFLOAT
    head += struct.pack("<4I2Q", at, len(descriptor), 0, 0, 0, 0)
    head += struct.pack("<3Q", texels_at, len(texels), len(texels))
    return (head + descriptor).ljust(texels_at, b"\0") + texels


def data_uri(data):
    return "data:application/octet-stream;base64," + base64.b64encode(data).decode()


def faces(box):
    """The six sides of a unit cube that `box` places, from outside."""
    def side(corner, u, v):
        corner, u, v = box @ [*corner, 1], box @ [*u, 0], box @ [*v, 0]
        return {"corner": corner[:3], "u": u[:3], "v": v[:3]}
    a, b = -0.5, 0.5
    return [side((a, a, b), (1, 0, 0), (0, 1, 0)), side((b, a, a), (-1, 0, 0), (0, 1, 0)),
            side((b, a, b), (0, 0, -1), (0, 1, 0)), side((a, a, a), (0, 0, 1), (0, 1, 0)),
            side((a, b, b), (1, 0, 0), (0, 0, -1)), side((a, a, a), (1, 0, 0), (0, 0, 1))]


def gltf(scene):
    """The scene as a glTF document."""
    data, nodes, materials, meshes, views, accessors, extensions = bytearray(), [], [], [], [], [], set()

    def view(array, kind, component, **more):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data.extend(array.tobytes())
        count = len(array) if array.ndim > 1 else array.size
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": count, "type": kind,
                          **more})
        return len(accessors) - 1

    def add(quads, material):
        around = ((0, 0), (1, 0), (1, 1), (0, 1))
        corners = np.array([q["corner"] + a * q["u"] + b * q["v"] for q in quads for a, b in around])
        normals = np.repeat([np.cross(q["u"], q["v"]) for q in quads], 4, axis=0)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        corners, normals = corners.astype("<f4"), normals.astype("<f4")
        indices = np.array([4 * i + j for i in range(len(quads)) for j in (0, 1, 2, 0, 2, 3)], "<u4")
        bounds = {"min": corners.min(axis=0).tolist(), "max": corners.max(axis=0).tolist()}
        attributes = {"POSITION": view(corners, "VEC3", 5126, **bounds), "NORMAL": view(normals, "VEC3", 5126)}
        materials.append(material)
        primitive = {"attributes": attributes, "indices": view(indices, "SCALAR", 5125), "material": len(materials) - 1}
        meshes.append({"primitives": [primitive]})
        nodes.append({"mesh": len(meshes) - 1})

    for q in scene.get("quads", []):
        # No reflection besides the diffuse one.
        matt = {"pbrMetallicRoughness": {"baseColorFactor": [*q["albedo"], 1], "metallicFactor": 0},
                "extensions": {"KHR_materials_specular": {"specularFactor": 0}}}
        extensions.add("KHR_materials_specular")
        if q["radiance"]:
            strength = max(q["radiance"])
            matt["emissiveFactor"] = [value / strength for value in q["radiance"]]
            matt["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
            extensions.add("KHR_materials_emissive_strength")
        add([q], matt)
    if "glass" in scene:
        glass = {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.5},
                 "KHR_materials_volume": {"thicknessFactor": 1}}
        extensions.update(glass)
        smooth = {"metallicFactor": 0, "roughnessFactor": 0}
        add(faces(scene["glass"]), {"pbrMetallicRoughness": smooth, "extensions": glass})
    document = {"asset": {"version": "2.0"}, "scene": 0, "nodes": nodes}
    if "sun" in scene:
        direction, irradiance = scene["sun"]
        z = -np.array(direction) / np.linalg.norm(direction)  # lights shine along -z
        x = np.cross((0, 1, 0), z)
        x /= np.linalg.norm(x)
        matrix = np.eye(4)
        matrix[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        strength = max(irradiance)
        light = {"type": "directional", "color": [value / strength for value in irradiance], "intensity": strength}
    if "point" in scene:
        position, intensity = scene["point"]
        matrix = place(position)
        strength = max(intensity)
        light = {"type": "point", "color": [value / strength for value in intensity], "intensity": strength}
    if "sun" in scene or "point" in scene:
        document["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
        extensions.add("KHR_lights_punctual")
        nodes.append({"matrix": matrix.T.ravel().tolist(), "extensions": {"KHR_lights_punctual": {"light": 0}}})
    fog = scene.get("medium")
    if not fog:
        return finished(document, meshes, materials, accessors, views, data, extensions)
    own = {"extinction": list(fog["extinction"]), "albedo": list(fog["albedo"]), "g": fog["g"],
           "emission": list(fog["emission"]), "phase": "cornette-shanks" if fog["rayleigh"] else "henyey-greenstein"}
    if fog["density"] is not None:
        own["density"] = data_uri(ktx2(fog["density"]))
    extras = {"gpugi": {"medium": own}}
    if fog["box"] is not None:
        nodes.append({"matrix": fog["box"].T.ravel().tolist(), "extras": extras})
    document["scenes"] = [{"nodes": list(range(len(nodes)))}]
    if fog["box"] is None:
        document["scenes"][0]["extras"] = extras
    return finished(document, meshes, materials, accessors, views, data, extensions)


def finished(document, meshes, materials, accessors, views, data, extensions):
    """The document with its lists, as text."""
    document.setdefault("scenes", [{"nodes": list(range(len(document["nodes"])))}])
    if meshes:
        document.update(meshes=meshes, materials=materials, accessors=accessors, bufferViews=views,
                        buffers=[{"byteLength": len(data), "uri": data_uri(data)}])
    if extensions:
        document["extensionsUsed"] = sorted(extensions)
    return json.dumps(document)


def render_gpugi(scene, folder, options):
    """One picture per seed."""
    file, picture = folder / "scene.gltf", folder / "picture.exr"
    file.write_text(gltf(scene))
    eye, target, fov = scene["camera"]
    words = lambda vector: ",".join(str(value) for value in vector)
    camera = f"eye={words(eye)};target={words(target)};fov={fov}"
    if "lens" in scene:
        aperture, focus = scene["lens"]
        camera += f";aperture={aperture};focus={focus}"
    by = [] if options.technique == "default" else ["--technique", options.technique]
    if options.technique == "path-tracer":
        by += ["--set", "path-tracer.max-bounces=1000"]
    command = [options.gpugi, "render", file, *by, "--camera", camera, "--adapter", options.adapter,
               "--size", f"{options.size}x{options.size}", "--samples", str(options.samples), "-o", picture]
    if "sky" in scene:
        sky = folder / "sky.exr"
        mi.Bitmap(np.full((2, 4, 3), scene["sky"], np.float32)).write(str(sky))
        command += ["--environment", sky]
    for seed in range(options.seeds):
        done = subprocess.run([*command, "--seed", str(seed)], capture_output=True, text=True)
        if done.returncode:
            sys.exit(done.stderr)
        read = mi.Bitmap(str(picture)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
        yield np.array(read)


# For Mitsuba.


def render_mitsuba(scene, options):
    """One picture per seed."""
    transform = lambda matrix: mi.ScalarTransform4f(matrix)
    rgb = lambda value: {"type": "rgb", "value": [float(channel) for channel in value]}
    eye, target, fov = scene["camera"]
    fog = scene.get("medium", NO_MEDIUM)
    phase = {"type": "rayleigh"} if fog["rayleigh"] else {"type": "hg", "g": fog["g"]}
    strength = float(max(fog["extinction"]))  # colours are at most 1, times this scale
    if fog["density"] is None:
        inside = {"type": "homogeneous", "sigma_t": rgb(fog["extinction"] / strength)}
    else:
        # The grid fills the cube from 0 to 1. Its values belong to centres of cells, as in gpugi.
        grid = mi.VolumeGrid(fog["density"].astype(np.float32)[..., None])
        to_world = transform(fog["box"] @ place((-0.5, -0.5, -0.5)))
        density = {"type": "gridvolume", "grid": grid, "raw": True, "filter_type": "trilinear", "wrap_mode": "clamp",
                   "to_world": to_world}
        inside = {"type": "heterogeneous", "sigma_t": density}
    inside.update(albedo=rgb(fog["albedo"]), scale=strength, phase=phase)
    parts = {
        "type": "scene", "fog": inside,
        "integrator": {"type": "volpath", "max_depth": -1},
        "sensor": {
            "type": "perspective", "fov": fov, "fov_axis": "y", "near_clip": 1e-3,
            "to_world": mi.ScalarTransform4f().look_at(origin=eye, target=target, up=(0, 1, 0)),
            "film": {"type": "hdrfilm", "width": options.size, "height": options.size, "pixel_format": "rgb",
                     "component_format": "float32", "rfilter": {"type": "box"}},
            "sampler": {"type": "independent"},
        },
    }
    # A cube spans -1 to 1, like a rectangle.
    cube = lambda box, surface: {"type": "cube", "to_world": transform(box @ place(size=(0.5, 0.5, 0.5))),
                                 "bsdf": surface, "interior": {"type": "ref", "id": "fog"}}
    if fog is NO_MEDIUM:
        pass
    elif fog["box"] is None:
        parts["sensor"]["medium"] = {"type": "ref", "id": "fog"}
    elif "glass" in scene:
        parts["glass"] = cube(scene["glass"], {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0})
    else:
        parts["box"] = cube(fog["box"], {"type": "null"})
    for index, q in enumerate(scene.get("quads", [])):
        matrix = np.eye(4)
        centre = q["corner"] + (q["u"] + q["v"]) / 2
        matrix[:3, :] = np.stack([q["u"] / 2, q["v"] / 2, np.cross(q["u"], q["v"]), centre], axis=1)
        shape = {"type": "rectangle", "to_world": transform(matrix),
                 "bsdf": {"type": "diffuse", "reflectance": rgb(q["albedo"])}}
        if q["radiance"]:
            shape["emitter"] = {"type": "area", "radiance": rgb(q["radiance"])}
        parts[f"quad{index}"] = shape
    sky = scene.get("one_minus_sky", scene.get("sky"))
    if sky:
        parts["sky"] = {"type": "constant", "radiance": rgb([sky] * 3)}
    if "sun" in scene:
        direction, irradiance = scene["sun"]
        parts["sun"] = {"type": "directional", "direction": direction, "irradiance": rgb(irradiance)}
    if "point" in scene:
        position, intensity = scene["point"]
        parts["point"] = {"type": "point", "position": position, "intensity": rgb(intensity),
                          "medium": {"type": "ref", "id": "fog"}}
    if "lens" in scene:
        aperture, focus = scene["lens"]
        parts["sensor"].update(type="thinlens", aperture_radius=aperture, focus_distance=focus)
    if fog is NO_MEDIUM:
        del parts["fog"]
    loaded = mi.load_dict(parts)
    for seed in range(options.seeds):
        picture = np.array(mi.render(loaded, spp=options.mitsuba_samples, seed=seed))
        yield scene["one_minus_sky"] - picture if "one_minus_sky" in scene else picture


# The comparison.


def blocks(picture):
    """Means of blocks of pixels."""
    height, width, _ = picture.shape
    return picture.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, 3).mean(axis=(1, 3))


def compare(ours, theirs):
    """Mean radiances, their difference with its standard error, the difference of blocks, that of noise alone. The
    last four are relative."""
    ours, theirs = (np.array([blocks(picture) for picture in pictures]) for pictures in (ours, theirs))
    size = np.sqrt((theirs.mean(axis=0) ** 2).mean())
    apart = np.sqrt(((ours.mean(axis=0) - theirs.mean(axis=0)) ** 2).mean()) / size
    variance = lambda pictures: pictures.var(axis=0, ddof=1) / len(pictures)
    noise = np.sqrt((variance(ours) + variance(theirs)).mean()) / size
    mean = theirs.mean()
    # Blocks are independent, channels are not.
    error = np.sqrt((variance(ours.mean(axis=3)) + variance(theirs.mean(axis=3))).mean() / ours[0, ..., 0].size) / mean
    return ours.mean(), mean, ours.mean() / mean - 1, error, apart, noise


def relative_error(ours, theirs):
    """rel-mse of the means of both, less what their noise adds to it."""
    ours, theirs = np.array(ours), np.array(theirs)
    reference = theirs.mean(axis=0)
    squares = (ours.mean(axis=0) - reference) ** 2
    variance = lambda pictures: pictures.var(axis=0, ddof=1) / len(pictures)
    return ((squares - variance(ours) - variance(theirs)) / (reference**2 + 0.01)).mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gpugi", type=Path)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=", ".join(SCENES))
    parser.add_argument("--technique", default="path-tracer", help="gpugi's; default: those of a still picture")
    parser.add_argument("--size", type=int, default=64, help=f"a multiple of {BLOCK}")
    parser.add_argument("--samples", type=int, default=512, help="of gpugi, per pixel and seed")
    parser.add_argument("--mitsuba-samples", type=int, default=2048, help="of Mitsuba, which is faster on a CPU")
    parser.add_argument("--seeds", type=int, default=4, help="at least 2")
    parser.add_argument("--adapter", default="software", help="gpugi's")
    parser.add_argument("--variant", default="scalar_rgb", help="Mitsuba's")
    options = parser.parse_args()
    mi.set_variant(options.variant)
    print(f"Mitsuba {mi.__version__} ({options.variant}), {options.size} x {options.size}, "
          f"{options.seeds} seeds, {options.samples} samples of gpugi and {options.mitsuba_samples} of Mitsuba each")
    print("| scene | gpugi | Mitsuba | difference of means [%] | difference of blocks [%] | of noise alone [%] | rel-mse |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for name in options.scenes or SCENES:
        with tempfile.TemporaryDirectory() as folder:
            ours = list(render_gpugi(SCENES[name], Path(folder), options))
        theirs = list(render_mitsuba(SCENES[name], options))
        a, b, difference, error, apart, noise = compare(ours, theirs)
        print(f"| {name} | {a:.5f} | {b:.5f} | {100 * difference:+.3f} +- {100 * error:.3f} "
              f"| {100 * apart:.3f} | {100 * noise:.3f} | {relative_error(ours, theirs):.6f} |", flush=True)


if __name__ == "__main__":
    main()
