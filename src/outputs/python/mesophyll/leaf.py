"""Fits of whole scans: maps of reflectance, gloss, normals, absorption, scattering and thickness."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _command, _native
from ._command import Option, Place
from ._errors import FileError, InputError
from ._result import Result, floats
from .fits import made
from .gloss import Lobe

__all__ = ["Capture", "fit", "inspect", "synth"]


def _finite(name: str, value: Any) -> float:
    """One number that is neither NaN nor infinite."""
    number = floats(value, name)
    if number.size != 1 or not np.isfinite(number).all():
        raise InputError(f"{name} is {value}; expected a finite number")
    return float(number.item())


@dataclass
class Capture:
    """A scan as arrays; :func:`fit` takes it as it takes a folder.

    Frames have shape (frames, height, width, 3): red, green and blue, linear in light. 1 is a white texel straight
    below an endless tube, unless ``white`` is given; NaN is no reading. Texel (row j, column i) lies at
    x = (i + 1/2 - W/2) p, y = (H/2 - j - 1/2) p for texels of p mm.

    Attributes
    ----------
    frames_x : array_like, shape (frames, height, width, 3)
        Frames of the pass along x (the tube parallel to y).
    positions_x : array_like, shape (frames,)
        Position of the tube's axis in each of them, mm.
    texel_mm : float
        Size of a texel on the blade.
    thickness_mm : float
        Mean thickness by caliper; it sets the scale of absorption and scattering.
    camera_deg : float
        Angle between the view and the blade's normal, towards +x.
    tube : dict
        ``height_mm``, ``length_mm`` and ``radius_mm`` of the light.
    lightbox : array_like, shape (height, width, 3)
        The leaf on the light box.
    lightbox_empty : array_like, shape (height, width, 3)
        The light box without the leaf.
    frames_y, positions_y : array_like, optional
        The pass along y, without which only the tilt in the x-z plane is found.
    white_x, white_y : array_like, optional
        A white sheet in the leaf's place, frame by frame, as ``frames_x`` and ``frames_y``.
    dark : array_like, shape (height, width, 3), optional
        A frame without light.
    mask : array_like, shape (height, width), optional
        1 on the leaf, 0 beside it.
    thickness_err_mm, noise_relative, noise_floor : float, optional
        Standard error of the thickness; noise sqrt((relative value)^2 + floor^2) of a reading, estimated when absent.
    name : str
        What to call the leaf.
    """

    frames_x: ArrayLike
    positions_x: ArrayLike
    texel_mm: float
    thickness_mm: float
    camera_deg: float
    tube: Mapping[str, float]
    lightbox: ArrayLike
    lightbox_empty: ArrayLike
    frames_y: ArrayLike | None = None
    positions_y: ArrayLike | None = None
    white_x: ArrayLike | None = None
    white_y: ArrayLike | None = None
    dark: ArrayLike | None = None
    mask: ArrayLike | None = None
    thickness_err_mm: float | None = None
    noise_relative: float | None = None
    noise_floor: float | None = None
    name: str = field(default="leaf")

    def write(self, folder: str | PathLike[str]) -> Path:
        """Writes the capture's folder: ``capture.toml`` and single-precision OpenEXR images.

        Raises ``Error`` for arrays that do not fit together, and where the folder is there already.
        """
        folder = Path(folder)
        first = floats(self.frames_x, "frames_x")
        if first.ndim != 4 or first.shape[-1] != 3:
            raise InputError(f"frames_x has shape {first.shape}; expected (frames, height, width, 3)")
        size = first.shape[1:3]
        passes: dict[str, tuple[ArrayLike, ArrayLike | None, ArrayLike | None]] = {
            "x": (first, self.positions_x, self.white_x)
        }
        if self.frames_y is not None:
            passes["y"] = (self.frames_y, self.positions_y, self.white_y)
        told: dict[str, Any] = {
            "schema": 1,
            "name": self.name,
            "width": size[1],
            "height": size[0],
            "texel_mm": _finite("texel_mm", self.texel_mm),
            "thickness_mm": _finite("thickness_mm", self.thickness_mm),
            "camera_deg": _finite("camera_deg", self.camera_deg),
            "sides": ["front"],
        }
        for name in ("thickness_err_mm", "noise_relative", "noise_floor"):
            if getattr(self, name) is not None:
                told[name] = _finite(name, getattr(self, name))
        text = [f"{name} = {json.dumps(value, ensure_ascii=False)}" for name, value in told.items()]
        text += ["[tube]", *(f"{name} = {_finite(f'tube: {name}', value)!r}" for name, value in self.tube.items())]
        images: list[tuple[str, np.ndarray[Any, Any]]] = []
        for name, (frames, positions, white) in passes.items():
            read = floats(frames, f"frames_{name}")
            places = floats(positions, f"positions_{name}").reshape(-1)
            where = [_finite(f"positions_{name}[{k}]", place) for k, place in enumerate(places)]
            if read.ndim != 4 or read.shape[1:] != (*size, 3) or len(where) != read.shape[0]:
                raise InputError(
                    f"frames_{name} has shape {read.shape} and positions_{name} {len(where)} numbers; expected "
                    f"({len(where)}, {size[0]}, {size[1]}, 3)"
                )
            text += ["[[pass]]", f'name = "{name}"', f"positions_mm = {json.dumps(where)}"]
            images += [(f"front/{name}/{k:04}.exr", frame) for k, frame in enumerate(read)]
            if white is not None:
                sheets = floats(white, f"white_{name}")
                if sheets.ndim != 4 or sheets.shape[0] != len(where) or sheets.shape[-1] != 3:
                    raise InputError(
                        f"white_{name} has shape {sheets.shape}; expected ({len(where)}, height, width, 3)"
                    )
                images += [(f"white/{name}/{k:04}.exr", sheet) for k, sheet in enumerate(sheets)]
        single = [
            ("front/lightbox.exr", "lightbox", self.lightbox),
            ("lightbox_empty.exr", "lightbox_empty", self.lightbox_empty),
            ("dark.exr", "dark", self.dark),
            ("mask.exr", "mask", self.mask),
        ]
        for file, name, image in single:
            if image is None:
                continue
            read = floats(image, name)
            expected = size if name == "mask" else (*size, 3)
            if read.shape != expected:
                raise InputError(f"{name} has shape {read.shape}; expected {expected}")
            images.append((file, read))
        try:
            folder.mkdir(parents=True)
        except OSError as e:
            raise FileError(f"cannot write {folder}: {e.strerror}") from None
        for file, image in images:
            path = folder / file
            path.parent.mkdir(parents=True, exist_ok=True)
            height, width = image.shape[:2]
            letters = "RGB" if image.ndim == 3 else "Y"
            planes = image if image.ndim == 3 else image[:, :, np.newaxis]
            channels = [(letter, np.ascontiguousarray(planes[:, :, c])) for c, letter in enumerate(letters)]
            _native.write_exr(fspath(path), width, height, channels)
        # The manifest last: a folder without it is no capture.
        (folder / "capture.toml").write_text("\n".join(text) + "\n", encoding="utf-8")
        return folder


def fit(
    capture: Capture | str | PathLike[str],
    out: str | PathLike[str],
    *,
    method: Literal["exact", "paper"] = "exact",
    lobe: Lobe = "beckmann",
    index: float = 1.45,
    robust: bool = True,
    hold_out: int = 20,
    hold_out_seed: int = 1,
    gloss: Sequence[float] | None = None,
    force: bool = False,
    progress: bool = False,
) -> Result:
    """Fits a scan under a tube, a capture under a dome, or photographs; what ``mesophyll fit leaf`` does.

    Parameters
    ----------
    capture : path or Capture
        Folder with ``capture.toml``, or the scan as arrays.
    out : path
        Folder that the fit is written to. A fit that was stopped goes on there.
    method : {"exact", "paper"}
        One joint problem for the leaf's interior, or the reduction that Wang et al. 2005 print.
    lobe, index
        Form of the gloss, as in :func:`mesophyll.gloss.fit`.
    robust : bool
        Weigh outliers down.
    hold_out, hold_out_seed : int
        One frame of every so many is left out of the fit, to judge it by; 0 leaves none out. The seed draws them.
    gloss : (index, slope), optional
        Captures under a dome only: what a dome does not show of the gloss.
    force : bool
        Fit again although the folder holds this very fit.
    progress : bool
        Lines of progress on standard error.

    Returns
    -------
    Result
        ``fit.front.sigma_a``, ``fit.front.sigma_a_err`` (1/mm) and others, a number a channel; ``fit.maps("front")``
        has the maps. ``fit.status`` says how good it is; a fit that is not good stays written.

    Raises
    ------
    Error
        For a capture that does not say what it should (also a ``ValueError``), for files that cannot be read or written
        (an ``OSError``), and for a leaf that as a whole cannot be fitted (a ``RuntimeError``).
    """
    options: dict[str, Option] = {"method": method, "lobe": lobe, "index": index, "gloss": gloss, "force": force}
    # A dome and photographs have no frames to hold out; what is not said is not refused there.
    usual = {"no_robust": (not robust, False), "hold_out": (hold_out, 20), "hold_out_seed": (hold_out_seed, 1)}
    options |= {name: value for name, (value, default) in usual.items() if value != default}
    if not isinstance(capture, Capture):
        return made(["fit", "leaf", capture], out, options, progress)
    with tempfile.TemporaryDirectory(prefix="mesophyll-") as folder:
        return made(["fit", "leaf", capture.write(Path(folder) / "capture")], out, options, progress)


def synth(spec: Place, out: Place, *, progress: bool = False, **options: Option) -> Result:
    """Scans a synthetic leaf whose truth is known; what ``mesophyll synth`` does.

    Parameters
    ----------
    spec : path
        Specification of the leaf, such as ``data/leaves/elm.toml``.
    out : path
        Folder to write the capture to, which :func:`fit` takes.
    progress : bool
        Lines of progress on standard error.
    **options
        Any option of ``mesophyll synth``, with underscores: ``size="240x180"`` (texels), ``frames=60``, ``noise=0.01``,
        ``acquisition="dome"``, ...

    Returns
    -------
    Result
        ``folder`` is the capture's; ``record`` says what was scanned.
    """
    _, record, notes = _command.printed(["synth", spec], options | {"out": out}, progress)
    return Result({"status": "ok"}, notes=notes, record=record, folder=Path(out))


def inspect(capture: Place) -> Result:
    """Validates and summarises a capture without fitting it; what ``mesophyll inspect`` does.

    Parameters
    ----------
    capture : path
        Folder with ``capture.toml``, or a file of an instrument.

    Returns
    -------
    Result
        ``record`` has what was found; ``status`` is ``"missed: ..."`` where the capture has a fault.
    """
    code, record, notes = _command.printed(["inspect", capture], {}, False)
    status = "ok" if code == 0 else "missed: the capture has a fault, which `record` names"
    return Result({"status": status}, notes=notes, record=record)
