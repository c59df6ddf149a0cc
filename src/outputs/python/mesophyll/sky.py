"""Clear skies as spherical harmonics.

Conventions: z is up, the sun stands at azimuth 0, which is +x. Radiance is in kcd/m^2, linear sRGB, not clamped.
Harmonics are real and orthonormal, without the Condon-Shortley phase, at index l(l+1)+m; they hold the upper
hemisphere, zero below the horizon, without the sun's disk.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _command, _native
from ._command import Option, Place
from ._errors import InputError
from ._result import Floats, Maps, Result, broadcast, floats, read_exr, strict
from .fits import made

__all__ = ["coefficients", "evaluate", "fit", "fit_panorama", "irradiance", "panorama", "sun"]


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
        fit: polynomials, off by 4.1e-6; compact: fewer terms, 1.1e-5; direct: integrated, 1e-9; the others fit the sky
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
    Error
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
        raise InputError(f"bands is {bands}; expected 1 to {_native.MOST_BANDS}")
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
        raise InputError(f"coefficients have shape {sky.shape}; expected (bands**2, 3)")
    if read.ndim == 0 or read.shape[-1] != 3:
        raise InputError(f"{name} have shape {read.shape}; expected (..., 3)")
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


def fit(
    out: Place,
    *,
    method: str = "fine",
    bands: int = 7,
    turbidity: tuple[float, float] = (2.5, 6.0),
    model: Literal["preetham", "hosek-wilkie"] = "preetham",
    albedo: float = 0.2,
    progress: bool = False,
    **options: Option,
) -> Result:
    """Polynomials of a sky's harmonics over sun and turbidity; what ``mesophyll fit sky`` does.

    Parameters
    ----------
    out : path
        Folder to write: coefficients.json and fit.toml.
    method : str
        ``"fine"``, ``"compact"``, or a fit of the sky as a black box: ``"chebyshev"``, ``"monomials-qr"``, ...
    bands : int
        Bands N: degrees l < N.
    turbidity : (float, float)
        Turbidities to cover.
    model : {"preetham", "hosek-wilkie"}
        The sky; hosek-wilkie is fitted by ``method="chebyshev"``.
    albedo : float
        Ground albedo of hosek-wilkie, 0 to 1.
    progress : bool
        Lines of progress on standard error.
    **options
        Any other option of ``mesophyll fit sky``, with underscores.

    Returns
    -------
    Result
        ``record`` has the errors of the fit.
    """
    options |= {"method": method, "bands": bands, "turbidity": turbidity, "model": model, "albedo": albedo}
    return made(["fit", "sky"], out, options, progress)


def fit_panorama(
    picture: Place,
    out: Place,
    *,
    projection: Literal["equirectangular", "fisheye"] = "equirectangular",
    field_deg: float = 180.0,
    channels: tuple[str, ...] = ("R", "G", "B"),
    noise: float | None = None,
    progress: bool = False,
    **options: Option,
) -> Result:
    """Sun and turbidity from a picture of the sky; what ``mesophyll fit sky --panorama`` does.

    Parameters
    ----------
    picture : path
        OpenEXR or Radiance, linear and proportional to radiance.
    out : path
        Folder to write.
    projection : {"equirectangular", "fisheye"}
        How pixels map to directions.
    field_deg : float
        Of a fisheye: the whole angle across the circle, degrees.
    channels : tuple of str
        Three channels (red, green, blue) or one (luminance).
    noise : float, optional
        Relative standard error of a reading; from how neighbours scatter where it is left out.
    progress : bool
        Lines of progress on standard error.
    **options
        Any other option of ``mesophyll fit sky``, with underscores: ``mask``, ``saturation``.

    Returns
    -------
    Result
        The sun's zenith angle and azimuth, the turbidity and the reading of one kcd/m^2, each with ``_err``; units are
        in ``result.params``.
    """
    options |= {"panorama": picture, "projection": projection, "channels": channels, "noise": noise}
    return made(["fit", "sky"], out, options | {"field_deg": field_deg}, progress)


def panorama(out: Place, sun_zenith_deg: float, turbidity: float, **options: Option) -> Maps:
    """A picture of a sky whose sun and turbidity are known; what ``mesophyll eval panorama`` does.

    Parameters
    ----------
    out : path
        The OpenEXR file to write.
    sun_zenith_deg : float
        Angle of the sun from the zenith, degrees, 0 to 90.
    turbidity : float
        Turbidity.
    **options
        Any other option of ``mesophyll eval panorama``, with underscores: ``sun_azimuth_deg`` (degrees),
        ``projection``, ``size="256x128"``, ``noise``, ``disk=True``, ...

    Returns
    -------
    dict of ndarray
        ``R``, ``G`` and ``B``, shape (height, width), kcd/m^2 in linear sRGB.
    """
    options |= {"sun_zenith_deg": sun_zenith_deg, "turbidity": turbidity, "out": out}
    _command.printed(["eval", "panorama"], options, False)
    return read_exr(Path(out))


def sun(
    latitude_deg: ArrayLike,
    hour: ArrayLike,
    *,
    declination_deg: ArrayLike | None = None,
    day_of_year: ArrayLike | None = None,
) -> Result:
    """Where the sun stands by hour, latitude and season; what ``mesophyll eval sun`` does.

    Parameters
    ----------
    latitude_deg : array_like
        Latitude, degrees, positive to the north.
    hour : array_like
        Solar time, 0 to 24; at 12 the sun stands highest.
    declination_deg : array_like, optional
        Declination of the sun, degrees.
    day_of_year : array_like, optional
        In its place the day, 1 to 366.

    Returns
    -------
    Result
        ``sun_zenith_deg`` and ``sun_azimuth_deg`` (0 is +x, the east, and 90 is +y, the north), and ``status``;
        beyond a zenith angle of 90 the sun is below the horizon.
    """
    given = {"latitude_deg": latitude_deg, "hour": hour}
    given |= {"declination_deg": declination_deg, "day_of_year": day_of_year}
    rows = {name: value for name, value in given.items() if value is not None}
    return _command.table(["eval", "sun"], rows)
