"""The one type of exception, and what each is besides."""

from __future__ import annotations


class Error(Exception):
    """Whatever Mesophyll refuses, in one sentence: the file, the field, what was found and what was expected.

    Attributes
    ----------
    file, line, field : str or None
        The file, its line and the field or argument to blame, where they are known.
    """

    file: str | None = None
    line: str | None = None
    field: str | None = None


class InputError(Error, ValueError):
    """An argument that cannot be used, or a file that does not say what it should."""


class FileError(Error, OSError):
    """A file that cannot be read or written."""


class MissingFileError(FileError, FileNotFoundError):
    """A file that is not there."""


class ForbiddenFileError(FileError, PermissionError):
    """A file that may not be opened."""


class FitError(Error, RuntimeError):
    """A fit, a check or a whole table that failed."""


def renamed(error: Error, names: dict[str, str]) -> Error:
    """The same error with other names of files in its sentence."""
    sentence = str(error)
    for path, name in names.items():
        sentence = sentence.replace(path, name)
    other = type(error)(sentence)
    other.file, other.line, other.field = error.file, error.line, error.field
    if other.file is not None:
        other.file = names.get(other.file, other.file)
    return other
