"""Branches: how a tapered one bends and sways, and what measured deflections say of one.

Lengths are in mm, loads in N, moduli in GPa, times in s.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _command, _native
from ._command import Option, Place, Table
from ._result import Result, broadcast, shaped, strict

__all__ = ["coefficients", "evaluate", "fit", "motion"]


def evaluate(alpha: ArrayLike, x: ArrayLike) -> tuple[Any, Any]:
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
    Error
        For an element outside these ranges.
    """
    (a, place), shape = broadcast(alpha=alpha, x=x)
    out = np.empty((a.size, 2))
    strict(_native.beam(a, place, out), shape)
    return shaped(out[:, 0], shape), shaped(out[:, 1], shape)


def coefficients(alpha: ArrayLike, *, samples: int = 101) -> Result:
    """Polynomials of the deflection of tapered branches; what ``mesophyll fit beam`` does.

    Parameters
    ----------
    alpha : array_like, shape (n,) or ()
        Tip radius over root radius, more than 0 and at most 1.
    samples : int
        Even samples from root to tip that are fitted.

    Returns
    -------
    Result
        ``c2``, ``c4`` of u = c2 x^2 + c4 x^4 and ``max_error``; ``a2`` to ``a5`` of u = a2 y^2 + ... + a5 y^5 with
        y = ln(1 + (alpha - 1) x)/ln(alpha), and ``a_max_error``; and ``status``.
    """
    return _command.table(["fit", "beam"], {"alpha": alpha}, {"samples": samples})


def fit(
    deflections: Table,
    *,
    noise: float | None = None,
    load: str | float | None = None,
    positions: Literal["branch", "axis"] = "branch",
    out: Place | None = None,
) -> Result:
    """Taper and stiffness of branches from measured deflections; what ``mesophyll fit beam --deflections`` does.

    Parameters
    ----------
    deflections : dict of array_like, data frame or path
        A row a reading: ``branch``, ``length_mm``, ``position_mm``, ``deflection_mm`` (mm), optionally
        ``deflection_err_mm`` (mm), ``load_n``, ``load_err_n`` (N), ``modulus_gpa``, ``modulus_err_gpa`` (GPa).
    noise : float, optional
        Standard error of a deflection where the table states none, mm; from the scatter where it is left out.
    load : str or float, optional
        How the load hangs on the branch: ``"tip"``, ``"even"``, ``"own-weight"``, or the distance of a single load from
        the root, up to 1 as a share of the length and above 1 in mm.
    positions : {"branch", "axis"}
        What positions were measured along.
    out : path, optional
        Folder to keep the fit in, too.

    Returns
    -------
    Result
        ``alpha``, ``load_over_stiffness_mm``, ``root_radius_mm``, ``tip_mm`` (mm), each with ``_err``, ``correlation``,
        ``chi2``, ``rms_mm``, ``readings`` and ``status``, an element a branch.
    """
    options: dict[str, Option] = {"noise": noise, "load": load, "positions": positions}
    # The folder is told from the file of the rows by its name, which has no ending.
    return _command.table(["fit", "beam"], deflections, options, flag="deflections", folder=out)


def motion(
    record: Table,
    *,
    kind: Literal["auto", "gusts", "free-decay"] = "auto",
    rate: float | None = None,
    speed: float | None = None,
    turbulence: float | None = None,
    noise: float = 0.0,
    lowest: float | None = None,
    highest: float | None = None,
) -> Result:
    """Resonance and damping of a branch from its deflections over time; what ``mesophyll fit motion`` does.

    Parameters
    ----------
    record : dict of array_like, data frame or path
        ``time_s`` (s), ``u_mm`` and optionally ``v_mm``: deflections of the tip in one direction or two, mm. NaN is no
        reading.
    kind : {"auto", "gusts", "free-decay"}
        What the record shows: a branch that gusts push at random, or one that was pulled and let go.
    rate : float, optional
        Readings a second, Hz; from the times where it is left out.
    speed : float, optional
        Mean speed of the wind, m/s; fitted where it is left out.
    turbulence : float, optional
        Standard deviation of the wind's speed over its mean; with ``speed``, the gain is also in mm per m/s.
    noise : float
        Standard error of a reading, mm, besides its rounding.
    lowest, highest : float, optional
        Frequencies that are used, Hz.

    Returns
    -------
    Result
        ``resonance_hz`` (Hz), ``damping_per_s`` (1/s), ``damping_ratio``, ``gain_u_mm_per_sqrt_hz``,
        ``gain_u_mm_per_m_s`` and the same of v, ``wind_s_per_m`` (s/m), each with ``_err``; ``deviance``,
        ``frequencies``, ``kind``, ``taken_out`` and ``status``. Each is one number or word.
    """
    options: dict[str, Option] = {"kind": kind, "rate": rate, "speed": speed, "turbulence": turbulence}
    options |= {"noise": noise, "lowest": lowest, "highest": highest}
    return _command.table(["fit", "motion"], record, options, one=True)
