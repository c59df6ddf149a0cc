#!/usr/bin/env python3
"""SciPy and lmfit on linear-light-source traces, as `mesophyll bench gloss --peers` runs them.

    gloss_peers.py FOLDER       FOLDER holds gloss.json: the device, the tube positions u, and texels with truth and RGB
                                traces

Fits eight parameters a texel: rho_d and rho_s a channel, slope m and tilt (thin tube, Eq. 7 of Wang et al. 2005, eight
Gauss nodes, derivatives by differences, noise weights from the samples). Prints a JSON line a peer: error = median
relative error of m, us = median time a texel.
"""
import json
import pathlib
import statistics
import sys
import time

try:
    import numpy as np
except ImportError:
    print(json.dumps({"skipped": "skipped, Python has no NumPy"}))
    sys.exit(0)

given = json.loads((pathlib.Path(sys.argv[1]) / "gloss.json").read_text())
u = np.array(given["u"])
camera = np.radians(given["camera_deg"])
half_length = given["tube_length_mm"] / given["height_mm"] / 2
theta, r = np.arctan(u), np.hypot(1, u)
phi = np.arctan(half_length / r)
across = np.cos(theta - camera)
gauss_x, gauss_w = np.polynomial.legendre.leggauss(8)
gauss_x, gauss_w = (gauss_x + 1) / 2, gauss_w / 2


def responses(m, b):
    """Diffuse and glossy response of every frame for slope m and tilt b."""
    a, c = np.cos(theta - b), np.cos(camera - b)
    diffuse = np.maximum(u * np.sin(b) + np.cos(b), 0) * (2 / np.pi) / r**2 * (phi + np.sin(phi) * np.cos(phi))
    fall = np.maximum((2 * a * (1 + across) - across * (a + c)) / (a + c) ** 3, 1e-3)
    end = np.minimum(np.sin(phi), 3.9 * m / np.sqrt(fall))
    q = np.sqrt(1 - (end[:, None] * gauss_x) ** 2)
    cos2 = (a[:, None] * q + c) ** 2 / (2 * (1 + across[:, None] * q))
    glossy = (np.exp(-(1 / cos2 - 1) / m**2) / cos2**2 * gauss_w).sum(axis=1) * end / (np.pi * m**2 * c * r)
    lit = a > 0
    return np.where(lit, diffuse, 0), np.where(lit, glossy, 0)


def residuals(p, trace, sigma):
    diffuse, glossy = responses(abs(p[6]), p[7])
    return ((np.outer(p[0:3], diffuse) + np.outer(p[3:6], glossy) - trace) / sigma).ravel()


def start(trace):
    """Tilt from the brightest frame beyond a diffuse guess, the reflectances from linear least squares."""
    diffuse, _ = responses(0.2, 0.0)
    level = np.median(trace.sum(axis=0) / diffuse)
    peak = theta[np.argmax(trace.sum(axis=0) - level * diffuse)]
    tilt = (peak + camera) / 2
    basis = np.stack(responses(0.2, tilt), axis=1)
    linear = np.linalg.lstsq(basis, trace.T, rcond=None)[0]
    return np.concatenate([linear[0], linear[1], [0.2, tilt]])


def score(peer, fit):
    errors, times = [], []
    for texel in given["texels"]:
        trace = np.array(texel["trace"]).T
        sigma = np.hypot(given["noise_relative"] * trace, given["noise_floor"])
        clock = time.perf_counter()
        try:
            with np.errstate(all="ignore"):
                m = abs(fit(lambda p: residuals(p, trace, sigma), start(trace))[6])
        except Exception:  # a peer that gives up has no answer
            m = float("nan")
        times.append(time.perf_counter() - clock)
        errors.append(abs(m / texel["m"] - 1))
    failed = sum(not e < 0.2 for e in errors)
    errors = [e if e == e else float("inf") for e in errors]
    note = f"{len(errors)} RGB texels, relative error of m, {failed} beyond 20 %"
    print(json.dumps({"peer": peer, "error": statistics.median(errors), "us": statistics.median(times) * 1e6,
        "note": note}), flush=True)


try:
    from scipy.optimize import least_squares

    score("SciPy lm", lambda f, p: least_squares(f, p, method="lm", x_scale=np.abs(p) + 0.01).x)
    low, high = [-1] * 6 + [0.005, -1.05], [10] * 6 + [1.2, 1.05]
    score("SciPy trf", lambda f, p: least_squares(f, np.clip(p, low, high), bounds=(low, high), x_scale="jac").x)
except ImportError:
    print(json.dumps({"skipped": "SciPy is not installed, skipped"}))
try:
    import lmfit

    def by_lmfit(f, p):
        params = lmfit.Parameters()
        for k, value in enumerate(p):
            params.add(f"p{k}", value=value)
        out = lmfit.minimize(lambda q: f(np.array([q[f"p{k}"].value for k in range(8)])), params)
        return [out.params[f"p{k}"].value for k in range(8)]

    score("lmfit", by_lmfit)
except ImportError:
    print(json.dumps({"skipped": "lmfit is not installed, skipped"}))
