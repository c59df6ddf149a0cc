"""Gloss of a leaf's surface.

A texel reflects diffusely with ``rho_d`` and in a lobe of strength ``rho_s`` and slope ``m`` around its normal, which
leans by ``tilt`` (radians) in the plane x-z. Lobes: ``beckmann`` (Wang et al. 2005, Eq. 7), ``ggx`` with longer tails,
``cook-torrance`` and ``ggx-fresnel``: the same with Fresnel reflection of an index and masking.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _command, _native
from ._command import Option
from ._errors import Error, InputError, renamed
from ._result import Floats, Result, broadcast, floats, shaped, statuses

__all__ = ["evaluate", "fit", "fit_samples", "frames"]

Device = Mapping[str, Any] | str | PathLike[str]
Lobe = Literal["beckmann", "ggx", "cook-torrance", "ggx-fresnel"]


def _told(device: Device) -> tuple[str, str]:
    """The text of a device's file, and the name that stands for it in messages."""
    if isinstance(device, Mapping):
        lines = []
        for name, value in device.items():
            plain = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
            told = json.dumps(plain, ensure_ascii=False).replace("NaN", "nan").replace("Infinity", "inf")
            lines.append(f"{json.dumps(str(name), ensure_ascii=False)} = {told}")
        return "\n".join(lines), "<device>"
    path = fspath(device)
    return Path(path).read_text(encoding="utf-8"), str(path)


def frames(device: Device) -> Floats:
    """Positions of the light in every frame of a device.

    Parameters
    ----------
    device : dict or path
        The device, as in :func:`fit`.

    Returns
    -------
    ndarray, shape (frames,)
        u: distance along the light's travel over its height.
    """
    return np.array(_native.gloss_frames(*_told(device)))


def evaluate(
    rho_d: ArrayLike,
    rho_s: ArrayLike,
    m: ArrayLike,
    tilt: ArrayLike = 0.0,
    tilt_y: ArrayLike = 0.0,
    *,
    device: Device,
    lobe: Lobe = "beckmann",
    index: float = 1.45,
    quadrature: int = 16,
    noise: float | None = None,
    seed: int = 1,
) -> Result:
    """The trace that a texel shows to a tube that travels over it; what ``mesophyll eval gloss`` does.

    Parameters
    ----------
    rho_d, rho_s : array_like, shape (n,) or ()
        Diffuse and glossy reflectance, shares of the light.
    m : array_like
        Slope of the lobe.
    tilt, tilt_y : array_like
        How far the normal leans in the planes x-z and y-z, radians.
    device, lobe, index
        As in :func:`fit`.
    quadrature : int
        Gauss-Legendre nodes on half the tube, 2 to 256.
    noise : float, optional
        Relative standard deviation of noise to add, besides the device's ``noise_floor``.
    seed : int
        Seed of the noise.

    Returns
    -------
    Result
        ``traces`` of shape (n, frames) or (frames,), as :func:`fit` takes them, and ``status``.
    """
    rows = {"rho_d": rho_d, "rho_s": rho_s, "m": m, "tilt": tilt, "tilt_y": tilt_y}
    if noise is not None:
        # Rows with the same parameters would get the same noise.
        columns, _ = broadcast(**rows)
        rows["seed"] = np.arange(columns[0].size) if np.ndim(rho_d) or columns[0].size > 1 else 0
    options: dict[str, Option] = {"lobe": lobe, "index": index, "quadrature": quadrature, "noise": noise, "seed": seed}
    with tempfile.TemporaryDirectory(prefix="mesophyll-") as work:
        text, name = _told(device)
        place = Path(work) / "device.toml"
        place.write_text(text, encoding="utf-8")
        try:
            found = _command.table(["eval", "gloss", f"--geometry={place}"], rows, options)
        except Error as e:
            raise renamed(e, {str(place): name}) from None
    status = found["status"]
    frames_of = [np.asarray(value) for key, value in found.items() if re.fullmatch(r"r\d+", key)]
    return Result({"traces": np.stack(frames_of, axis=-1), "status": status}, notes=found.notes)


def fit(
    traces: ArrayLike,
    device: Device,
    *,
    lobe: Lobe = "beckmann",
    index: float = 1.45,
    quadrature: int = 8,
    robust: Literal["auto", "off", "on"] = "auto",
) -> Result:
    """Reflectance, gloss and tilt of texels from the light of a tube that travels over them; ``mesophyll fit gloss``.

    Parameters
    ----------
    traces : array_like, shape (..., frames) or (..., frames, 3)
        Readings of every frame, grey or red, green and blue. 1 is a white texel under an endless tube straight above.
        NaN is no reading.
    device : dict or path
        The device, or the path of a TOML file that describes it: ``height_mm``, ``tube_length_mm``,
        ``tube_radius_mm`` (0 for a thin tube), ``camera_deg``, the positions of the frames as ``u`` or as ``u_start``,
        ``u_end`` and ``frames``, ``noise_relative`` and ``noise_floor``.
    lobe : {"beckmann", "ggx", "cook-torrance", "ggx-fresnel"}
        Form of the gloss.
    index : float
        Refractive index of the surface, with ``lobe="cook-torrance"`` or ``"ggx-fresnel"``.
    quadrature : int
        Gauss-Legendre nodes on half the tube, 2 to 256.
    robust : {"auto", "off", "on"}
        Whether outliers among the readings are looked for.

    Returns
    -------
    Result
        ``rho_d``, ``rho_s``, ``m``, ``tilt``, each with ``_err``, ``chi2`` and ``status``, of shape ``...``; for
        colour, ``rho_d`` and ``rho_s`` have shape ``(..., 3)``.

    Raises
    ------
    Error
        For a shape or a device that makes no sense, and for a file that cannot be read.
    """
    told = _told(device)
    count = len(_native.gloss_frames(*told))
    read = floats(traces, "traces")
    if read.ndim >= 2 and read.shape[-2:] == (count, 3):
        channels, shape, rows = 3, read.shape[:-2], np.ascontiguousarray(np.swapaxes(read, -1, -2))
    elif read.ndim >= 1 and read.shape[-1] == count:
        channels, shape, rows = 1, read.shape[:-1], read
    else:
        raise InputError(
            f"traces have shape {read.shape}; expected (..., {count}) or (..., {count}, 3) for this device"
        )
    names = 17 if channels == 3 else 9
    out = np.empty((int(np.prod(shape)), names))
    cells, troubles = _native.gloss_fit(rows, channels, told, (lobe, index), quadrature, robust, out)
    found = Result({name: shaped(out[:, k], shape) for k, name in enumerate(cells)})
    if channels == 3:
        for name in ("rho_d", "rho_s"):
            for error in ("", "_err"):
                found[name + error] = np.stack([found.pop(f"{name}_{c}{error}") for c in "rgb"], axis=-1)
    found["status"] = statuses(troubles, shape)
    return found


def fit_samples(
    source_zenith_deg: ArrayLike,
    view_zenith_deg: ArrayLike,
    view_azimuth_deg: ArrayLike,
    values: ArrayLike,
    *,
    names: Sequence[str] | None = None,
    lobe: Lobe = "beckmann",
    index: float = 1.45,
) -> Result:
    """Reflectance, gloss and normal of one leaf from a goniometer; what ``mesophyll fit gloss --samples`` does.

    Parameters
    ----------
    source_zenith_deg, view_zenith_deg, view_azimuth_deg : array_like, shape (n,) or ()
        Directions in degrees. The source stands at azimuth 0; 180 is the mirror side.
    values : array_like, shape (n,) or (n, bands)
        Reflectance factors (pi times the BRDF). NaN is no reading.
    names : sequence of str, optional
        Names of the bands, as the status writes them; 0, 1, ... where they are not given.
    lobe, index
        As in :func:`fit`.

    Returns
    -------
    Result
        ``rho_d`` and ``rho_d_err`` of shape (bands,) or (), grey ``rho_s``, shared ``m``, ``tilt`` and ``tilt_y``
        (radians), ``rms``, each with ``_err`` but the last, and ``status``. Errors come from the scatter of the
        residuals. Where the lobe does not describe the leaf, or another one describes it far better, the status says
        so.
    """
    read = floats(values, "values")
    if read.ndim not in (1, 2):
        raise InputError(f"values have shape {read.shape}; expected (n,) or (n, bands)")
    columns = read.reshape(read.shape[0], -1)
    named = [str(k) for k in range(columns.shape[1])] if names is None else [str(n) for n in names]
    if len(named) != columns.shape[1] or len(set(named)) != len(named):
        raise InputError(f"{len(named)} names for {columns.shape[1]} bands; expected one each, no two the same")
    angles, shape = broadcast(
        source_zenith_deg=source_zenith_deg,
        view_zenith_deg=view_zenith_deg,
        view_azimuth_deg=view_azimuth_deg,
        values=columns[:, 0] if columns.shape[1] else [],
    )
    if shape != (read.shape[0],):
        raise InputError(f"the directions have shape {shape}; expected ({read.shape[0]},) as the values")
    rows = np.ascontiguousarray(np.column_stack([*angles[:3], columns]))
    cells, found, status = _native.gloss_fit_samples(rows, named, (lobe, index))
    values_of = dict(zip(cells, found or [np.nan] * len(cells), strict=True))
    result = Result()
    for error in ("", "_err"):
        albedo = np.array([values_of.pop(f"rho_d_{name}{error}") for name in named])
        result[f"rho_d{error}"] = albedo if read.ndim == 2 else float(albedo[0])
    result.update(values_of)
    result["status"] = status
    return result
