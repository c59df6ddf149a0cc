"""Light that comes through a leaf: its dependence on direction, and the tissue that explains it."""

from __future__ import annotations

from typing import Literal

from numpy.typing import ArrayLike

from . import _native
from ._command import Option, Place
from ._result import Result, broadcast, collect
from .fits import made

__all__ = ["dipole", "fit", "tissue"]


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
    Error
        For a tissue that cannot be.
    """
    (d, r), shape = broadcast(thickness=thickness, radius=radius)
    tissue = (float(sigma_a), float(sigma_s), float(g), float(a))
    return collect(["t"], shape, lambda out: _native.dipole(d, r, tissue, dipoles, method, out))


def fit(
    leaf: Place,
    out: Place,
    *,
    levels: int = 8,
    lights: int = 128,
    basis: str = "half-life-2",
    sun_elevation_deg: float | None = None,
    sun_azimuth_deg: float | None = None,
    force: bool = False,
    progress: bool = False,
    **options: Option,
) -> Result:
    """How the light through a leaf depends on its direction; what ``mesophyll fit translucency`` does.

    Parameters
    ----------
    leaf : path
        Folder of a leaf's fit, or a capture under a dome.
    out : path
        Folder to write.
    levels : int
        Thickness levels, 2 to 64.
    lights : int
        Light directions over the hemisphere, 8 to 100000.
    basis : str
        Functions of direction, such as ``"half-life-2"`` and ``"bent-3"``.
    sun_elevation_deg, sun_azimuth_deg : float, optional
        One light over the blade instead of a basis, degrees.
    force : bool
        Compute again although the folder holds this very fit.
    progress : bool
        Lines of progress on standard error.
    **options
        Any other option of ``mesophyll fit translucency``, with underscores: ``sigma_a``, ``sigma_s`` (1/mm), ``g``,
        ``entry``, ``area``, ``form``, ...

    Returns
    -------
    Result
        ``result.maps("front")`` has the maps of the side that is lit, ``result.record`` everything else.
    """
    options |= {"levels": levels, "lights": lights, "sun_elevation_deg": sun_elevation_deg, "force": force}
    options |= {"sun_azimuth_deg": sun_azimuth_deg, "basis": basis if sun_elevation_deg is None else None}
    return made(["fit", "translucency", leaf], out, options, progress)


def tissue(
    beams: Place,
    blade: Place,
    out: Place,
    *,
    fix_scale: bool = False,
    g: float = 0.0,
    levels: int = 8,
    margin_mm: float | None = None,
    force: bool = False,
    progress: bool = False,
    **options: Option,
) -> Result:
    """The tissue from photographs of light that comes through a leaf; what ``mesophyll fit tissue`` does.

    Parameters
    ----------
    beams : path
        Capture of photographs under beams of known direction.
    blade : path
        Folder of the leaf's fit.
    out : path
        Folder to write.
    fix_scale : bool
        Take the thickness as the leaf's fit has it.
    g : float
        Mean cosine of scattering that ``sigma_s`` is stated for.
    levels : int
        Thickness levels, 2 to 64.
    margin_mm : float, optional
        Readings within this distance of a cut border are left out, mm; six mean thicknesses where it is left out.
    force : bool
        Fit again although the folder holds this very fit.
    progress : bool
        Lines of progress on standard error.
    **options
        Any other option of ``mesophyll fit tissue``, with underscores: ``entry``, ``totals``, ``incidence``, ``start``.

    Returns
    -------
    Result
        ``sigma_a``, ``sigma_s`` (1/mm) and a factor on the thickness, each with ``_err``.
    """
    options |= {"fix_scale": fix_scale, "g": g, "levels": levels, "margin_mm": margin_mm, "force": force}
    return made(["fit", "tissue", beams, "--blade", blade], out, options, progress)
