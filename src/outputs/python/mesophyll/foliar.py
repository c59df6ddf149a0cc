"""A leaf of layers, and a leaf as a stack of plates: what they reflect and let through, and their pigments.

Two models. The layered leaf (Baranoski & Rokne 2001) has cuticle, epidermis and mesophyll, and absorbs what a table of
specific absorptions says. The stack of plates takes its coefficients from your own leaves with measured contents
(:func:`coefficients`); :func:`fit` takes either. Reflectance and transmittance are shares of the light, contents are
per leaf area: ug/cm^2 for pigments, g/cm^2 for water and dry matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from os import fspath
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _command, _native
from ._command import Option, Place, Table
from ._errors import InputError
from ._result import Result, broadcast, collect

__all__ = ["abm", "coefficients", "evaluate", "fit", "fsm"]


def evaluate(
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
        raise InputError(f"method: found {method!r}, expected one of monte-carlo, exact")
    if method == "monte-carlo" and not 1 <= rays <= 1_000_000_000_000:
        raise InputError(f"rays is {rays}; expected 1 to 1000000000000")
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


def abm(
    leaves: Table,
    *,
    pigments: Table | None = None,
    method: Literal["monte-carlo", "exact"] = "monte-carlo",
    rays: int | None = None,
    seed: int = 1,
    goniometer: bool = False,
    table: bool = False,
) -> Result:
    """The layered leaf on a table; what ``mesophyll eval abm`` does.

    Parameters
    ----------
    leaves : dict of array_like, data frame or path
        ``incidence_deg`` (degrees), ``side`` (adaxial or abaxial), ``absorption_per_mm`` (1/mm),
        ``mesophyll_thickness_mm`` (mm), ``n_cuticle``, ``n_mesophyll``, ``n_antidermal``. With ``pigments``, instead of
        the absorption: ``wavelength_nm`` (nm), ``chlorophyll_ug_cm2``, ``carotenoid_ug_cm2``, ``protein_ug_cm2``,
        ``cellulose_lignin_ug_cm2`` (ug/cm^2) and ``water_g_cm2`` (g/cm^2); indices may then be left out.
    pigments : dict of array_like, data frame or path, optional
        Specific absorptions and refractive indices by wavelength, with the columns that ``fit`` takes.
    method : {"monte-carlo", "exact"}
        Random rays, or the equation that their mean obeys (2e-5, no noise).
    rays, seed : int
        Rays a row (10^6, with ``goniometer`` 10^7), and the seed of their random numbers.
    goniometer : bool
        Instead: in which directions light leaves, 800 rows a case.
    table : bool
        Instead: the shares that the foliar scattering model looks up, 181 rows a case.

    Returns
    -------
    Result
        ``reflectance``, ``transmittance``, ``absorptance``, ``surface_reflectance``, ``reflectance_err``,
        ``transmittance_err`` and ``status``, beside the columns of the table.
    """
    options: dict[str, Option] = {"method": method, "rays": rays, "seed": seed, "goniometer": goniometer}
    with _command.as_file(pigments, "pigments") as place:
        return _command.table(["eval", "abm"], leaves, options | {"table": table, "pigments": place})


def fsm(rows: Table) -> Result:
    """Parts of the foliar scattering model, one a row; what ``mesophyll eval fsm`` does.

    Parameters
    ----------
    rows : dict of array_like, data frame or path
        ``kind`` (angles, surface_pdf, luminance, direct, theta, rms or patch) and the columns that it needs: angles in
        degrees, shares of the light from 0 to 1.

    Returns
    -------
    Result
        ``alpha_e_deg``, ``beta_e_deg``, ``alpha_m_deg``, ``beta_m_deg`` (degrees), ``value``, ``acceptance``, ``cut``
        and ``status``.
    """
    return _command.table(["eval", "fsm"], rows)


def coefficients(spectra: Table, out: Place, *, percent: bool = False, progress: bool = False) -> Result:
    """Learns what leaves absorb from spectra with measured contents; what ``mesophyll fit coefficients`` does.

    Parameters
    ----------
    spectra : dict of array_like, data frame or path
        A row a leaf: ``species``, ``R400``, ``T400``, ``R405``, ... at 26 or more wavelengths (nm), and
        ``measured_chlorophyll_ug_cm2``, ``measured_carotenoid_ug_cm2`` (ug/cm^2), ``measured_water_g_cm2``,
        ``measured_dry_g_cm2`` (g/cm^2), NaN where unknown. Five species and ten leaves of each content are the least.
    out : path
        The CSV to write, which :func:`fit` takes as ``pigments``.
    percent : bool
        R and T are in per cent.
    progress : bool
        Lines of progress on standard error.

    Returns
    -------
    Result
        An array over the wavelengths for each constant: ``chlorophyll_cm2_g``, ``carotenoid_cm2_g``, ``dry_cm2_g``
        (cm^2/g), ``water_per_cm`` (1/cm), ``brown``, ``n``, ``growth``, each with ``_err``. ``notes`` say how well
        leaves of unseen species were described, what the leaves do not carry, and which are suspect.
    """
    with _command.as_file(spectra, "table") as place:
        options: dict[str, Option] = {"in": place, "out": out, "percent": percent}
        _, record, notes = _command.printed(["fit", "coefficients"], options, progress)
        if place is not spectra:
            notes = [note.replace(fspath(place or ""), "<table>") for note in notes]
    columns = _command.read_table(out)
    setting = columns.pop("setting")
    values = columns.pop("value")
    record = {str(name): str(value) for name, value in zip(setting, values, strict=True) if name} | (record or {})
    columns["status"] = "ok"
    return Result(columns, given=["wavelength_nm"], notes=notes, record=record, folder=Path(out).parent)


def fit(
    spectra: Table,
    pigments: Table,
    *,
    noise: float | None = None,
    fit: Sequence[str] | None = None,
    path: Literal["sieve", "slant"] | None = None,
    incidence_deg: float | None = None,
    percent: bool = False,
    progress: bool = False,
    **options: Option,
) -> Result:
    """Pigments of leaves from the light that they reflect and let through; what ``mesophyll fit foliar`` does.

    Parameters
    ----------
    spectra : dict of array_like, data frame or path
        A row a leaf: ``R450``, ``T450``, ... by wavelength in nm, or a row a wavelength: ``leaf``, ``wavelength_nm``,
        ``R``, ``T``. With ``_err`` their standard errors. NaN is no reading.
    pigments : dict of array_like, data frame or path
        ``wavelength_nm`` (nm), ``chlorophyll_cm2_g``, ``carotenoid_cm2_g``, ``protein_cm2_g``,
        ``cellulose_lignin_cm2_g`` (cm^2/g), ``water_per_cm`` (1/cm), ``n_cuticle``, ``n_mesophyll``, ``n_antidermal``:
        the layered leaf is fitted. Or the file that :func:`coefficients` wrote: the stack of plates is.
    noise : float, optional
        Absolute standard error of R and T, where the table has none; 0 for exact values. Without it errors are NaN.
    fit : sequence of str, optional
        What is fitted of the layered leaf: chlorophyll, carotenoid, protein, cellulose-lignin, water, oblateness.
        The first two and the last where it is left out.
    path : {"sieve", "slant"}, optional
        How long a crossing of the layered leaf's mesophyll is; ``"sieve"`` where it is left out.
    incidence_deg : float, optional
        Angle of the light from the normal of the layered leaf, degrees; 8 where it is left out.
    percent : bool
        R and T are in per cent; ``noise`` stays a share of 1.
    progress : bool
        Lines of progress on standard error.
    **options
        Any other option of ``mesophyll fit foliar``, with underscores: ``plots="folder"``.

    Returns
    -------
    Result
        ``chlorophyll_ug_cm2``, ``carotenoid_ug_cm2`` (ug/cm^2), with the stack of plates also ``water_g_cm2`` and
        ``dry_g_cm2`` (g/cm^2), with the layered leaf ``oblateness_epidermis``, each with ``_err``, ``rms`` and
        ``status``, an element a leaf.

    Raises
    ------
    Error
        For tables that do not say what they should. Bad leaves are refused in ``status``.
    """
    options |= {"noise": noise, "fit": fit, "path": path, "incidence_deg": incidence_deg, "percent": percent}
    with _command.as_file(pigments, "pigments") as place:
        return _command.table(["fit", "foliar"], spectra, options | {"pigments": place}, progress=progress)
