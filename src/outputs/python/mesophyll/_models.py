"""Models of one function."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._result import Result, broadcast, collect, shaped, strict


def beam(alpha: ArrayLike, x: ArrayLike) -> tuple[Any, Any]:
    """Deflection and slope of an evenly loaded, clamped, tapered branch of unit length, to 12 digits.

    Parameters
    ----------
    alpha : array_like
        Tip radius over root radius, more than 0 and at most 1.
    x : array_like
        Place, 0 at the root to 1 at the tip.

    Returns
    -------
    u, du : ndarray or float
        Deflection and slope for F/(E' r1^4) = 1, of the shape that the arguments broadcast to.

    Raises
    ------
    ValueError
        For an element outside these ranges.
    """
    (a, place), shape = broadcast(alpha=alpha, x=x)
    out = np.empty((a.size, 2))
    strict(_native.beam(a, place, out), shape)
    return shaped(out[:, 0], shape), shaped(out[:, 1], shape)


def dipole(
    thickness: ArrayLike,
    radius: ArrayLike,
    sigma_a: float = 0.4,
    sigma_s: float = 10.2,
    g: float = 0.07,
    *,
    a: float = 1.0,
    dipoles: int = 3,
    method: Literal["dipoles", "images", "thin"] = "dipoles",
) -> Result:
    """How light that enters a leaf at one point leaves on the far side (Donner & Jensen 2005).

    Parameters
    ----------
    thickness, radius : array_like
        Thickness of the leaf and distance from the point of entry, mm.
    sigma_a, sigma_s : float
        Absorption and scattering, 1/mm.
    g : float
        Mean cosine of the scattering angle, between -1 and 1.
    a : float
        Boundary term A = (1 + rho_d)/(1 - rho_d), 1 or more.
    dipoles : int
        The sum runs from -dipoles to dipoles.
    method : {"dipoles", "images", "thin"}
        The sum; its limit for infinitely many dipoles; or the form for blades thinner than a mean free path.

    Returns
    -------
    Result
        ``t``, the exitance of the far side in 1/mm^2 per entering flux, and ``status``, which says where diffusion
        does not hold.

    Raises
    ------
    ValueError
        For a tissue that cannot be.
    """
    (d, r), shape = broadcast(thickness=thickness, radius=radius)
    tissue = (float(sigma_a), float(sigma_s), float(g), float(a))
    return collect(["t"], shape, lambda out: _native.dipole(d, r, tissue, dipoles, method, out))


def abm(
    absorption: ArrayLike,
    thickness: ArrayLike,
    n_cuticle: ArrayLike,
    n_mesophyll: ArrayLike,
    n_antidermal: ArrayLike,
    incidence_deg: ArrayLike = 8.0,
    *,
    side: Literal["adaxial", "abaxial"] = "adaxial",
    oblateness: tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike] = (5.0, 5.0, 1.0, 5.0),
    path: Literal["slant", "sieve"] = "slant",
    method: Literal["monte-carlo", "exact"] = "monte-carlo",
    rays: int = 1_000_000,
    seed: int = 1,
) -> Result:
    """Reflectance and transmittance of a leaf of layers (the algorithmic BDF model, Baranoski & Rokne 2001).

    Parameters
    ----------
    absorption : array_like
        Absorption of the mesophyll, 1/mm.
    thickness : array_like
        Thickness of the mesophyll, mm.
    n_cuticle, n_mesophyll, n_antidermal : array_like
        Refractive indices of the cuticle with the epidermis, of the mesophyll and of the antidermal wall, 1 to 3.
    incidence_deg : array_like
        Angle of the light from the normal, degrees, 0 to below 90.
    side : {"adaxial", "abaxial"}
        The lit side: upper or lower.
    oblateness : four of array_like
        How strongly cuticle, epidermis, palisade and spongy tissue bundle light, 0 or more.
    path : {"slant", "sieve"}
        How long a crossing of the mesophyll is: as geometry has it, or as in the public ABM program.
    method : {"monte-carlo", "exact"}
        Random rays, or the equation that their mean obeys (2e-5, no noise).
    rays, seed : int
        Rays an element, and the seed of their random numbers.

    Returns
    -------
    Result
        ``reflectance``, ``transmittance``, ``absorptance``, ``surface_reflectance``, ``reflectance_err``,
        ``transmittance_err`` and ``status``.
    """
    if method not in ("monte-carlo", "exact"):
        raise ValueError(f"method: found {method!r}, expected one of monte-carlo, exact")
    if method == "monte-carlo" and not 1 <= rays <= 1_000_000_000_000:
        raise ValueError(f"rays is {rays}; expected 1 to 1000000000000")
    cuticle, epidermis, palisade, spongy = oblateness
    columns, shape = broadcast(
        absorption=absorption,
        thickness=thickness,
        n_cuticle=n_cuticle,
        n_mesophyll=n_mesophyll,
        n_antidermal=n_antidermal,
        oblateness_cuticle=cuticle,
        oblateness_epidermis=epidermis,
        oblateness_palisade=palisade,
        oblateness_spongy=spongy,
        incidence_deg=incidence_deg,
    )
    leaves = np.stack(columns, axis=-1)
    names = [
        "reflectance",
        "transmittance",
        "absorptance",
        "surface_reflectance",
        "reflectance_err",
        "transmittance_err",
    ]
    count = 0 if method == "exact" else rays
    return collect(names, shape, lambda out: _native.abm(leaves, side, path, count, seed, out))
