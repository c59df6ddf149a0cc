"""Measured spectra as the bands that scenes and pictures use."""

from __future__ import annotations

from . import _command
from ._command import Place, Table
from ._result import Result

__all__ = ["bands"]


def bands(
    spectra: Table,
    *,
    response: Place = "srgb",
    noise: float | None = None,
    percent: bool = False,
) -> Result:
    """What the bands of a published response or of a sensor see of spectra; what ``mesophyll eval bands`` does.

    Parameters
    ----------
    spectra : dict of array_like, data frame or path
        A row a wavelength: ``leaf``, ``wavelength_nm`` (nm), ``R``, ``T``; or a row a leaf: ``R400``, ``T400``, ...
        With ``_err`` their standard errors.
    response : {"srgb", "cie-1931"}, boxes or path
        Linear sRGB, or X, Y and Z of the CIE 1931 observer; the light is D65. ``"490:65,560:35"`` are boxes by centre
        and width (nm); a table has ``wavelength_nm`` and a column with the response of each band.
    noise : float, optional
        Absolute standard error of R and T, where the table has none; 0 for exact values.
    percent : bool
        R and T are in per cent; ``noise`` stays a share of 1.

    Returns
    -------
    Result
        ``r_r``, ``r_g``, ``r_b`` of R and ``t_r``, ``t_g``, ``t_b`` of T, each with ``_err``, and ``status``, an
        element a leaf. A perfect white is 1, 1, 1. Bands of a sensor have their own names, such as ``r_490``.
    """
    options: dict[str, _command.Option] = {"response": response, "noise": noise, "percent": percent}
    return _command.table(["eval", "bands"], spectra, options)
