#!/usr/bin/env python3
"""SciPy and lmfit on the 27 NIST StRD problems from both starts, as `mesophyll bench solve --peers` runs them.

    nist_peers.py FOLDER        FOLDER holds the .dat files (data/nist)

Prints a JSON line a peer: error = 10^-(mean correct digits), us = median time of a fit. Needs NumPy with SciPy or
lmfit; says what is missing.
"""
import json
import math
import pathlib
import sys
import time

try:
    import numpy as np
except ImportError:
    print(json.dumps({"skipped": "skipped, Python has no NumPy"}))
    sys.exit(0)

exp, cos, sin, pi = np.exp, np.cos, np.sin, math.pi


def enso(b, x):
    turn = lambda period: 2 * pi * x / period
    return (b[0] + b[1] * cos(turn(12)) + b[2] * sin(turn(12)) + b[4] * cos(turn(b[3])) + b[5] * sin(turn(b[3]))
            + b[7] * cos(turn(b[6])) + b[8] * sin(turn(b[6])))


def gauss(b, x):
    return b[0] * exp(-b[1] * x) + b[2] * exp(-((x - b[3]) / b[4]) ** 2) + b[5] * exp(-((x - b[6]) / b[7]) ** 2)


def lanczos(b, x):
    return b[0] * exp(-b[1] * x) + b[2] * exp(-b[3] * x) + b[4] * exp(-b[5] * x)


def cubic_ratio(b, x):
    return (b[0] + x * (b[1] + x * (b[2] + x * b[3]))) / (1 + x * (b[4] + x * (b[5] + x * b[6])))


MODELS = {
    "Misra1a": lambda b, x: b[0] * (1 - exp(-b[1] * x)),
    "BoxBOD": lambda b, x: b[0] * (1 - exp(-b[1] * x)),
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** -2.0),
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Chwirut1": lambda b, x: exp(-b[0] * x) / (b[1] + b[2] * x),
    "Chwirut2": lambda b, x: exp(-b[0] * x) / (b[1] + b[2] * x),
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "Lanczos1": lanczos, "Lanczos2": lanczos, "Lanczos3": lanczos,
    "Gauss1": gauss, "Gauss2": gauss, "Gauss3": gauss,
    "Kirby2": lambda b, x: (b[0] + x * (b[1] + x * b[2])) / (1 + x * (b[3] + x * b[4])),
    "Hahn1": cubic_ratio, "Thurber": cubic_ratio,
    "ENSO": enso,
    "MGH09": lambda b, x: b[0] * (x * x + x * b[1]) / (x * x + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * exp(-x * b[3]) + b[2] * exp(-x * b[4]),
    "Roszman1": lambda b, x: b[0] - b[1] * x - np.arctan(b[2] / (x - b[3])) / pi,
    "Rat42": lambda b, x: b[0] / (1 + exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Eckerle4": lambda b, x: b[0] / b[1] * exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * exp(-b[2] * x[1]),
}


def read(path):
    lines = path.read_text().splitlines()
    table = []
    for line in lines[40:]:
        if "=" not in line:
            break
        table.append([float(v) for v in line.split("=")[1].split()])
    table = np.array(table)
    data = np.array([[float(v) for v in line.split()] for line in lines[60:] if line.strip()])
    y, x = data[:, 0], data[:, 1:].T
    if path.stem == "Nelson":
        y = np.log(y)
    else:
        x = x[0]
    return table[:, 0], table[:, 1], table[:, 2], x, y


def digits(found, certified):
    with np.errstate(all="ignore"):
        each = -np.log10(np.abs((found - certified) / certified))
    return float(np.clip(np.nan_to_num(each, nan=0.0, posinf=11.0, neginf=0.0), 0, 11).min())


def score(peer, fit, problems):
    scores, times = [], []
    for model, first, second, certified, x, y in problems:
        for start in (first, second):
            clock = time.perf_counter()
            try:
                with np.errstate(all="ignore"):
                    found = fit(lambda b: model(b, x) - y, start)
            except Exception:  # a peer that gives up has no digits
                found = np.full(len(start), np.nan)
            times.append(time.perf_counter() - clock)
            scores.append(digits(np.asarray(found), certified))
    mean = sum(scores) / len(scores)
    solved = sum(s > 4 for s in scores)
    note = f"NIST: {solved} of {len(scores)} solved, {mean:.2f} digits"
    print(json.dumps({"peer": peer, "error": 10.0 ** -mean, "us": sorted(times)[len(times) // 2] * 1e6, "note": note}),
        flush=True)


def main():
    folder = pathlib.Path(sys.argv[1])
    problems = []
    for name, model in MODELS.items():
        first, second, certified, x, y = read(folder / f"{name}.dat")
        problems.append((model, first, second, certified, x, y))
    try:
        from scipy.optimize import least_squares
        tight = dict(ftol=1e-15, xtol=1e-15, gtol=1e-15, max_nfev=20000)
        score("SciPy lm", lambda f, p: least_squares(f, p, method="lm").x, problems)
        score("SciPy lm, tuned", lambda f, p: least_squares(f, p, method="lm", x_scale=np.abs(p), **tight).x, problems)
        trf = dict(method="trf", x_scale="jac", jac="3-point", **tight)
        score("SciPy trf, tuned", lambda f, p: least_squares(f, p, **trf).x, problems)
    except ImportError:
        print(json.dumps({"skipped": "SciPy is not installed, skipped"}))
    try:
        import lmfit

        def by_lmfit(f, start):
            params = lmfit.Parameters()
            for k, value in enumerate(start):
                params.add(f"b{k}", value=value)
            out = lmfit.minimize(lambda p: f(np.array([p[f"b{k}"].value for k in range(len(start))])), params)
            return [out.params[f"b{k}"].value for k in range(len(start))]

        score("lmfit", by_lmfit, problems)
    except ImportError:
        print(json.dumps({"skipped": "lmfit is not installed, skipped"}))


main()
