"""The verbs of the command line, on tables in memory and on folders."""

from __future__ import annotations

import csv
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._errors import Error, FitError, InputError, renamed
from ._result import Result

Place = str | PathLike[str]
Option = str | float | int | bool | PathLike[str] | Sequence[Any] | None
Table = Mapping[str, ArrayLike] | Place

# Columns of words; an empty cell of theirs is an empty string and no missing number.
WORDS = {"kind", "taken_out", "status", "leaf", "leaf_id", "branch", "plant", "side", "species", "path", "setting"}


def words(options: Mapping[str, Option]) -> list[str]:
    """Arguments of a function as words of the command line: ``hold_out=20`` is ``--hold-out=20``."""
    said = []
    for name, value in options.items():
        flag = f"--{name.rstrip('_').replace('_', '-')}"
        if value is None or value is False:
            continue
        if value is True:
            said.append(flag)
        elif isinstance(value, str | PathLike):
            said.append(f"{flag}={fspath(value)}")
        elif isinstance(value, Sequence | np.ndarray):
            said.append(f"{flag}={','.join(_word(v) for v in value)}")
        else:
            said.append(f"{flag}={_word(value)}")
    return said


def _word(value: Any) -> str:
    if isinstance(value, np.generic):
        value = value.item()
    return value if isinstance(value, str) else repr(value)


def command(*verb: Place, progress: bool = False) -> Result:
    """Does what the command line does with these words, for verbs that have no function here.

    Parameters
    ----------
    *verb : str or path
        The words after ``mesophyll``, one each: ``mp.command("export", "fits/elm", "--to", "gltf", "-o", "elm.glb")``.
        With ``"--json"`` among them the answer is read.
    progress : bool
        Lines of progress on standard error.

    Returns
    -------
    Result
        ``printed`` is what the verb printed, ``result.record`` the same where it is JSON, ``result.notes`` what it said
        on standard error, ``status`` ``"ok"`` or ``"missed: ..."``.

    Raises
    ------
    Error
        In the sentence of the command line.
    """
    code, printed, notes, missed = _native.command([fspath(word) for word in verb], None, progress)
    text = printed.decode("utf-8", "replace")
    record = None
    if "--json" in verb:
        record = json.loads(text)
    if missed is not None:
        raise FitError(missed)
    status = "ok" if code == 0 else "missed: the exit code of the command line is 1"
    return Result({"printed": text, "status": status}, notes=notes, record=record)


def printed(verb: Sequence[Place], options: Mapping[str, Option], progress: bool) -> tuple[int, Any, list[str]]:
    """The JSON that a verb prints, with its exit code and notes."""
    said = [*(fspath(word) for word in verb), *words(options), "--json"]
    code, text, notes, missed = _native.command(said, None, progress)
    if missed is not None:
        raise FitError(missed)
    return code, json.loads(text) if text else None, notes


def folder(verb: Sequence[Place], out: Place, options: Mapping[str, Option], progress: bool) -> list[str]:
    """Lets a verb write the fit folder ``out``, and returns its notes."""
    said = [*(fspath(word) for word in verb), f"--out={fspath(out)}", *words(options), "--json"]
    _, _, notes, missed = _native.command(said, fspath(out), progress)
    if missed is not None:
        raise FitError(missed)
    return notes


def table(
    verb: Sequence[Place],
    rows: Table | None,
    options: Mapping[str, Option] | None = None,
    *,
    flag: str = "in",
    one: bool = False,
    folder: Place | None = None,
    progress: bool = False,
) -> Result:
    """Lets a verb answer a table, which ``flag`` names. ``one``: its answer is one row, without an axis. ``folder``:
    the verb also keeps its fit there.
    """
    with tempfile.TemporaryDirectory(prefix="mesophyll-") as work:
        answer, names, given, scalar = Path(work) / "answer.csv", {f"{work}/answer.csv": "<answer>"}, set(), one
        said = [*(fspath(word) for word in verb), f"--out={answer}", *words(options or {})]
        if folder is not None:
            said.append(f"--out={fspath(folder)}")
        if isinstance(rows, str | PathLike):
            said.append(f"--{flag}={fspath(rows)}")
            given = _header(Path(rows))
        elif rows is not None:
            asked = Path(work) / "table.csv"
            columns, single = _columns(rows)
            given, scalar = set(columns), one or single
            _write(asked, columns)
            names[str(asked)] = "<table>"
            said.append(f"--{flag}={asked}")
        try:
            _, _, notes, missed = _native.command(said, None, progress)
        except Error as e:
            raise renamed(e, names) from None
        for path, name in names.items():
            notes = [note.replace(path, name) for note in notes]
        # Where every row was refused, each says why.
        if missed is not None and not answer.exists():
            raise FitError(missed)
        place = None if folder is None else Path(folder)
        return Result(read_table(answer, scalar=scalar), given=given, notes=notes, folder=place)


def _header(path: Path) -> set[str]:
    """The columns of a file, where it is a plain CSV."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return set(next(csv.reader(file), []))
    except (OSError, UnicodeDecodeError, csv.Error):
        return set()


def _columns(rows: Mapping[str, ArrayLike]) -> tuple[dict[str, np.ndarray[Any, Any]], bool]:
    """The columns of a table in memory, of one length, and whether all were single values."""
    dtype = getattr(rows, "dtype", None)
    names = getattr(dtype, "names", None) or (list(rows.keys()) if hasattr(rows, "keys") else None)
    if not names:
        raise InputError("a table: expected columns by name, as a dictionary or a data frame, or the path of a file")
    arrays = {str(name): np.asarray(rows[name]) for name in names}
    try:
        shape = np.broadcast_shapes(*(a.shape for a in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {a.shape}" for name, a in arrays.items())
        raise InputError(f"columns of a table have one length: {shapes}") from None
    if len(shape) > 1:
        raise InputError(f"columns of a table have one axis, found the shape {shape}")
    return {name: np.broadcast_to(a, shape or (1,)) for name, a in arrays.items()}, not shape


def _write(path: Path, columns: Mapping[str, np.ndarray[Any, Any]]) -> None:
    """A table as a CSV, with every digit."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*([_cell(v) for v in column.tolist()] for column in columns.values()), strict=True))


def _cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    return repr(value) if isinstance(value, float) else str(value)


def read_table(path: Place, *, scalar: bool = False) -> dict[str, Any]:
    """The columns of a CSV: arrays of numbers, or of words. ``scalar``: the values of its one row."""
    with open(path, encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    columns: dict[str, Any] = {}
    for k, name in enumerate(header):
        cells = [row[k] for row in rows]
        columns[name] = np.array(cells, dtype=object) if name in WORDS else _numbers(cells)
    if scalar and len(rows) == 1:
        return {name: column.tolist()[0] for name, column in columns.items()}
    return columns


def _numbers(cells: Sequence[str]) -> np.ndarray[Any, Any]:
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        return np.array(cells, dtype=object)


@contextmanager
def as_file(rows: Table | None, name: str) -> Iterator[Place | None]:
    """The path of a table, which is written to a temporary file where it is in memory."""
    if rows is None or isinstance(rows, str | PathLike):
        yield rows
        return
    with tempfile.TemporaryDirectory(prefix="mesophyll-") as work:
        place = Path(work) / f"{name}.csv"
        _write(place, _columns(rows)[0])
        try:
            yield place
        except Error as e:
            raise renamed(e, {str(place): f"<{name}>"}) from None
