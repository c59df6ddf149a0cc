"""Clear skies as spherical harmonics.

Conventions: z is up, the sun stands at azimuth 0, which is +x. Radiance is in kcd/m^2, linear sRGB, not clamped.
Harmonics are real and orthonormal, without the Condon-Shortley phase, at index l(l+1)+m; they hold the upper
hemisphere, zero below the horizon, without the sun's disk.
"""

from __future__ import annotations

import warnings
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._result import Floats, broadcast, floats, strict

__all__ = ["coefficients", "evaluate", "irradiance"]


def coefficients(
    sun_zenith: ArrayLike,
    turbidity: ArrayLike,
    bands: int = 7,
    *,
    method: Literal["fit", "compact", "direct", "chebyshev", "monomials-qr"] = "fit",
    model: Literal["preetham", "hosek-wilkie"] = "preetham",
    albedo: float = 0.2,
    window: Literal["none", "zonal", "lanczos", "fitted", "positive"] = "none",
    ground: float = 0.0,
) -> Floats:
    """Spherical harmonics of a clear sky; what ``mesophyll eval sky`` does.

    Parameters
    ----------
    sun_zenith : array_like
        Angle of the sun from the zenith, radians, 0 to pi/2.
    turbidity : array_like
        Turbidity; 2 is a clear day and 10 a hazy one. The fit covers 2.5 to 6; what lies outside is integrated.
    bands : int
        Bands N: degrees l < N. 3 light a diffuse surface.
    method : str
        fit: fitted polynomials, 1e-5; compact: half the size, 1e-4; direct: integrated, 1e-9; the others fit the sky
        as a black box.
    model : {"preetham", "hosek-wilkie"}
        The sky; hosek-wilkie needs ``method="direct"``.
    albedo : float
        Ground albedo of hosek-wilkie, 0 to 1.
    window : str
        Factors against ringing; "positive" lets no sky dip below zero.
    ground : float
        Albedo, 0 to 1, of level ground whose light fills the lower hemisphere.

    Returns
    -------
    ndarray, shape (..., bands**2, 3)
        Coefficients for red, green and blue; ``...`` is the shape that sun and turbidity broadcast to.

    Raises
    ------
    ValueError
        For a sun or turbidity that no such sky has, and for options that do not go together.

    Warns
    -----
    UserWarning
        For skies that the fit does not cover, and for turbidities outside those for which the sky model is trusted.

    Examples
    --------
    >>> import numpy as np, mesophyll as mp
    >>> mp.sky.coefficients(np.radians(40), 3.0).shape
    (49, 3)
    """
    # Before anything is as large as the bands ask for.
    if not 1 <= bands <= _native.MOST_BANDS:
        raise ValueError(f"bands is {bands}; expected 1 to {_native.MOST_BANDS}")
    (sun, haze), shape = broadcast(sun_zenith=sun_zenith, turbidity=turbidity)
    out = np.empty((sun.size, bands**2 * 3))
    troubles, said = _native.sky_coefficients(sun, haze, bands, (method, model, window), (albedo, ground), out)
    strict(troubles, shape)
    for words in said:
        warnings.warn(words, stacklevel=2)
    return out.reshape(*shape, bands**2, 3)


def _sums(coefficients: ArrayLike, vectors: ArrayLike, name: str, irradiance: bool) -> Floats:
    """Sums of the harmonics along vectors, shape (..., 3)."""
    sky, read = floats(coefficients, "coefficients"), floats(vectors, name)
    bands = round(sky.shape[0] ** 0.5) if sky.ndim == 2 else 0
    if sky.ndim != 2 or sky.shape[1] != 3 or bands**2 != sky.shape[0]:
        raise ValueError(f"coefficients have shape {sky.shape}; expected (bands**2, 3)")
    if read.ndim == 0 or read.shape[-1] != 3:
        raise ValueError(f"{name} have shape {read.shape}; expected (..., 3)")
    out = np.empty((read.size // 3, 3))
    strict(_native.sky_evaluate(sky, bands, read, irradiance, out), read.shape[:-1])
    return out.reshape(read.shape)


def evaluate(coefficients: ArrayLike, directions: ArrayLike) -> Floats:
    """Radiance that coefficients give in some directions.

    Parameters
    ----------
    coefficients : array_like, shape (bands**2, 3)
        One sky, as :func:`coefficients` returns it.
    directions : array_like, shape (..., 3)
        Directions of any length but 0; z is up.

    Returns
    -------
    ndarray, shape (..., 3)
        Red, green and blue in kcd/m^2.
    """
    return _sums(coefficients, directions, "directions", False)


def irradiance(coefficients: ArrayLike, normals: ArrayLike) -> Floats:
    """Light that a sky sends onto surfaces: what a shader takes for a diffuse material.

    Parameters
    ----------
    coefficients : array_like, shape (bands**2, 3)
        One sky, as :func:`coefficients` returns it.
    normals : array_like, shape (..., 3)
        Normals of the surfaces, of any length but 0; z is up.

    Returns
    -------
    ndarray, shape (..., 3)
        Irradiance in klx. Divide by pi and multiply by the albedo for the radiance of a diffuse surface.
    """
    return _sums(coefficients, normals, "normals", True)
