#!/usr/bin/env python3
"""Mitsuba's radiative backpropagation with Adam on the scene of `mesophyll bench scene --peers`.

    scene_peers.py FOLDER      FOLDER holds positions.f32 and indices.u32 (the leaves' triangles, mm), and scene.json:
                               camera, light, true numbers, numbers to start from, noise

Mitsuba draws the measured picture itself, from the true numbers and with the same noise, so that nothing that the two
programs draw differently counts as an error. Leaves are sheets with a reflectance on each side and a transmittance,
as a BSDF in Python. Losses are weighted by the noise, and the rate of Adam falls with time, which helps it. Both
programs fit the twelve numbers on all processors, and times are the sums of all processors: the script prints
{"turn": "scene"}, reads Mesophyll's time (us) from standard input, which was measured right before the script started,
and then goes on with Mitsuba until its error is Mesophyll's target or LIMIT times Mesophyll's time is over. Error =
root mean square, over the numbers, of what they are off by, over their true values. Needs mitsuba (3.9) and LLVM 19.
Says what is missing.
"""
import json
import math
import pathlib
import sys
import time

try:
    import numpy as np
    import drjit as dr
    import mitsuba as mi
except ImportError as missing:
    print(json.dumps({"skipped": f"skipped, Python has no {missing.name}"}))
    sys.exit(0)

LIMIT = 20  # times Mesophyll's time
SAMPLES = 16  # paths a pixel of a step
STEPS = 4000
RATE, LAST = 0.02, 0.0005  # of Adam, at the beginning and after STEPS
WHOLE = 512  # paths a pixel of the measured picture
NAMES = ["front", "back", "through", "ground"]

folder = pathlib.Path(sys.argv[1])
said = json.loads((folder / "scene.json").read_text())
try:
    mi.set_variant("llvm_ad_rgb")
except Exception as error:
    print(json.dumps({"skipped": f"Mitsuba llvm_ad_rgb: {str(error).splitlines()[0]}"}))
    sys.exit(0)


class Sheet(mi.BSDF):
    """A matte sheet: what either side reflects, and what passes in both directions."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.front, self.back, self.through = (mi.Color3f(props[name]) for name in ("front", "back", "through"))
        both = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        self.m_components = [mi.BSDFFlags.DiffuseReflection | both, mi.BSDFFlags.DiffuseTransmission | both]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def traverse(self, callback):
        for name in ("front", "back", "through"):
            callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)

    def share(self, reflected):
        """The probability that light is reflected, as a number without derivatives."""
        r, t = dr.detach(dr.mean(reflected)), dr.detach(dr.mean(self.through))
        return dr.clip(r / dr.maximum(r + t, 1e-6), 0.1, 0.9)

    def reflected(self, wi):
        return dr.select(mi.Frame3f.cos_theta(wi) > 0, self.front, self.back)

    def sample(self, ctx, si, sample1, sample2, active=True):
        reflected = self.reflected(si.wi)
        share, side = self.share(reflected), dr.sign(mi.Frame3f.cos_theta(si.wi))
        mirrored = sample1 < share
        wo = mi.warp.square_to_cosine_hemisphere(sample2)
        pdf = mi.warp.square_to_cosine_hemisphere_pdf(wo) * dr.select(mirrored, share, 1 - share)
        wo.z = dr.select(mirrored, wo.z * side, -wo.z * side)
        bs = mi.BSDFSample3f()
        bs.wo, bs.pdf, bs.eta = wo, pdf, 1.0
        bs.sampled_type = dr.select(
            mirrored, mi.UInt32(+mi.BSDFFlags.DiffuseReflection), mi.UInt32(+mi.BSDFFlags.DiffuseTransmission))
        bs.sampled_component = dr.select(mirrored, mi.UInt32(0), mi.UInt32(1))
        value = dr.select(mirrored, reflected / share, self.through / (1 - share))
        return bs, value & (active & (pdf > 0))

    def eval(self, ctx, si, wo, active=True):
        ci, co = mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(wo)
        rho = dr.select(ci * co > 0, self.reflected(si.wi), self.through)
        return (rho * (dr.abs(co) * dr.inv_pi)) & active

    def pdf(self, ctx, si, wo, active=True):
        ci, co = mi.Frame3f.cos_theta(si.wi), mi.Frame3f.cos_theta(wo)
        share = self.share(self.reflected(si.wi))
        return dr.select(active, dr.abs(co) * dr.inv_pi * dr.select(ci * co > 0, share, 1 - share), 0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def to_string(self):
        return "Sheet[]"


mi.register_bsdf("sheet", Sheet)


def scene(numbers):
    """The scene with these numbers."""
    positions = np.fromfile(folder / "positions.f32", np.float32)
    indices = np.fromfile(folder / "indices.u32", np.uint32)
    leaves = mi.Mesh("leaves", len(positions) // 3, len(indices) // 3, has_vertex_normals=False)
    values = mi.traverse(leaves)
    values["vertex_positions"], values["faces"] = positions, indices
    values.update()
    leaves.write_ply(str(folder / "leaves.ply"))
    rgb = lambda value: {"type": "rgb", "value": list(value)}
    toward = np.array(said["sun"]["toward"])
    return mi.load_dict({
        "type": "scene",
        "integrator": {"type": "prb", "max_depth": 16, "rr_depth": 5, "hide_emitters": True},
        "sky": {"type": "constant", "radiance": rgb(said["sky"])},
        "sun": {"type": "directional", "direction": list(-toward), "irradiance": rgb(said["sun"]["irradiance"])},
        "leaves": {
            "type": "ply", "filename": str(folder / "leaves.ply"), "face_normals": True,
            "leaf": {"type": "sheet", **{name: rgb_of(numbers[name]) for name in NAMES[:3]}},
        },
        "ground": {
            "type": "rectangle", "to_world": mi.ScalarTransform4f().scale([said["reach"], said["reach"], 1]),
            "soil": {"type": "twosided", "matte": {"type": "diffuse", "reflectance": rgb(numbers["ground"])}},
        },
        "camera": {
            "type": "perspective", "fov": said["fov_deg"], "fov_axis": "y", "near_clip": 1.0, "far_clip": 1e5,
            "to_world": mi.ScalarTransform4f().look_at(said["eye"], said["look_at"], [0, 0, 1]),
            "film": {
                "type": "hdrfilm", "width": said["size"][0], "height": said["size"][1], "rfilter": {"type": "box"},
                "pixel_format": "rgb",
            },
            "sampler": {"type": "independent"},
        },
    })


def rgb_of(value):
    return mi.ScalarColor3f(*value)


def numbers_of(parameters, keys):
    return {name: np.array(parameters[key]).ravel()[:3] for name, key in keys.items()}


truth, start = said["truth"], said["start"]
drawn = scene(truth)
measured = np.array(mi.render(drawn, seed=said["seed"], spp=WHOLE))
noise = np.random.default_rng(said["seed"])
measured *= 1 + said["noise"] * noise.standard_normal(measured.shape)
floor = 0.01 * measured.mean()
weight = mi.TensorXf(1 / (said["noise"] * np.maximum(measured, floor)) ** 2)
measured = mi.TensorXf(measured.astype(np.float32))

drawn = scene(start)
parameters = mi.traverse(drawn)
ends = {"front": ".front", "back": ".back", "through": ".through", "ground": ".reflectance.value"}
keys = {name: next(key for key in parameters.keys() if key.endswith(end)) for name, end in ends.items()}


def error():
    found = numbers_of(parameters, keys)
    off = [(found[name] - truth[name]) / np.array(truth[name]) for name in NAMES]
    return float(np.sqrt(np.mean(np.square(off))))


print(json.dumps({"turn": "scene"}), flush=True)
ours = float(sys.stdin.readline())
# The first render compiles, and does not count.
mi.render(drawn, parameters, seed=0, spp=SAMPLES)
optimiser = mi.ad.Adam(lr=RATE)
for key in keys.values():
    optimiser[key] = parameters[key]
parameters.update(optimiser)
before, spent, best, reached = error(), 0.0, math.inf, None
for step in range(STEPS):
    clock = time.process_time()
    optimiser.set_learning_rate(RATE * (LAST / RATE) ** (step / STEPS))
    seen = mi.render(drawn, parameters, seed=step + 1, spp=SAMPLES)
    loss = dr.mean(weight * dr.square(seen - measured), axis=None)
    dr.backward(loss)
    optimiser.step()
    for key in keys.values():
        optimiser[key] = dr.clip(optimiser[key], 0.0, 1.0)
    parameters.update(optimiser)
    now = error()
    spent += time.process_time() - clock
    best = min(best, now)
    if now <= said["target"]:
        reached = step + 1
        break
    if ours == ours and spent * 1e6 > LIMIT * ours:
        break
size = f"{said['size'][0]} x {said['size'][1]} pixels"
if reached:
    note = f"{reached} steps of {SAMPLES} paths a pixel, {size}, from an error of {before:.2f}"
    if ours == ours:
        note += f"; {spent * 1e6 / ours:.1f} times Mesophyll's processor time in this run"
else:
    note = f"target of {said['target']:.3f} not reached in {step + 1} steps of {SAMPLES} paths a pixel, {size}"
    note += f"; at best {best:.4f}"
    if ours == ours:
        note += f"; {spent * 1e6 / ours:.1f} times Mesophyll's processor time in this run are over"
print(json.dumps({"peer": f"Mitsuba {mi.__version__} prb, Adam", "error": now, "us": spent * 1e6, "note": note}))
