"""Designs: which readings to take, before anything is measured or beside what has been.

Every function answers what ``mesophyll design`` answers for one kind of measurement: the chosen readings as columns,
and the standard errors that they would leave beside those of all readings and of as many even ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _command
from ._command import Option, Place, Table
from ._result import Result

__all__ = ["beam", "foliar", "gloss", "leaf", "motion", "scene", "slab"]


def _planned(verb: list[Place], options: dict[str, Option], progress: bool) -> Result:
    """What a verb of ``design`` prints, the chosen readings as columns."""
    _, record, notes = _command.printed(["design", *verb], options, progress)
    entries: dict[str, Any] = {}
    for name in record["columns"]:
        cells = [row[name] for row in record["chosen"]]
        words = any(isinstance(cell, str) and cell for cell in cells)
        # A number that is not stated is an empty word.
        numbers = [np.nan if cell == "" else cell for cell in cells]
        entries[name] = np.array(cells, dtype=object) if words else np.array(numbers, dtype=float)
    left_open = "; ".join(record["undetermined"])
    entries["status"] = f"undetermined: {left_open}" if left_open else "ok"
    return Result(entries, notes=[*notes, *record["notes"]], record=record)


def leaf(leaf: Place, *, progress: bool = False, **options: Option) -> Result:
    """Where the tube of a leaf scan should stand.

    Parameters
    ----------
    leaf : path
        Specification of a leaf, or the folder of a capture.
    progress : bool
        Lines of progress on standard error.
    **options
        Those of ``mesophyll design leaf``: ``frames``, ``next``, ``until``, ``for_`` (names, as a list),
        ``candidates``, ``passes``, ``range`` (``"m=0.1..0.3"``), ``noise``, ``cameras``, ``exposures``, ``lobe``.

    Returns
    -------
    Result
        ``pass`` and ``position_mm`` of each chosen frame. ``record["sets"]`` has the standard errors of each set of
        frames, and how many times larger they are than those of all; ``record["best_possible_over_all"]`` what no
        choice of as many frames can beat. Functions of this module have both alike.
    """
    return _planned(["leaf", leaf], options, progress)


def gloss(table: Table, *, progress: bool = False, **options: Option) -> Result:
    """Which directions a goniometer should read.

    Parameters
    ----------
    table : mapping, data frame or path
        Goniometer samples of leaves like those that will be measured, as for :func:`mesophyll.gloss.fit_samples`.
    progress : bool
        Lines of progress on standard error.
    **options
        Those of ``mesophyll design gloss``: ``directions``, ``for_``, ``values``, ``lobe``, ``percent``.

    Returns
    -------
    Result
        ``view_zenith_deg`` and ``view_azimuth_deg`` of each chosen direction, and ``source_zenith_deg`` where the
        samples have several.
    """
    with _command.as_file(table, "table") as file:
        return _planned(["gloss", f"--in={file}"], options, progress)


def foliar(pigments: Table, *, progress: bool = False, **options: Option) -> Result:
    """Which bands of a spectrometer to read.

    Parameters
    ----------
    pigments : mapping, data frame or path
        Coefficients that :func:`mesophyll.foliar.coefficients` wrote.
    progress : bool
        Lines of progress on standard error.
    **options
        Those of ``mesophyll design foliar``: ``bands``, ``for_``, ``read``, ``range``, ``step``, ``noise``.

    Returns
    -------
    Result
        ``wavelength_nm`` of each chosen band.
    """
    with _command.as_file(pigments, "pigments") as file:
        return _planned(["foliar", f"--pigments={file}"], options, progress)


def slab(table: Table, *, noise: float = 0.005, thickness_noise: float = 0.01) -> Result:
    """Which of reflectance, transmittance and thickness to measure better.

    Parameters
    ----------
    table : mapping, data frame or path
        ``rho_d``, ``rho_t`` and ``h`` (mm), and their standard errors ``rho_d_err``, ``rho_t_err``, ``h_err`` if known.
    noise : float
        Standard error of ``rho_d`` and ``rho_t`` where a row has none of its own.
    thickness_noise : float
        The same for the thickness (mm).

    Returns
    -------
    Result
        Relative errors of absorption and scattering, ``sigma_a_share`` and ``sigma_s_share``, and what they would be
        with half the error of a reading: ``sigma_a_share_if_h_halved``, and so on.
    """
    return _command.table(["design", "slab"], table, {"noise": noise, "thickness_noise": thickness_noise})


def beam(length_mm: float, tip_mm: float, **options: Option) -> Result:
    """Where on a branch to measure.

    Parameters
    ----------
    length_mm : float
        Length of the branch.
    tip_mm : float
        How far the load will move its tip.
    **options
        Those of ``mesophyll design beam``: ``taper`` (``"0.2..0.8"``), ``marks``, ``noise`` (mm), ``load``,
        ``positions``.

    Returns
    -------
    Result
        ``position_mm`` of each mark.
    """
    return _planned(["beam"], {"length_mm": length_mm, "tip_mm": tip_mm, **options}, False)


def motion(**options: Option) -> Result:
    """How long and how often to read a branch in gusts.

    Parameters
    ----------
    **options
        Those of ``mesophyll design motion``: ``length_mm`` or ``resonance_hz``, ``damping_ratio``, ``sway_mm``,
        ``noise`` (mm), ``speed`` (m/s), ``channels``, ``until``.

    Returns
    -------
    Result
        ``rate_hz``, ``seconds`` and ``readings`` of records that know the damping as well as asked.
    """
    return _planned(["motion"], options, False)


def scene(scene: Place, *, progress: bool = False, **options: Option) -> Result:
    """Which cameras and suns further pictures of a scene should have.

    Parameters
    ----------
    scene : path
        A scene with ``[unknown]``, and with the ``[[picture]]`` tables that there are.
    progress : bool
        Lines of progress on standard error.
    **options
        Those of ``mesophyll design scene``: ``more``, ``for_``, ``cameras``, ``suns`` (``["60:200"]``), ``range``,
        ``draws``, ``noise``, ``samples``, ``columns``, ``seed``, ``run``.

    Returns
    -------
    Result
        ``camera``, place, target, upright direction and lens of each chosen picture, and the sun that it is taken
        under, the most useful picture first.
    """
    return _planned(["scene", scene], options, progress)
