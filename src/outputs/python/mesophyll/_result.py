"""Arrays on their way in, results on their way out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


class Result(dict[str, Any]):
    """A dictionary whose entries are attributes too: ``result["sigma_a"]`` is ``result.sigma_a``."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"no {name!r} here; there are {', '.join(self)}") from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]

    @property
    def ok(self) -> Any:
        """Where the status is ``"ok"``: an array of bool of the result's shape, or one bool."""
        found = np.asarray(self["status"]) == "ok"
        return found if found.ndim else bool(found)

    def to_xarray(self, dims: Sequence[str] | None = None) -> Any:
        """The arrays as an ``xarray.Dataset``; ``dims`` names the axes. Needs the package xarray."""
        import xarray

        arrays = {name: np.asarray(value) for name, value in self.items()}
        if dims is None:
            dims = [f"dim_{k}" for k in range(max(a.ndim for a in arrays.values()))]
        return xarray.Dataset({name: (list(dims)[: a.ndim], a) for name, a in arrays.items()})


def floats(value: ArrayLike, name: str) -> Floats:
    """Double-precision numbers, contiguous; None is a missing number."""
    try:
        return np.ascontiguousarray(np.nan if value is None else value, dtype=np.float64)
    except (TypeError, ValueError) as e:
        raise ValueError(f"{name}: expected numbers ({e})") from None


def broadcast(**arguments: ArrayLike) -> tuple[list[Floats], tuple[int, ...]]:
    """The arguments as flat arrays of one length, and the shape that they have together."""
    arrays = [np.asarray(np.nan if a is None else a) for a in arguments.values()]
    try:
        shape = np.broadcast_shapes(*(a.shape for a in arrays))
    except ValueError:
        shapes = ", ".join(f"{name} {a.shape}" for name, a in zip(arguments, arrays, strict=True))
        raise ValueError(f"shapes do not broadcast: {shapes}") from None
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
    """Raises ``ValueError`` for the first element that was refused."""
    for k, status in troubles:
        if status.startswith("refused: "):
            where = f" (element {tuple(int(i) for i in np.unravel_index(k, shape))})" if shape else ""
            raise ValueError(status.removeprefix("refused: ") + where)
