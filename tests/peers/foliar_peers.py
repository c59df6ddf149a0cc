#!/usr/bin/env python3
"""PROSPECT-D beside the layered leaf, as `mesophyll bench abm --peers` runs it.

    foliar_peers.py FOLDER      FOLDER holds leaves.csv: R450,T450,R550,T550,R650,T650, measured, a row a leaf

N, chlorophyll and carotenoids are fitted to the six readings of each leaf by SciPy's least_squares; water and dry
matter hardly matter at these wavelengths and are kept. Prints a JSON line: error = root mean square of measured less
computed, us = median time of a leaf. Needs prosail and SciPy; says so if not.
"""
import csv
import json
import pathlib
import statistics
import sys
import time

try:
    import numpy as np
    import prosail
    from scipy.optimize import least_squares
except ImportError as missing:
    print(json.dumps({"skipped": f"skipped, Python has no {missing.name}"}))
    sys.exit(0)

STARTS = [(1.3, 20.0, 5.0), (1.8, 45.0, 10.0)]
# PROSPECT starts at 400 nm and has a value every nm.
AT = [50, 150, 250]


def computed(parameters):
    n, chlorophyll, carotenoid = parameters
    _, reflectance, transmittance = prosail.run_prospect(
        n, chlorophyll, carotenoid, 0.0, 0.01, 0.005, ant=0.0, prospect_version="D"
    )
    return np.column_stack([reflectance[AT], transmittance[AT]]).ravel()


def fitted(readings):
    bounds = ([1.0, 0.0, 0.0], [4.0, 400.0, 150.0])
    scale = [1.0, 30.0, 8.0]
    found = [least_squares(lambda p: computed(p) - readings, start, bounds=bounds, x_scale=scale) for start in STARTS]
    return min(found, key=lambda f: f.cost)


with open(pathlib.Path(sys.argv[1]) / "leaves.csv", newline="") as file:
    leaves = [np.array([float(cell) for cell in row]) for row in list(csv.reader(file))[1:]]
computed((1.5, 40.0, 8.0))  # it is compiled at its first call
squares, times = [], []
for leaf in leaves:
    clock = time.perf_counter()
    found = fitted(leaf)
    times.append(time.perf_counter() - clock)
    squares.append(2 * found.cost / len(leaf))
worst = max(squares) ** 0.5
note = f"{len(leaves)} species, R and T at three wavelengths, root mean square, three parameters, worst {worst:.1e}"
print(json.dumps({"peer": "PROSPECT-D (prosail)", "error": statistics.fmean(squares) ** 0.5,
    "us": statistics.median(times) * 1e6, "note": note}))
