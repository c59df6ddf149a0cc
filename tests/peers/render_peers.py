#!/usr/bin/env python3
"""Embree on the crown of `mesophyll bench render`, as `mesophyll bench render --peers` runs it.

    render_peers.py FOLDER      FOLDER holds positions.f32, indices.u32 and, for each kind of rays, KIND.f32 (origin and direction)
                                and KIND.i32 (the triangle that Mesophyll finds)

Both programs take turns: the script prints {"turn": KIND}, reads Mesophyll's time of a ray (us) from standard input, and then times Embree.
Prints a JSON line a program and kind: error = share of rays whose answer is not Mesophyll's, us = median time of a ray.
Needs NumPy and embreex (Embree 4, one ray after another, f32); says what is missing.
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
    note = f"{1 / us:.2f} Mrays/s, one thread, median of {len(times)} turns{note}"
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
