"""Runs inside Blender: builds the described scene and writes its pictures; decides nothing.

Started by ``job`` in a separate process; the only module of the renderers that imports ``bpy``.
"""
# bpy is a compiled module without types.
# pyright: reportAttributeAccessIssue=false

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from harness.core.errors import DataError
from harness.core.process.workers import worker_main
from renderers.blender.scene import BlenderView, KeyLight, RenderJob, Scene

#: In order of preference.
_GPU_KINDS = ("OPTIX", "CUDA", "HIP", "METAL", "ONEAPI")


def handle(job: RenderJob, progress: Callable[[int, int], None]) -> dict[str, object]:
    """Render every view of a scene; returns the device."""
    description = job.scene
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    device = _choose_device(scene)
    _set_quality(scene, description)
    _set_output(scene, description)
    _set_world(scene, description.ambient)
    _add_mesh(scene, job.mesh, _textured_material(job.texture))
    camera, light = _add_camera(scene), _add_light(scene)
    for done, view in enumerate(description.views):
        _point(scene, camera, view)
        _aim(light, view.key_light)
        scene.render.filepath = str(job.folder / view.file)
        bpy.ops.render.render(write_still=True)
        progress(done + 1, len(description.views))
    return {"device": device}


def _choose_device(scene: Any) -> str:
    scene.render.engine = "CYCLES"
    threads = os.cpu_count() or 1
    scene.render.threads_mode = "FIXED"
    scene.render.threads = threads
    preferences = bpy.context.preferences.addons["cycles"].preferences
    # Once for all kinds, because a later refresh would free the entries that are used here.
    preferences.refresh_devices()
    for kind in _GPU_KINDS:
        found = preferences.get_devices_for_type(kind)
        gpus = [device for device in found if device.type == kind]
        if gpus:
            preferences.compute_device_type = kind
            for device in found:
                device.use = device.type == kind
            scene.cycles.device = "GPU"
            return f"{kind} {', '.join(device.name for device in gpus)}"
    scene.cycles.device = "CPU"
    return f"CPU ({threads} threads)"


def _set_quality(scene: Any, description: Scene) -> None:
    cycles = scene.cycles
    cycles.samples = description.samples
    cycles.use_adaptive_sampling = False
    # A box filter of one pixel: alpha is coverage, and edges are not shifted or widened.
    cycles.pixel_filter_type = "BOX"
    cycles.use_denoising = description.denoise
    cycles.denoiser = "OPENIMAGEDENOISE"
    cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
    cycles.denoising_prefilter = "FAST"
    cycles.use_animated_seed = False
    cycles.max_bounces = description.diffuse_bounces
    cycles.diffuse_bounces = description.diffuse_bounces
    cycles.glossy_bounces = 0
    cycles.transmission_bounces = 0
    cycles.volume_bounces = 0
    cycles.transparent_max_bounces = 0
    cycles.caustics_reflective = False
    cycles.caustics_refractive = False
    # The acceleration structure and the texture stay loaded between views.
    scene.render.use_persistent_data = True


def _set_output(scene: Any, description: Scene) -> None:
    render = scene.render
    render.resolution_x, render.resolution_y = description.width, description.height
    render.resolution_percentage = 100
    render.film_transparent = True
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode = "RGBA"
    render.image_settings.color_depth = "8"
    # The parent writes the file again, so its size does not matter.
    render.image_settings.compression = 0
    render.use_file_extension = False
    render.dither_intensity = 0.0
    scene.display_settings.display_device = "sRGB"
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    scene.view_settings.exposure = 0.0
    scene.view_settings.gamma = 1.0


def _set_world(scene: Any, radiance: float) -> None:
    world = bpy.data.worlds.new("studio")
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    background.inputs["Strength"].default_value = radiance
    # Uniform light has no direction, so there is nothing to sample.
    world.cycles.sampling_method = "NONE"
    scene.world = world


def _textured_material(texture: Path) -> Any:
    """A matt surface with the texture's colour, lit from both sides."""
    try:
        image = bpy.data.images.load(str(texture))
    except RuntimeError as error:
        raise DataError(f"Blender cannot read the texture {texture}", got=str(error)) from error
    if 0 in image.size:
        raise DataError(f"the texture {texture} is not a complete image")
    image.colorspace_settings.name = "sRGB"
    material = bpy.data.materials.new("matt")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    colour = tree.nodes.new("ShaderNodeTexImage")
    colour.image = image
    matt = tree.nodes.new("ShaderNodeBsdfDiffuse")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(colour.outputs["Color"], matt.inputs["Color"])
    tree.links.new(matt.outputs["BSDF"], output.inputs["Surface"])
    return material


def _add_mesh(scene: Any, arrays: Path, material: Any) -> None:
    with np.load(arrays) as data:
        vertices, faces, corner_uv = data["vertices"], data["faces"], data["corner_uv"]
    mesh = bpy.data.meshes.new("subject")
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    mesh.uv_layers.new(name="uv").data.foreach_set("uv", corner_uv.ravel())
    mesh.materials.append(material)
    mesh.update(calc_edges=True)
    # Removes what would crash Blender: faces with a repeated vertex, and repeated faces.
    mesh.validate()
    mesh.shade_smooth()
    scene.collection.objects.link(bpy.data.objects.new("subject", mesh))


def _add_camera(scene: Any) -> Any:
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.sensor_fit = "HORIZONTAL"
    camera.data.clip_start, camera.data.clip_end = 0.01, 1000.0
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def _add_light(scene: Any) -> Any:
    light = bpy.data.objects.new("key", bpy.data.lights.new("key", "AREA"))
    light.data.shape = "SQUARE"
    light.visible_camera = False
    scene.collection.objects.link(light)
    return light


def _point(scene: Any, camera: Any, view: BlenderView) -> None:
    camera.matrix_world = np.array(view.camera.matrix_world).T
    camera.data.type = "ORTHO" if view.camera.width_m else "PERSP"
    if view.camera.width_m:
        camera.data.ortho_scale = view.camera.width_m
    camera.data.lens = view.camera.lens_mm
    camera.data.sensor_width = view.camera.sensor_mm
    camera.data.shift_x, camera.data.shift_y = view.camera.shift_x, view.camera.shift_y
    scene.cycles.seed = view.seed
    # Blender takes an empty border for the whole picture; a few empty pixels are cheap.
    left, bottom, right, top = view.border or (0.0, 0.0, 1 / 64, 1 / 64)
    scene.render.use_border, scene.render.use_crop_to_border = True, False
    scene.render.border_min_x, scene.render.border_max_x = left, right
    scene.render.border_min_y, scene.render.border_max_y = bottom, top


def _aim(light: Any, key: KeyLight | None) -> None:
    light.hide_render = key is None
    if key is not None:
        light.matrix_world = np.array(key.matrix_world).T
        light.data.size = key.side_m
        light.data.energy = key.power_w


if __name__ == "__main__":
    worker_main(handle)
