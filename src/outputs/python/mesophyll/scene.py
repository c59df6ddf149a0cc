"""Scenes: drawn, checked, evaluated as canopies, and found from their pictures.

A scene is a TOML file that states leaves, plants, ground, light and cameras. Radiance is in the scene's units, linear;
angles are in degrees, times in s, lengths in mm.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _command
from ._command import Option, Place
from ._result import Result
from .fits import made

__all__ = ["canopy", "check", "film", "fit", "fluxes", "plan", "render", "run", "sway", "transfer"]

Channel = Literal["R", "G", "B"]


@contextmanager
def _no_display() -> Iterator[None]:
    """Keeps Mesa from asking for a display that is not there, which it says on standard error."""
    name = "XDG_RUNTIME_DIR"
    if os.path.isabs(os.environ.get(name, "")):
        yield
        return
    before = os.environ.get(name)
    os.environ[name] = "/dev/null/no-display"
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


def _judged(verb: list[Place], out: Place | None, options: dict[str, Option], progress: bool) -> Result:
    """The JSON of a verb that draws and judges."""
    with _no_display():
        code, record, notes = _command.printed(verb, options | {"out": out}, progress)
    missed = "missed: a picture or a fit is not what the scene asks for; `record` says which, and by how much"
    status = "ok" if code == 0 else missed
    return Result({"status": status}, notes=notes, record=record, folder=None if out is None else Path(out))


def plan(scene: Place, *, out: Place | None = None) -> Result:
    """What a scene needs, what is left out, and why; what ``mesophyll plan`` does.

    Parameters
    ----------
    scene : path
        The scene.
    out : path, optional
        Folder of an earlier run, whose fits count as done.

    Returns
    -------
    Result
        ``record`` is the plan as dictionaries and lists.
    """
    _, record, notes = _command.printed(["plan", scene], {"out": out}, False)
    return Result({"status": "ok"}, notes=notes, record=record)


def render(
    scene: Place,
    out: Place,
    *,
    run: Place | None = None,
    view: str | None = None,
    size: tuple[int, int] | None = None,
    samples: int | None = None,
    bounces: int | None = None,
    error: float | None = None,
    seed: int = 1,
    tone: str | None = None,
    resume: bool = False,
    progress: bool = False,
) -> Result:
    """Draws a scene with light between its leaves, by a path tracer; what ``mesophyll render`` does.

    Parameters
    ----------
    scene : path
        The scene, or the folder of a leaf's fit, which is drawn from both sides.
    out : path
        Folder for the pictures: for each view VIEW.exr and VIEW.png.
    run : path, optional
        Folder of an earlier run, check or render, whose scans and fits are used; what the scene lacks is made there.
    view : str, optional
        Only this view; all perspective views where it is left out.
    size : (int, int), optional
        Size of the pictures, pixels; what the scene states where it is left out.
    samples, bounces : int, optional
        Paths a pixel (what the scene states, or with ``error`` as many as it takes); most scatterings of a path.
    error : float, optional
        Stop at this median relative error of the pixels.
    tone : str, optional
        How radiance becomes VIEW.png: ``"reinhard"``, ``"film"``, ...
    resume : bool
        Go on with the pictures that the folder holds.
    seed, progress
        As in :func:`canopy`.

    Returns
    -------
    Result
        ``view``, ``median_relative_error``, ``seconds`` and ``done``, an element a view. ``result.maps(view)`` has the
        radiance ``R``, ``G``, ``B`` and its standard errors ``error.R``, ``error.G``, ``error.B``.
    """
    options: dict[str, Option] = {"out": out, "view": view, "samples": samples, "bounces": bounces, "error": error}
    options |= {"run": run, "seed": seed, "tone": tone, "resume": resume}
    options["size"] = None if size is None else f"{size[0]}x{size[1]}"
    _, drawn, notes = _command.printed(["render", scene], options, progress)
    columns: dict[str, Any] = {"view": np.array([d["view"] for d in drawn], dtype=object)}
    for name in ("median_relative_error", "seconds"):
        columns[name] = np.array([np.nan if d.get(name) is None else d[name] for d in drawn], dtype=float)
    columns["done"] = np.array([d["done"] for d in drawn])
    few = "undetermined: it has fewer paths than were asked for"
    columns["status"] = np.array(["ok" if d["done"] else few for d in drawn], dtype=object)
    return Result(columns, notes=notes, record=drawn, folder=Path(out))


def check(
    scene: Place,
    out: Place,
    *,
    update_golden: bool = False,
    goldens_only: bool = False,
    frames: int | None = None,
    size: tuple[int, int] | None = None,
    compare_interiors: bool = False,
    compare_methods: bool = False,
    progress: bool = False,
) -> Result:
    """Draws a scene by the real-time renderer and judges it; what ``mesophyll check`` does.

    It needs an adapter that Vulkan knows, such as Mesa's software adapter.

    Parameters
    ----------
    scene : path
        The scene.
    out : path
        Folder for pictures and check.json; an earlier run's folder counts its fits as done.
    update_golden, goldens_only : bool
        Write the golden pictures anew; only compare with them.
    frames : int, optional
        Only draw every view so many times, and time it.
    size : (int, int), optional
        Size of these frames, pixels.
    compare_interiors, compare_methods : bool
        Weigh the interiors of leaves, and the methods of light between leaves, against each other.
    progress : bool
        Lines of progress on standard error.

    Returns
    -------
    Result
        ``status``: ``"ok"``, or ``"missed: ..."`` where a view is not what the scene asks for. ``record`` holds what
        was measured, as check.json does.

    Raises
    ------
    Error
        Where nothing can be drawn (also a ``RuntimeError``) and for scenes that do not say what they should.
    """
    options: dict[str, Option] = {"update_golden": update_golden, "goldens_only": goldens_only, "frames": frames}
    options |= {"size": None if size is None else f"{size[0]}x{size[1]}", "compare_methods": compare_methods}
    return _judged(["check", scene], out, options | {"compare_interiors": compare_interiors}, progress)


def run(scene: Place, out: Place, *, progress: bool = False, **options: Option) -> Result:
    """Fits what a scene needs, reports, draws and checks it; what ``mesophyll run`` does.

    Parameters
    ----------
    scene : path
        The scene.
    out : path
        Folder for fits, pictures and report.
    progress : bool
        Lines of progress on standard error.
    **options
        Any other option of ``mesophyll run``, with underscores.

    Returns
    -------
    Result
        ``status``: ``"ok"``, or ``"missed: ..."`` where a fit or a view is not what the scene asks for; ``record``.
    """
    return _judged(["run", scene], out, options, progress)


def film(scene: Place, out: Place, *, progress: bool = False, **options: Option) -> Result:
    """Draws a moving scene frame by frame; what ``mesophyll film`` does.

    Parameters
    ----------
    scene : path
        Scene with a wind, or with a leaf that fades.
    out : path
        Folder for the frames, or a video (.mp4).
    progress : bool
        Lines of progress on standard error.
    **options
        Options of ``mesophyll film``, with underscores: ``view``, ``from_``, ``to`` (s), ``fps`` (Hz), ``size``
        (``"640x360"``), ``motion``, ``force``.

    Returns
    -------
    Result
        ``record`` says what was written.
    """
    return _judged(["film", scene], out, options, progress)


def canopy(
    scene: Place,
    view_zenith_deg: ArrayLike,
    view_azimuth_deg: ArrayLike | None = None,
    *,
    channel: Channel | None = None,
    bands: Sequence[float] | Literal["all"] | Place | None = None,
    samples: int = 131_072,
    seed: int = 1,
    run: Place | None = None,
    progress: bool = False,
) -> Result:
    """What a canopy reflects of the sun towards directions; what ``mesophyll eval canopy`` does.

    Parameters
    ----------
    scene : path
        Scene with a [periodic], a [sun] and no [sky].
    view_zenith_deg : array_like, shape (n,) or ()
        Angle of the direction towards the viewer from straight up, degrees, below 89.9.
    view_azimuth_deg : array_like, optional
        Its azimuth from +x towards +y, degrees. Where it is left out or NaN the view lies in the sun's plane, and
        negative zenith angles are on the sun's side.
    channel : {"R", "G", "B"}, optional
        Which of the scene's channels; green where it is left out.
    bands : sequence of float, "all" or path, optional
        Instead of a channel: wavelengths, nm, of leaves and a ground that have spectra; all that they have in common;
        or a table with the column ``wavelength_nm``.
    samples : int
        Paths a direction, 32 to 2^30.
    seed : int
        Seed of the random numbers.
    run : path, optional
        Folder of an earlier run, whose fits of the scene's leaves are used.
    progress : bool
        Lines of progress on standard error.

    Returns
    -------
    Result
        ``brf``, the bidirectional reflectance factor, ``brf_err`` and ``status``, an element a direction. With
        ``bands`` also ``wavelength_nm`` (nm), and ``brf`` has its axis last.
    """
    rows = {"view_zenith_deg": view_zenith_deg}
    if view_azimuth_deg is not None:
        rows["view_azimuth_deg"] = view_azimuth_deg
    options: dict[str, Option] = {"channel": channel, "bands": bands, "samples": samples, "seed": seed, "run": run}
    found = _command.table(["eval", "canopy", scene], rows, options, flag="directions", progress=progress)
    return found if bands is None else _over_wavelengths(found)


def _over_wavelengths(found: Result) -> Result:
    """The columns ``brf_450``, ``brf_450_err``, ... as arrays whose last axis is the wavelength."""
    names = [name for name in found if re.fullmatch(r"brf_[0-9.]+", name)]
    angles = {name: found[name] for name in ("view_zenith_deg", "view_azimuth_deg") if name in found}
    factors = {"wavelength_nm": np.array([float(name.removeprefix("brf_")) for name in names])}
    for error in ("", "_err"):
        factors[f"brf{error}"] = np.stack([np.asarray(found[name + error]) for name in names], axis=-1)
    return Result(angles | factors | {"status": found["status"]}, given=[*angles, "wavelength_nm"], notes=found.notes)


def fluxes(
    scene: Place,
    *,
    channel: Channel | None = None,
    bands: Sequence[float] | Literal["all"] | Place | None = None,
    samples: int = 131_072,
    seed: int = 1,
    run: Place | None = None,
    progress: bool = False,
) -> Result:
    """Where the sun's light on a canopy goes; what ``mesophyll eval canopy --fluxes`` does.

    Parameters
    ----------
    scene, channel, bands, seed, run, progress
        As in :func:`canopy`.
    samples : int
        Paths in all, 32 to 2^30.

    Returns
    -------
    Result
        ``reflected``, ``absorbed`` (by everything but the ground) and ``transmitted`` (to the ground), shares of the
        sun's light, each with ``_err``. With ``bands`` also ``wavelength_nm`` (nm), and an element a wavelength.
    """
    options: dict[str, Option] = {"channel": channel, "bands": bands, "samples": samples, "seed": seed, "run": run}
    _, found, notes = _command.printed(["eval", "canopy", scene], options | {"fluxes": True}, progress)
    if bands is None:
        return Result({**found, "status": "ok"}, notes=notes, record=found)
    columns: dict[str, Any] = {name: np.array([row[name] for row in found], dtype=float) for name in found[0]}
    columns["status"] = np.full(len(found), "ok", dtype=object)
    return Result(columns, given=["wavelength_nm"], notes=notes, record=found)


def sway(scene: Place, to: float, *, from_: float = 0.0, step: float = 0.05) -> Result:
    """Where the tips of the branches of a scene's plants are over time; what ``mesophyll eval sway`` does.

    Parameters
    ----------
    scene : path
        Scene with plants.
    to, from_, step : float
        Last and first time, and the step between two, s.

    Returns
    -------
    Result
        ``time_s`` (s), ``plant``, ``branch``, ``tip_x_mm``, ``tip_y_mm``, ``tip_z_mm`` (mm), an element a branch and
        time.
    """
    found = _command.table(["eval", "sway", scene], None, {"from": from_, "to": to, "step": step})
    found["status"] = "ok"
    return found


def fit(
    scene: Place,
    out: Place,
    *,
    run: Place | None = None,
    samples: int = 1024,
    seed: int = 1,
    force: bool = False,
    progress: bool = False,
) -> Result:
    """Finds leaves, ground and light of a scene from linear pictures of it; what ``mesophyll fit scene`` does.

    Parameters
    ----------
    scene : path
        Scene with [[picture]] or [[brf]] tables, which say what was measured, and [unknown], which says what is found.
    out : path
        Folder to write: fit.toml, residual-VIEW.exr, trace.csv, and scene.toml with what was found.
    run, seed, progress
        As in :func:`canopy`.
    samples : int
        Most paths a pixel of a step's pictures, 16 to 65536.
    force : bool
        Fit again although the folder holds this very fit.

    Returns
    -------
    Result
        Each unknown number with ``_err``, or in ``undetermined`` why the pictures do not determine it; ``status`` is
        ``"missed: ..."`` where the pictures are not explained.
    """
    options: dict[str, Option] = {"run": run, "samples": samples, "seed": seed, "force": force}
    return made(["fit", "scene", scene], out, options, progress)


def transfer(
    scene: Place, out: Place, *, run: Place | None = None, force: bool = False, progress: bool = False
) -> Result:
    """How the light that reaches each leaf depends on the light around; what ``mesophyll fit transfer`` does.

    Parameters
    ----------
    scene : path
        Scene with a [transfer], which sets the resolution.
    out : path
        Folder to write.
    run, progress
        As in :func:`canopy`.
    force : bool
        Compute again although the folder holds this very fit.

    Returns
    -------
    Result
        ``record`` has the errors of the light at the leaves.
    """
    return made(["fit", "transfer", scene], out, {"run": run, "force": force}, progress)
