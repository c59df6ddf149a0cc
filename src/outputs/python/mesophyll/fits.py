"""Reads the folder of a fit: what ``mesophyll fit ... -o FOLDER`` and :func:`mesophyll.leaf.fit` write."""

from __future__ import annotations

import tomllib
import warnings
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._result import Result

__all__ = ["Fit", "read", "read_exr"]

Maps = dict[str, NDArray[np.float32]]


def read_exr(path: str | PathLike[str]) -> Maps:
    """The channels of an OpenEXR file by name: single precision, shape (height, width), row 0 at the top.

    Raises ``OSError`` where there is no such file and ``ValueError`` where it is no OpenEXR image.
    """
    width, height, channels = _native.read_exr(fspath(path))
    return {name: np.frombuffer(samples, dtype=np.float32).reshape(height, width) for name, samples in channels}


class Fit:
    """A fit as it lies in its folder.

    Attributes
    ----------
    folder : pathlib.Path
        Where it lies.
    record : dict
        ``fit.toml``: parameters with units and standard errors, what is undetermined, residuals, hashes.
    """

    def __init__(self, folder: str | PathLike[str]):
        self.folder = Path(folder)
        for said in _native.verify(fspath(self.folder)):
            warnings.warn(said, stacklevel=2)
        with open(self.folder / "fit.toml", "rb") as file:
            self.record: dict[str, Any] = tomllib.load(file)

    @property
    def params(self) -> Result:
        """Parameters by part of the fit (``front``, ``back`` or ``all``) and name.

        Each is a dictionary with ``value`` and ``stderr``, a number a channel, and ``unit``.
        """
        found = Result()
        for name, part in self.record.items():
            if isinstance(part, dict):
                params = {k: v for k, v in part.items() if isinstance(v, dict) and {"value", "stderr"} <= v.keys()}
                if params:
                    found[name] = Result(params)
        return found

    def maps(self, side: str = "front") -> Maps:
        """Maps of a side, shape (height, width) each: ``rho_d.R``, ``sigma_a.G``, ``thickness.Y``, ``mask.Y``, ..."""
        return read_exr(self.folder / f"{side}.exr")

    def errors(self, side: str = "front") -> Maps:
        """Standard errors of the maps under the same names."""
        return read_exr(self.folder / f"{side}_err.exr")

    def to_xarray(self, side: str = "front") -> Any:
        """The maps of a side as an ``xarray.Dataset`` over ``y`` and ``x``. Needs the package xarray."""
        import xarray

        return xarray.Dataset({name: (("y", "x"), values) for name, values in self.maps(side).items()})

    def __repr__(self) -> str:
        return f"<{self.record.get('kind')} fit {self.record.get('name')!r} in {self.folder}>"


def read(folder: str | PathLike[str]) -> Fit:
    """Opens the folder of a fit and checks that nothing in it was changed since.

    Raises ``OSError`` where there is none, ``ValueError`` where it cannot be read and ``RuntimeError`` where it was
    changed.
    """
    return Fit(folder)
