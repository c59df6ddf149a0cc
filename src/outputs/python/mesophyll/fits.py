"""Reads the folder of a fit: what ``mesophyll fit ... -o FOLDER`` and the functions of this package write."""

from __future__ import annotations

import json
import tomllib
import warnings
from collections.abc import Mapping, Sequence
from os import fspath
from pathlib import Path
from typing import Any

import numpy as np

from . import _command, _native
from ._command import Option, Place
from ._result import Result, read_exr

__all__ = ["read", "read_exr", "report"]


def read(folder: Place) -> Result:
    """Opens the folder of a fit and checks that nothing in it was changed since.

    Parameters
    ----------
    folder : path
        A folder with ``fit.toml``.

    Returns
    -------
    Result
        Its parameters, one number each or one a channel: ``fit.front.sigma_a`` and ``fit["front.sigma_a"]`` (1/mm)
        of the front of a leaf, ``fit.tip`` of a fit without parts; with ``_err`` their standard errors.
        ``fit.params["front.sigma_a"]`` has value, error, unit and what is undetermined. ``fit.record`` is ``fit.toml``
        as dictionaries, ``fit.maps("front")`` the maps of a side, ``fit.status`` the judgement of ``mesophyll report``.

    Raises
    ------
    Error
        Where there is none (also an ``OSError``), where it cannot be read (a ``ValueError``), and where it was changed
        (a ``RuntimeError``).

    Warns
    -----
    UserWarning
        Where its numbers contradict each other.
    """
    return opened(folder, [])


def opened(folder: Place, notes: Sequence[str]) -> Result:
    """As :func:`read`, with what was said when it was made."""
    place = Path(folder)
    for said in _native.verify(fspath(place)):
        warnings.warn(said, stacklevel=3)
    with open(place / "fit.toml", "rb") as file:
        record: dict[str, Any] = tomllib.load(file)
    status = _native.quality(fspath(place))
    parts = {name: _part(found, status, place) for name, found in record.items() if isinstance(found, dict)}
    parts = {name: part for name, part in parts.items() if len(part) > 1}
    entries: dict[str, Any] = {}
    left_open: dict[str, str] = {}
    units: dict[str, str] = {}
    for name, part in parts.items():
        before = "" if name == "all" else f"{name}."
        entries |= {f"{before}{key}": value for key, value in part.items() if key != "status"}
        left_open |= {f"{before}{key}": why for key, why in part.undetermined.items()}
        units |= {f"{before}{key}": param.unit for key, param in part.params.items()}
    entries["status"] = status
    return Result(entries, notes=notes, record=record, folder=place, open_params=left_open, units=units, parts=parts)


def _part(section: Mapping[str, Any], status: str, folder: Path) -> Result:
    """The parameters of one part of ``fit.toml``."""
    entries: dict[str, Any] = {}
    left_open: dict[str, str] = {}
    units: dict[str, str] = {}
    for name, param in section.items():
        if not (isinstance(param, dict) and {"value", "stderr"} <= param.keys()):
            continue
        both = (np.array(param[key], dtype=float) for key in ("value", "stderr"))
        entries[name], entries[f"{name}_err"] = (v if v.size != 1 else float(v[0]) for v in both)
        units[name] = param.get("unit", "")
        for said in param.get("undetermined", []):
            key, _, why = said.partition(": ")
            left_open[key] = why.removeprefix("undetermined: ") or said
    entries["status"] = status
    return Result(entries, record=dict(section), folder=folder, open_params=left_open, units=units)


def made(verb: Sequence[Place], out: Place, options: Mapping[str, Option], progress: bool) -> Result:
    """Lets a verb make the fit folder ``out``, and opens it."""
    return opened(out, _command.folder(verb, out, options, progress))


def report(*folders: Place, out: Place | None = None) -> Result:
    """How good fits are; what ``mesophyll report`` says. Two or more are compared with the first.

    Parameters
    ----------
    *folders : path
        Folders of fits, or the folder of a run.
    out : path, optional
        An HTML page to write.

    Returns
    -------
    Result
        ``record`` holds the rows of the report as dictionaries and lists; numbers that are not finite are None.
        ``status`` is ``"ok"``, ``"doubtful: ..."`` or ``"missed: ..."`` with the verdict's sentence.
    """
    said = ["report", *(fspath(folder) for folder in folders), "--json", *_command.words({"out": out})]
    found = _command.command(*said)
    rows = json.loads(found["printed"])
    verdict = rows["verdict"]
    word = "missed" if verdict["missed"] else "doubtful"
    status = "ok" if verdict["level"] == "good" else f"{word}: {verdict['sentence']}"
    return Result({"status": status}, notes=found.notes, record=rows)
