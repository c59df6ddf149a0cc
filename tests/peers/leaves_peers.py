#!/usr/bin/env python3
"""PROSPECT-D beside the stack of plates, as `mesophyll bench foliar --peers` runs it.

    leaves_peers.py FOLDER      FOLDER holds leaves.csv: R400,T400,…, then the measured contents, a row a leaf

Seven parameters (N, chlorophyll, carotenoids, anthocyanins, brown pigments, water, dry matter) are fitted to the
readings of each leaf by SciPy's least_squares, with PROSPECT-D's published constants. Prints a JSON line: error = root
mean square of measured less computed over all leaves, us = median time of a leaf. Needs prosail and SciPy; says so if
not.
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

FILE = pathlib.Path(sys.argv[1]) / "leaves.csv"
if not FILE.exists():
    print(json.dumps({"skipped": "skipped, there are no leaves with measured contents"}))
    sys.exit(0)
# N, chlorophyll, carotenoids, anthocyanins, brown pigments, water, dry matter
START = [1.6, 40.0, 9.0, 1.0, 0.05, 0.011, 0.005]
LEAST = [1.0, 0.0, 0.0, 0.0, 0.0, 1e-5, 1e-5]
MOST = [4.5, 250.0, 80.0, 50.0, 10.0, 0.15, 0.08]
# Contents in the order of leaves.csv, and where PROSPECT's parameters have them.
NAMES = {"chlorophyll_ug_cm2": 1, "carotenoid_ug_cm2": 2, "water_g_cm2": 5, "dry_g_cm2": 6}

with open(FILE, newline="") as file:
    header, *rows = list(csv.reader(file))
count = len(header) - len(NAMES)
# PROSPECT starts at 400 nm and has a value every nm.
at = np.array([round(float(name[1:])) - 400 for name in header[:count:2]])
cells = [[float(cell) if cell else float("nan") for cell in row] for row in rows]


def computed(p):
    n, chlorophyll, carotenoid, anthocyanin, brown, water, dry = p
    _, r, t = prosail.run_prospect(
        n, chlorophyll, carotenoid, brown, water, dry, ant=anthocyanin, prospect_version="D"
    )
    return np.column_stack([r[at], t[at]]).ravel()


def fitted(readings):
    known = ~np.isnan(readings)
    miss = lambda p: (computed(p) - readings)[known]
    return least_squares(miss, START, bounds=(LEAST, MOST), x_scale=START, max_nfev=100)


computed(START)  # it is compiled at its first call
squares, times, found = [], [], []
for row in cells:
    readings = np.array(row[:count])
    clock = time.perf_counter()
    fit = fitted(readings)
    times.append(time.perf_counter() - clock)
    squares.append(2 * fit.cost / np.count_nonzero(~np.isnan(readings)))
    found.append(fit.x)
notes = []
for k, (name, parameter) in enumerate(NAMES.items()):
    pairs = [(f[parameter], row[count + k]) for f, row in zip(found, cells) if row[count + k] == row[count + k]]
    a, b = np.array(pairs).T
    notes.append(f"{name} r {np.corrcoef(a, b)[0, 1]:.2f}, bias {100 * (a.mean() / b.mean() - 1):+.0f} %")
median = statistics.median(s**0.5 for s in squares)
note = f"R and T, root mean square over {len(cells)} leaves, median {median:.4f}; {'; '.join(notes)}; states no errors"
print(json.dumps({"peer": "PROSPECT-D (prosail), seven parameters", "error": statistics.fmean(squares) ** 0.5,
    "us": statistics.median(times) * 1e6, "note": note}))
