"""Arrays on their way in, results on their way out."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._errors import InputError

Floats = NDArray[np.float64]
Maps = dict[str, NDArray[np.float32]]

# Units by how names end, as in tables and files; the longest end counts.
UNITS = {
    "_mm_per_sqrt_hz": "mm/sqrt(Hz)",
    "_mm_per_m_s": "mm per m/s",
    "_ug_cm2": "ug/cm^2",
    "_cm2_g": "cm^2/g",
    "_per_cm": "1/cm",
    "_g_cm2": "g/cm^2",
    "_s_per_m": "s/m",
    "_per_mm": "1/mm",
    "_per_s": "1/s",
    "_deg": "degrees",
    "_gpa": "GPa",
    "_nm": "nm",
    "_um": "um",
    "_mm": "mm",
    "_hz": "Hz",
    "_n": "N",
    "_s": "s",
    "sigma_a": "1/mm",
    "sigma_s": "1/mm",
    "tilt": "rad",
    "tilt_y": "rad",
}
NOT_DETERMINED = "the measurement does not determine it"
NO_VALUE = "there is no value"
# What has no unit although its name ends like one.
PURE = {"rho_s", "xi_s"}


def unit_of(name: str) -> str:
    """The unit of a column, by its name; empty for pure numbers."""
    if name in PURE or re.fullmatch(r"rho_s_.*", name):
        return ""
    ends = sorted((end for end in UNITS if name.endswith(end)), key=len)
    return UNITS[ends[-1]] if ends else ""


@dataclass(frozen=True)
class Parameter:
    """A fitted number, or an array of them.

    Attributes
    ----------
    name : str
        Its name, as the result has it.
    value : float or ndarray
        The estimate; NaN where there is none.
    stderr : float or ndarray
        Its standard error: NaN where it is not known, infinite where nothing limits the value.
    unit : str
        Unit of both; empty for pure numbers.
    undetermined : str or ndarray of str
        Why the measurement does not determine it; empty where it does.
    """

    name: str
    value: Any
    stderr: Any
    unit: str
    undetermined: Any

    @property
    def determined(self) -> Any:
        """Whether the measurement determines it: a bool, or an array of them."""
        found = np.asarray(self.undetermined) == ""
        return found if found.ndim else bool(found)

    def __repr__(self) -> str:
        text = f"{self.name} = {self.value} ± {self.stderr} {self.unit}".rstrip()
        return text if np.ndim(self.undetermined) or not self.undetermined else f"{text} ({self.undetermined})"

    def to_dict(self) -> dict[str, Any]:
        """The same as plain numbers, lists and strings, ready for JSON; a number that is not finite is None."""
        told = {"value": self.value, "stderr": self.stderr, "unit": self.unit, "undetermined": self.undetermined}
        return {name: plain(value) for name, value in told.items()}


class Result(MutableMapping[str, Any]):
    """What every function answers: entries by name, as in a dictionary, which are attributes too.

    ``result["sigma_a"]`` is ``result.sigma_a``, its standard error ``result.sigma_a_err``, and
    ``result.params["sigma_a"]`` has both with unit and, where it is not determined, the reason.

    ``result.status`` says how it ended: ``"ok"``, ``"undetermined: ..."`` (the best estimate, and what it leaves open)
    or ``"refused: ..."`` (no numbers, and why). A fit that lies in a folder is ``"ok"``, ``"doubtful: ..."`` or
    ``"missed: ..."`` (it must not be used as it is), as ``mesophyll report`` judges it.

    Attributes
    ----------
    notes : list of str
        What the command line says of it besides.
    record : dict or list
        Everything that was written or printed of it: ``fit.toml``, ``check.json``, and so on. Empty for tables.
    folder : pathlib.Path or None
        Where its files lie.
    parts : dict of Result
        Parts of a fit: the sides of a leaf, the branches of a table. A part is an attribute, too: ``fit.front``.
    """

    def __init__(
        self,
        entries: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
        *,
        given: Iterable[str] = (),
        notes: Sequence[str] = (),
        record: Any = None,
        folder: Path | None = None,
        open_params: Mapping[str, str] | None = None,
        units: Mapping[str, str] | None = None,
        parts: Mapping[str, Result] | None = None,
    ):
        self._entries: dict[str, Any] = dict(entries)
        self.notes = list(notes)
        self.record = {} if record is None else record
        self.folder = folder
        self.parts = dict(parts or {})
        self._given, self._open, self._units = set(given), open_params, dict(units or {})

    def __getitem__(self, name: str) -> Any:
        return self._entries[name]

    def __setitem__(self, name: str, value: Any) -> None:
        self._entries[name] = value

    def __delitem__(self, name: str) -> None:
        del self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        for place in (self._entries, self.parts):
            if name in place:
                return place[name]
        raise AttributeError(f"no {name!r} here; there are {', '.join([*self, *self.parts])}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self, *self.parts]

    def __repr__(self) -> str:
        where = f" in {self.folder}" if self.folder else ""
        return f"<Result{where}: {', '.join(self)}>"

    @property
    def ok(self) -> Any:
        """Where the status is ``"ok"``: an array of bool of the result's shape, or one bool."""
        found = np.asarray(self["status"]) == "ok"
        return found if found.ndim else bool(found)

    @property
    def params(self) -> dict[str, Parameter]:
        """Its parameters by name: what has a standard error, or all numbers where nothing has one."""
        return {name: self._param(name) for name in self._names()}

    def _names(self) -> list[str]:
        numbers = [n for n, v in self.items() if n not in self._given and np.asarray(v).dtype.kind in "fiu"]
        return [name for name in numbers if f"{name}_err" in self] or numbers

    def _param(self, name: str) -> Parameter:
        value = self[name]
        error = self.get(f"{name}_err", np.full(np.shape(value), np.nan) if np.ndim(value) else np.nan)
        return Parameter(name, value, error, self._units.get(name, unit_of(name)), self._reason(name, value))

    def _reason(self, name: str, value: Any) -> Any:
        if self._open is not None:
            return "; ".join(why for key, why in self._open.items() if key == name or key.startswith(f"{name}."))
        status, names = np.asarray(self.get("status", "ok"), dtype=object), self._names()
        # The status of a row with several channels is one.
        missing = np.isnan(np.asarray(value, dtype=float)).reshape(status.shape + (-1,)).all(axis=-1)
        reasons = [reason(one, name, names) for one in status.reshape(-1)]
        found = [why or (NO_VALUE if gone else "") for why, gone in zip(reasons, missing.reshape(-1), strict=True)]
        return np.array(found, dtype=object).reshape(status.shape) if status.shape else found[0]

    @property
    def undetermined(self) -> dict[str, Any]:
        """What the measurement leaves open, by name, and why: a sentence, or an array of them (empty where nothing)."""
        if self._open is not None:
            return dict(self._open)
        reasons = {name: param.undetermined for name, param in self.params.items()}
        return {name: why for name, why in reasons.items() if np.any(np.asarray(why) != "")}

    def to_dict(self) -> dict[str, Any]:
        """The same as plain numbers, lists and strings, ready for JSON; a number that is not finite is None."""
        told: dict[str, Any] = {"status": plain(self.get("status", "ok"))}
        told["params"] = {name: param.to_dict() for name, param in self.params.items()}
        known = set(self.params) | {f"{name}_err" for name in self.params} | {"status"}
        told["values"] = {name: plain(value) for name, value in self.items() if name not in known}
        told |= {"undetermined": {name: plain(why) for name, why in self.undetermined.items()}, "notes": self.notes}
        return told | {"folder": None if self.folder is None else str(self.folder)}

    def to_xarray(self, dims: Sequence[str] | None = None) -> Any:
        """The arrays as an ``xarray.Dataset``; ``dims`` names the axes. Needs the package xarray."""
        import xarray

        arrays = {name: np.asarray(value) for name, value in self.items()}
        if dims is None:
            dims = [f"dim_{k}" for k in range(max(a.ndim for a in arrays.values()))]
        return xarray.Dataset({name: (list(dims)[: a.ndim], a) for name, a in arrays.items()})

    def maps(self, name: str = "front") -> Maps:
        """A picture of the folder by the name of its channels, shape (height, width) each.

        Of a leaf's side: ``rho_d.R``, ``sigma_a.G``, ``thickness.Y``, ``mask.Y``, ...; of a scene's view: ``R``, ``G``,
        ``B``, and ``error.R``, ... Row 0 is at the top.
        """
        if self.folder is None:
            raise InputError("this result has no folder, so it has no maps")
        return read_exr(self.folder / f"{name}.exr")

    def errors(self, name: str = "front") -> Maps:
        """Standard errors of the maps of a leaf's side under the same names."""
        return self.maps(f"{name}_err")

    def maps_to_xarray(self, name: str = "front") -> Any:
        """The maps as an ``xarray.Dataset`` over ``y`` and ``x``. Needs the package xarray."""
        import xarray

        return xarray.Dataset({channel: (("y", "x"), values) for channel, values in self.maps(name).items()})


def read_exr(path: str | PathLike[str]) -> Maps:
    """The channels of an OpenEXR file.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    dict of ndarray
        Channels by name: single precision, shape (height, width), row 0 at the top.

    Raises
    ------
    Error
        Where there is no such file (also an ``OSError``) or where it is no OpenEXR image (a ``ValueError``).
    """
    width, height, channels = _native.read_exr(str(path))
    return {name: np.frombuffer(samples, dtype=np.float32).reshape(height, width) for name, samples in channels}


def reason(status: str, name: str, names: Iterable[str]) -> str:
    """Why a status leaves the parameter ``name`` open, or nothing. ``names`` are those of all parameters.

    What a status names stands before any explanation, which begins with a bracket or a colon. A status that names none
    of the parameters speaks of all.
    """
    kind, _, what = status.partition(": ")
    if kind == "ok":
        return ""
    if kind != "undetermined":
        return what
    begins = re.search(r"[(:]", what)
    head, why = (what[: begins.start()], what[begins.start() :]) if begins else (what, "")

    def meant(one: str, text: str) -> bool:
        return any(word == one or word.startswith(f"{one}_") for word in re.split(r"[ ,;]", text))

    known = list(names)
    if not any(meant(one, head) for one in known):
        return what
    own = [part.strip() for part in re.split(r"[,;]", head) if meant(name, part)]
    if not own:
        return ""
    # Besides names, a part may hold a bound: `sigma_a >= 23`.
    bound = own[0] if any(not any(meant(one, word) for one in known) for word in own[0].split()) else ""
    if why.startswith("(") and why.endswith(")"):
        why = why[1:-1]
    return " ".join(part for part in (bound, why.removeprefix(": ")) if part) or NOT_DETERMINED


def plain(value: Any) -> Any:
    """Numbers, lists and strings of Python, as JSON has them; what is not finite is None."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def floats(value: ArrayLike | None, name: str) -> Floats:
    """Double-precision numbers, contiguous; None is a missing number."""
    try:
        return np.ascontiguousarray(np.nan if value is None else value, dtype=np.float64)
    except (TypeError, ValueError) as e:
        raise InputError(f"{name}: expected numbers ({e})") from None


def broadcast(**arguments: ArrayLike | None) -> tuple[list[Floats], tuple[int, ...]]:
    """The arguments as flat arrays of one length, and the shape that they have together."""
    arrays = [np.asarray(np.nan if a is None else a) for a in arguments.values()]
    try:
        shape = np.broadcast_shapes(*(a.shape for a in arrays))
    except ValueError:
        shapes = ", ".join(f"{name} {a.shape}" for name, a in zip(arguments, arrays, strict=True))
        raise InputError(f"shapes do not broadcast: {shapes}") from None
    flat = [floats(np.broadcast_to(a, shape), name).reshape(-1) for name, a in zip(arguments, arrays, strict=True)]
    return flat, shape


def statuses(troubles: Sequence[tuple[int, str]], shape: tuple[int, ...]) -> Any:
    """A word for every element; a plain string where there is one element without axes."""
    words = np.full(int(np.prod(shape)), "ok", dtype=object)
    for k, status in troubles:
        words[k] = status
    return words.reshape(shape) if shape else str(words[0])


def shaped(column: Floats, shape: tuple[int, ...]) -> Any:
    """A contiguous array of this shape; a float where there are no axes."""
    return np.ascontiguousarray(column).reshape(shape) if shape else float(column[0])


def collect(
    names: Sequence[str], shape: tuple[int, ...], fill: Callable[[Floats], Sequence[tuple[int, str]]]
) -> Result:
    """Lets ``fill`` compute a row of cells an element, and names the cells."""
    out = np.empty((int(np.prod(shape)), len(names)))
    troubles = fill(out)
    result = Result({name: shaped(out[:, k], shape) for k, name in enumerate(names)})
    result["status"] = statuses(troubles, shape)
    return result


def strict(troubles: Sequence[tuple[int, str]], shape: tuple[int, ...]) -> None:
    """Raises for the first element that was refused."""
    for k, status in troubles:
        if status.startswith("refused: "):
            where = f" (element {tuple(int(i) for i in np.unravel_index(k, shape))})" if shape else ""
            raise InputError(status.removeprefix("refused: ") + where)
