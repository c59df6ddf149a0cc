"""The compiled part: flat arrays in, cells a row out, and a list of the rows whose status is not ok."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Troubles = list[tuple[int, str]]

__version__: str
MOST_BANDS: int

def slab_invert(
    r: Floats, t: Floats, thickness: Floats, r_err: Floats, t_err: Floats, method: str, surface: float, out: Floats
) -> Troubles: ...
def slab_forward(sigma_a: Floats, sigma_s: Floats, thickness: Floats, out: Floats) -> Troubles: ...
def slab_evaluate(
    omega: Floats, delta: Floats, one_minus_omega: Floats, method: str, incidence_deg: float, out: Floats
) -> Troubles: ...
def gloss_frames(device: str, name: str) -> list[float]: ...
def gloss_fit(
    traces: Floats,
    channels: int,
    device: tuple[str, str],
    lobe_of: tuple[str, float],
    quadrature: int,
    robust: str,
    out: Floats,
) -> tuple[list[str], Troubles]: ...
def gloss_fit_samples(
    rows: Floats, names: Sequence[str], lobe_of: tuple[str, float]
) -> tuple[list[str], list[float], str]: ...
def leaf_fit(
    capture: str,
    out: str,
    method: str,
    lobe_of: tuple[str, float],
    robust: bool,
    hold_out: tuple[int, int],
    gloss: tuple[float, float] | None,
    force: bool,
    quiet: bool,
) -> None: ...
def verify(folder: str) -> list[str]: ...
def read_exr(path: str) -> tuple[int, int, list[tuple[str, bytearray]]]: ...
def write_exr(path: str, width: int, height: int, channels: Sequence[tuple[str, Floats]]) -> None: ...
def sky_coefficients(
    sun_zenith: Floats,
    turbidity: Floats,
    bands: int,
    ways: tuple[str, str, str],
    albedos: tuple[float, float],
    out: Floats,
) -> tuple[Troubles, list[str]]: ...
def sky_evaluate(
    coefficients: Floats, bands: int, directions: Floats, irradiance: bool, out: Floats
) -> Troubles: ...
def beam(alpha: Floats, x: Floats, out: Floats) -> Troubles: ...
def dipole(
    thickness: Floats, radius: Floats, tissue: tuple[float, float, float, float], dipoles: int, method: str, out: Floats
) -> Troubles: ...
def abm(leaves: Floats, side: str, path: str, rays: int, seed: int, out: Floats) -> Troubles: ...
