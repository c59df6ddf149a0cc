"""The leaf's interior as a homogeneous slab (LEAFMOD: Ganapol et al. 1998; Wang et al. 2005, section 3).

R is the diffuse reflectance and T the transmittance for a beam along the normal, both as shares of the light, without
what the surface itself reflects: the slab is taken at the index of its surroundings. (:func:`fit` also takes
one in air whose faces reflect.) Thickness is in mm, absorption ``sigma_a`` and scattering ``sigma_s`` in 1/mm.
Scattering is taken as isotropic, so ``sigma_s`` is the reduced coefficient of tissue that scatters forward.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _command, _native
from ._command import Option, Table
from ._errors import InputError
from ._result import Result, broadcast, collect, strict

__all__ = ["evaluate", "fit", "forward", "invert"]


def forward(sigma_a: ArrayLike, sigma_s: ArrayLike, thickness: ArrayLike) -> tuple[Any, Any]:
    """Reflectance and transmittance of a slab.

    Parameters
    ----------
    sigma_a, sigma_s : array_like
        Absorption and scattering, 1/mm, 0 or more.
    thickness : array_like
        Thickness, mm, 0 or more.

    Returns
    -------
    R, T : ndarray or float
        Shares of the light, 0 to 1, of the shape that the arguments broadcast to. Relative error below 1e-8.

    Raises
    ------
    Error
        For a number that is negative or not finite.

    Examples
    --------
    >>> import mesophyll as mp
    >>> R, T = mp.slab.forward(0.5, 40.0, 0.2)
    """
    (a, s, h), shape = broadcast(sigma_a=sigma_a, sigma_s=sigma_s, thickness=thickness)
    out = np.empty((a.size, 2))
    strict(_native.slab_forward(a, s, h, out), shape)
    if not shape:
        return float(out[0, 0]), float(out[0, 1])
    return np.ascontiguousarray(out[:, 0]).reshape(shape), np.ascontiguousarray(out[:, 1]).reshape(shape)


def invert(
    R: ArrayLike,
    T: ArrayLike,
    thickness: ArrayLike,
    noise: ArrayLike | None = None,
    *,
    T_noise: ArrayLike | None = None,
    surface: float = 0.0,
    method: Literal["fast", "exact"] = "fast",
) -> Result:
    """Absorption and scattering from reflectance, transmittance and thickness; what ``mesophyll fit slab`` does.

    Parameters
    ----------
    R, T : array_like
        Measured reflectance and transmittance, shares of the light. NaN is refused in its place.
    thickness : array_like
        Thickness, mm.
    noise : array_like, optional
        Absolute standard error of R and T; 0 for exact values. Without it nothing is known of the errors: they are
        NaN, and ``ok`` says only that the numbers belong to a slab.
    T_noise : array_like, optional
        Standard error of T, where it differs from that of R.
    surface : float
        Reflectance of the surface itself (gloss), 0 to below 1, which is taken off R. An integrating sphere that keeps
        the mirror reflection reads about 0.03 to 0.05 too much.
    method : {"fast", "exact"}
        fast is better than 1e-6 wherever the parameters are determined, exact has nine digits.

    Returns
    -------
    Result
        ``sigma_a``, ``sigma_s`` (1/mm), their standard errors ``sigma_a_err``, ``sigma_s_err``, and ``status``, all of
        the shape that the arguments broadcast to.

    Raises
    ------
    Error
        For shapes that do not broadcast and for options that make no sense. Bad elements are refused in ``status``.

    Examples
    --------
    >>> import mesophyll as mp
    >>> leaf = mp.slab.invert(0.38, 0.51, 0.15, noise=0.002)
    >>> leaf.status
    'ok'
    """
    if not 0.0 <= surface < 1.0:
        raise InputError(f"surface is {surface}; expected a reflectance of 0 to below 1")
    for name, value in (("noise", noise), ("T_noise", T_noise)):
        if value is not None and not np.all(np.asarray(value, dtype=float) >= 0):
            raise InputError(f"{name}: expected standard errors of 0 or more")
    both = {"noise": noise, "T_noise": noise if T_noise is None else T_noise}
    (r, t, h, r_err, t_err), shape = broadcast(R=R, T=T, thickness=thickness, **both)
    names = ["sigma_a", "sigma_s", "sigma_a_err", "sigma_s_err"]
    return collect(names, shape, lambda out: _native.slab_invert(r, t, h, r_err, t_err, method, surface, out))


def evaluate(
    omega: ArrayLike,
    delta: ArrayLike,
    one_minus_omega: ArrayLike | None = None,
    *,
    method: Literal["fast", "exact", "fn"] = "fast",
    incidence_deg: float = 0.0,
) -> Result:
    """Reflectance and transmittance from albedo and optical thickness; what ``mesophyll eval slab`` does.

    Parameters
    ----------
    omega : array_like
        Single-scattering albedo sigma_s / (sigma_a + sigma_s), 0 to 1.
    delta : array_like
        Optical thickness (sigma_a + sigma_s) times thickness, 0 or more.
    one_minus_omega : array_like, optional
        1 - omega, which carries the digits where omega is close to 1.
    method : {"fast", "exact", "fn"}
        fast: 1e-8; exact: nine digits and more; fn: the F_N method of the paper.
    incidence_deg : float
        Angle of the beam from the normal, 0 to below 90; needs ``method="exact"``.

    Returns
    -------
    Result
        ``rho_d``, ``rho_t`` and ``status``.
    """
    if not 0.0 <= incidence_deg < 90.0:
        raise InputError(f"incidence_deg is {incidence_deg}; expected 0 to below 90")
    if incidence_deg != 0.0 and method != "exact":
        raise InputError("incidence_deg needs method='exact'; the others are made for a normal beam")
    (w, d, rest), shape = broadcast(omega=omega, delta=delta, one_minus_omega=one_minus_omega)
    return collect(["rho_d", "rho_t"], shape, lambda out: _native.slab_evaluate(w, d, rest, method, incidence_deg, out))


def fit(
    spectra: Table,
    *,
    noise: float | None = None,
    method: Literal["fast", "exact"] = "fast",
    surface: float = 0.0,
    index: float = 1.0,
    specular: Literal["included", "excluded"] = "included",
    percent: bool = False,
    any_thickness: bool = False,
    **options: Option,
) -> Result:
    """Absorption and scattering from a table of spectra; what ``mesophyll fit slab`` does.

    Parameters
    ----------
    spectra : dict of array_like, data frame or path
        ``rho_d``, ``rho_t`` and ``h`` (mm) or ``thickness_um`` (um), or a row a wavelength (``leaf``,
        ``wavelength_nm``, ``R``, ``T``), or a row a leaf (``R450``, ``T450``, ...). Optional: ``rho_d_err``,
        ``rho_t_err``, and ``known_sigma_a`` or ``known_sigma_s`` (1/mm), with which one of R and T is enough.
    noise : float, optional
        Absolute standard error of R and T, where the table has none; 0 for exact values. Without it errors are NaN.
    method : {"fast", "exact"}
        fast is better than 1e-6 wherever the parameters are determined, exact has nine digits.
    surface : float
        Reflectance of the surface itself, which is taken off R; not together with ``index``.
    index : float
        Refractive index of the slab, 1 to 3; above 1 its faces reflect.
    specular : {"included", "excluded"}
        With ``index``: whether R has the mirror reflection of the faces.
    percent : bool
        R and T are in per cent; ``noise`` stays a share of 1.
    any_thickness : bool
        Take thicknesses that no leaf has for right.
    **options
        Any other option of ``mesophyll fit slab``, with underscores: ``columns="rho_d=R550,rho_t=T550"``, ``plots``.

    Returns
    -------
    Result
        ``sigma_a``, ``sigma_s`` (1/mm), each with ``_err``, and ``status``, beside the columns of the table.
    """
    options |= {"noise": noise, "method": method, "surface": surface, "index": index, "percent": percent}
    options |= {"specular": specular if index != 1.0 else None, "any_thickness": any_thickness}
    return _command.table(["fit", "slab"], spectra, options)
