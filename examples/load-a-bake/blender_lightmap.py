"""Shows the lightmaps of a file of `gpugi bake --bake-mode lightmap` in Blender, whose importer knows none.

    import bpy, blender_lightmap
    bpy.ops.import_scene.gltf(filepath="baked.glb")
    blender_lightmap.show("baked.glb")

Each material gets the light as emission, base colour times irradiance over pi, and reflects no other light diffusely.
"""

import math
import os

import bpy


def show(file: str) -> None:
    for material in bpy.data.materials:
        lightmap = material.get("gpugi", {}).get("lightmap")
        if lightmap is not None:
            _show(material, lightmap, os.path.dirname(os.path.abspath(file)))


def _show(material, lightmap, folder: str) -> None:
    nodes, links = material.node_tree.nodes, material.node_tree.links
    surface = next((node for node in nodes if node.type == "BSDF_PRINCIPLED"), None)
    if surface is None:
        return
    uvs = nodes.new("ShaderNodeUVMap")
    uvs.uv_map = f"UVMap.{lightmap['texCoord']:03}" if lightmap["texCoord"] else "UVMap"
    light = nodes.new("ShaderNodeTexImage")
    light.image = bpy.data.images.load(os.path.join(folder, lightmap["file"]), check_existing=True)
    light.image.colorspace_settings.name = "Linear Rec.709"
    links.new(uvs.outputs["UV"], light.inputs["Vector"])
    color = surface.inputs["Base Color"]
    product = nodes.new("ShaderNodeMixRGB")
    product.blend_type = "MULTIPLY"
    product.inputs["Fac"].default_value = 1
    links.new(light.outputs["Color"], product.inputs["Color1"])
    product.inputs["Color2"].default_value = color.default_value
    for link in color.links:
        links.new(link.from_socket, product.inputs["Color2"])
        links.remove(link)
    color.default_value = (0, 0, 0, 1)
    if surface.inputs["Emission Strength"].default_value == 0:
        links.new(product.outputs["Color"], surface.inputs["Emission Color"])
        is_over_pi = lightmap["quantity"] == "irradiance / pi"
        surface.inputs["Emission Strength"].default_value = 1 if is_over_pi else 1 / math.pi
