"""python blender_picture.py FILE.glb PICTURE.png SIDE: what Blender's Cycles shows of a bake, without other light."""

import os
import sys

import bpy

file, picture, side = sys.argv[1], sys.argv[2], int(sys.argv[3])
sys.path.insert(0, os.path.dirname(file))
import blender_lightmap  # noqa: E402

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=file)
blender_lightmap.show(file)
scene = bpy.context.scene
scene.camera = next(one for one in scene.objects if one.type == "CAMERA")
scene.world = bpy.data.worlds.new("black")
scene.world.use_nodes = True
scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
scene.render.engine = "CYCLES"
scene.cycles.device = "CPU"
# A pixel is the mean of its area, as in the other programs.
scene.cycles.pixel_filter_type = "BOX"
scene.cycles.samples = 64
scene.cycles.max_bounces = 0
scene.cycles.use_denoising = False
scene.view_settings.view_transform = "Standard"
scene.render.resolution_x = scene.render.resolution_y = side
scene.render.image_settings.file_format = "PNG"
scene.render.filepath = picture
bpy.ops.render.render(write_still=True)
