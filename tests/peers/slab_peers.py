#!/usr/bin/env python3
"""iadpython (adding-doubling) on the slab, as `mesophyll bench slab --peers` runs it.

    slab_peers.py FOLDER        FOLDER holds slab.csv: omega,delta,rho_d,rho_t, isotropic, index-matched, normal
                                incidence

Prints a JSON line a peer: error = median over the rows of the larger relative error, us = median time a row. Needs
iadpython; says so if not.
"""
import csv
import json
import pathlib
import statistics
import sys
import time

try:
    import iadpython
except ImportError:
    print(json.dumps({"skipped": "iadpython is not installed, skipped"}))
    sys.exit(0)

BUDGET_S = 20.0  # inversions are slow: as many rows as fit


def sample(omega=0.5, delta=1.0):
    return iadpython.Sample(a=omega, b=delta, g=0, n=1.0, n_above=1.0, n_below=1.0, quad_pts=8)


def score(peer, work, rows):
    errors, times = [], []
    started = time.perf_counter()
    for row in rows:
        clock = time.perf_counter()
        found, truth = work(*row)
        times.append(time.perf_counter() - clock)
        errors.append(max(abs(f / t - 1) for f, t in zip(found, truth)))
        if time.perf_counter() - started > BUDGET_S:
            break
    note = f"{len(errors)} rows, worst error {max(errors):.1e}"
    print(json.dumps({"peer": peer, "error": statistics.median(errors), "us": statistics.median(times) * 1e6,
        "note": note}), flush=True)


def forward(omega, delta, rho_d, rho_t):
    ur1, ut1, _, _ = sample(omega, delta).rt()
    return (ur1, ut1), (rho_d, rho_t)


def inverse(omega, delta, rho_d, rho_t):
    a, b, _ = iadpython.Experiment(r=rho_d, t=rho_t, sample=sample(), default_g=0).invert_rt()
    return (a, b), (omega, delta)


with open(pathlib.Path(sys.argv[1]) / "slab.csv", newline="") as file:
    table = [tuple(float(row[name]) for name in ("omega", "delta", "rho_d", "rho_t")) for row in csv.DictReader(file)]
score("iadpython forward, 8 points", forward, table)
score("iadpython inverse, 8 points", inverse, table)
