import math
import os

import bpy
from mathutils import Vector

HERE = os.path.dirname(os.path.abspath(__file__))


def value(nodes, links, of, socket, single=False):
    """Sets a socket to a number, or to a picture of linear numbers."""
    if isinstance(of, str):
        node = nodes.new("ShaderNodeTexImage")
        node.image = bpy.data.images.load(os.path.join(HERE, of), check_existing=True)
        node.image.colorspace_settings.name = "Non-Color"
        node.extension = "EXTEND"
        links.new(node.outputs["Color"], socket)
    else:
        socket.default_value = of[0] if single else [*of, 1.0]


def surface(tree, side, slopes):
    """Matte light on both sides and gloss, added."""
    nodes, links = tree.nodes, tree.links
    normal = None
    if "normal" in side:
        normal = nodes.new("ShaderNodeNormalMap")
        value(nodes, links, side["normal"], normal.inputs["Color"])
    parts = []
    for kind, colour in [("Diffuse", "diffuse"), ("Translucent", "through"), ("Glossy", "gloss")]:
        # Glossy BSDF has been called Anisotropic inside since Blender 4.0.
        node = nodes.new("ShaderNodeBsdfAnisotropic" if kind == "Glossy" else f"ShaderNodeBsdf{kind}")
        value(nodes, links, side[colour], node.inputs["Color"])
        if kind == "Glossy":
            node.distribution = slopes
            value(nodes, links, side["roughness"], node.inputs["Roughness"], single=True)
        if normal and kind != "Translucent":
            links.new(normal.outputs["Normal"], node.inputs["Normal"])
        parts.append(node.outputs["BSDF"])
    for _ in range(2):
        add = nodes.new("ShaderNodeAddShader")
        links.new(parts.pop(), add.inputs[0])
        links.new(parts.pop(), add.inputs[1])
        parts.append(add.outputs[0])
    return parts[0]


def material(name, sheet):
    made = bpy.data.materials.get(name) or bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    nodes, links = tree.nodes, tree.links
    nodes.clear()
    mix, geometry = nodes.new("ShaderNodeMixShader"), nodes.new("ShaderNodeNewGeometry")
    links.new(geometry.outputs["Backfacing"], mix.inputs["Fac"])
    for side, socket in [("front", 1), ("back", 2)]:
        links.new(surface(tree, sheet[side], sheet["slopes"]), mix.inputs[socket])
    last = mix
    if "mask" in sheet:
        last, clear = nodes.new("ShaderNodeMixShader"), nodes.new("ShaderNodeBsdfTransparent")
        value(nodes, links, sheet["mask"], last.inputs["Fac"])
        links.new(clear.outputs[0], last.inputs[1])
        links.new(mix.outputs[0], last.inputs[2])
    output = nodes.new("ShaderNodeOutputMaterial")
    links.new(last.outputs[0], output.inputs["Surface"])


def lights(scene):
    if DATA["sun"]:
        sun = bpy.data.lights.new("sun", "SUN")
        most = max(DATA["sun"]["irradiance"])
        sun.energy, sun.angle = most, DATA["sun"]["angle"]
        sun.color = [v / most for v in DATA["sun"]["irradiance"]] if most > 0 else [0, 0, 0]
        held = bpy.data.objects.new("sun", sun)
        held.rotation_mode = "QUATERNION"
        held.rotation_quaternion = Vector(DATA["sun"]["towards"]).to_track_quat("Z", "Y")
        scene.collection.objects.link(held)
    world = bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    background, output = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeOutputWorld")
    links.new(background.outputs[0], output.inputs["Surface"])
    if isinstance(DATA["sky"], str):
        picture = nodes.new("ShaderNodeTexEnvironment")
        picture.image = bpy.data.images.load(os.path.join(HERE, DATA["sky"]))
        picture.image.colorspace_settings.name = "Non-Color"
        links.new(picture.outputs["Color"], background.inputs["Color"])
    else:
        background.inputs["Color"].default_value = [*(DATA["sky"] or [0, 0, 0]), 1.0]


def build():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=os.path.join(HERE, "scene.glb"))
    for name, sheet in DATA["materials"].items():
        material(name, sheet)
    scene = bpy.context.scene
    scene.camera = next((o for o in bpy.data.objects if o.type == "CAMERA"), None)
    lights(scene)
    scene.render.engine = "CYCLES"
    scene.cycles.samples = DATA["samples"]
    scene.cycles.max_bounces = 64
    scene.cycles.diffuse_bounces = 64
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x, scene.render.resolution_y = DATA["size"]
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.exposure = DATA["stops"]


build()
