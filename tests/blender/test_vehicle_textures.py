"""The texture of an artist's vehicle is read as renders show it, and left as it is."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from .painted_box import a_box

COLOR = (128, 51, 26)


def textured_box(image):
    box = a_box()
    tree = box.data.materials[0].node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(texture.outputs[0], shader.inputs["Base Color"])
    return box


def an_image(color, floats=False):
    image = bpy.data.images.new("livery", 8, 8, float_buffer=floats)
    image.pixels.foreach_set(np.tile(np.float32([*color, 1]), 64))
    return image


def packed(folder):
    image = an_image(np.array(COLOR) / 255)
    image.pack()
    return image


def unsaved(folder):
    return an_image(np.array(COLOR) / 255)


def painted_on_a_file(folder):
    image = an_image((0, 0, 0))
    image.filepath_raw, image.file_format = str(folder / "livery.png"), "PNG"
    image.save()
    image.pixels.foreach_set(np.tile(np.float32([*np.array(COLOR) / 255, 1]), 64))
    return image


@pytest.mark.parametrize("make", [packed, unsaved, painted_on_a_file])
def test_reading_a_vehicle_leaves_its_texture_as_it_is(addon, tmp_path, make):
    image = make(tmp_path)
    textured_box(image)
    before = image.colorspace_settings.name, image.is_dirty, list(image.pixels)
    assert bpy.ops.rauca.check_uvs() == {"FINISHED"}
    assert (image.colorspace_settings.name, image.is_dirty, list(image.pixels)) == before
    read = bpy.context.scene.rauca.vehicle.chosen(bpy.context).base_texture
    assert read is not None
    assert read[0, 0].tolist() == list(COLOR)


def test_a_texture_of_floats_is_light(addon):
    textured_box(an_image((2.0, 0.5, 0.0), floats=True))
    read = bpy.context.scene.rauca.vehicle.chosen(bpy.context).base_texture
    assert read[0, 0].tolist() == [255, 188, 0]


def test_a_texture_of_16_bits_is_read_as_its_file_holds_it(addon, tmp_path):
    scene = bpy.data.scenes.new("writer")
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "PNG", "16"
    an_image(np.array(COLOR) / 255, floats=True).save_render(str(tmp_path / "livery.png"), scene=scene)
    textured_box(bpy.data.images.load(str(tmp_path / "livery.png")))
    read = bpy.context.scene.rauca.vehicle.chosen(bpy.context).base_texture
    assert read[0, 0].tolist() == list(COLOR)
