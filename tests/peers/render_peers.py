#!/usr/bin/env python3
"""Embree and Mitsuba on the crown of `mesophyll bench render`, as `mesophyll bench render --peers` runs it.

    render_peers.py FOLDER      FOLDER holds positions.f32, indices.u32 and, for each kind of rays, KIND.f32 (origin and
                                direction) and KIND.i32 (the triangle that Mesophyll finds); paths.json says what
                                picture is drawn

Both programs take turns: the script prints {"turn": KIND}, reads Mesophyll's time of a ray (us) from standard input,
and then times the peer. Prints a JSON line a program and kind: us = median time of a ray or camera path; error = share
of rays whose answer is not Mesophyll's, or for pictures the difference of their mean radiance over Mesophyll's.
Everything runs on one thread. Needs NumPy and embreex (Embree 4, one ray after another, f32); pictures also need
mitsuba (3.9), its vectorised variant LLVM 19. Says what is missing.
"""
import importlib.metadata
import json
import pathlib
import statistics
import sys
import time

try:
    import numpy as np
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh
except ImportError as missing:
    print(json.dumps({"skipped": f"skipped, Python has no {missing.name}"}))
    sys.exit(0)

TURNS = 15
folder = pathlib.Path(sys.argv[1])
positions = np.fromfile(folder / "positions.f32", np.float32).reshape(-1, 3)
indices = np.fromfile(folder / "indices.u32", np.uint32).reshape(-1, 3).astype(np.int32)
scene = rtcore_scene.EmbreeScene()
mesh = TriangleMesh(scene, positions, indices)
version = importlib.metadata.version("embreex")


def row(peer, kind, error, times, note):
    us = statistics.median(times)
    note = f"{1 / us:.3f} M/s, one thread, median of {len(times)} turns{note}"
    print(json.dumps({"peer": f"{peer} {kind}", "error": error, "us": us, "note": note}), flush=True)


for kind in ("camera", "incoherent", "shadow"):
    rays = np.fromfile(folder / f"{kind}.f32", np.float32).reshape(-1, 2, 3)
    origins, directions = np.ascontiguousarray(rays[:, 0]), np.ascontiguousarray(rays[:, 1])
    query = "OCCLUDED" if kind == "shadow" else "INTERSECT"
    expected = np.fromfile(folder / f"{kind}.i32", np.int32)
    found = scene.run(origins, directions, query=query)
    if kind == "shadow":
        found, expected = found >= 0, expected >= 0
    error = float(np.mean(found != expected))
    ours, theirs = [], []
    for turn in range(TURNS + 1):
        print(json.dumps({"turn": kind}), flush=True)
        our = float(sys.stdin.readline())
        clock = time.perf_counter()
        scene.run(origins, directions, query=query)
        their = (time.perf_counter() - clock) * 1e6 / len(rays)
        if turn > 0:  # the first warms up
            ours.append(our)
            theirs.append(their)
    ratio = statistics.median(b / a for a, b in zip(ours, theirs))
    row(f"Embree (embreex {version})", kind, error, theirs, "; share of answers that are not Mesophyll's")
    row("mesophyll", kind, 0.0, ours, f", {ratio:.2f} times Embree's rate (median of the turns' quotients)")

try:
    import drjit as dr
    import mitsuba as mi
except ImportError as missing:
    print(json.dumps({"skipped": f"pictures skipped, Python has no {missing.name}"}))
    sys.exit(0)

said = json.loads((folder / "paths.json").read_text())
pixels, samples = said["pixels"], said["samples"]
count = pixels * pixels * samples


def picture(variant):
    """A function that draws the crown once, in a variant of Mitsuba."""
    mi.set_variant(variant)
    dr.set_thread_count(0)  # the calling thread alone
    crown = mi.Mesh("crown", len(positions), len(indices), has_vertex_normals=False)
    values = mi.traverse(crown)
    values["vertex_positions"] = positions.ravel()
    values["faces"] = indices.astype(np.uint32).ravel()
    values.update()
    crown.write_ply(str(folder / "crown.ply"))
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": said["bounces"] + 1, "hide_emitters": True},
        "sky": {"type": "constant", "radiance": 1.0},
        "crown": {
            "type": "ply", "filename": str(folder / "crown.ply"), "face_normals": True,
            "leaf": {
                "type": "twosided",
                "matte": {"type": "diffuse", "reflectance": {"type": "rgb", "value": said["rho"]}},
            },
        },
        "camera": {
            "type": "perspective", "fov": said["fov_deg"], "near_clip": 1.0, "far_clip": 1e5,
            "to_world": mi.ScalarTransform4f().look_at(said["eye"], [0, 0, 0], [0, 0, 1]),
            "film": {
                "type": "hdrfilm", "width": pixels, "height": pixels, "rfilter": {"type": "box"}, "pixel_format": "rgb",
            },
            "sampler": {"type": "independent", "sample_count": samples},
        },
    })
    return lambda seed: np.array(mi.render(scene, seed=seed, spp=samples))


# LLVM last: one that is too old ends the process.
for variant in ("scalar_rgb", "llvm_ad_rgb"):
    try:
        draw = picture(variant)
        ours, theirs, means = [], [], []
        for turn in range(6):
            print(json.dumps({"turn": "paths"}), flush=True)
            our = float(sys.stdin.readline())
            clock = time.perf_counter()
            drawn = draw(turn)
            their = (time.perf_counter() - clock) * 1e6 / count
            if turn > 0:
                ours.append(our)
                theirs.append(their)
                means.append(float(drawn[:, :, 1].mean()))
    except Exception as error:  # Mitsuba reports what it lacks by exceptions of many kinds
        print(json.dumps({"skipped": f"Mitsuba {variant}: {str(error).splitlines()[0]}"}))
        continue
    ratio = statistics.median(b / a for a, b in zip(ours, theirs))
    off = statistics.fmean(means) / said["mean"] - 1
    version = f"Mitsuba {mi.__version__} {variant}"
    row(version, "paths", abs(off), theirs,
        f"; mean radiance against ours, whose standard error is {said['error'] / said['mean']:.4f}")
    row(f"mesophyll beside {variant}", "paths", 0.0, ours,
        f", {ratio:.2f} times the peer's rate (median of the turns' quotients)")
