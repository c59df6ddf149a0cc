"""Measurements of leaves, branches, skies and scenes in, fitted parameters out, on NumPy arrays.

Modules
-------
slab          what a leaf reflects and lets through from absorption and scattering, and back
foliar        a leaf of layers or plates: what it reflects, and its pigments
gloss         how a surface reflects light: linear-light-source traces and goniometer samples
leaf          fits of whole scans, from a capture on disk or from arrays
translucency  light through a leaf by direction, and the tissue that explains it
branch        branches that bend and sway
sky           a clear sky as spherical harmonics, and the sky of a picture
scene         scenes: drawn, checked, evaluated as canopies, and found from their pictures
grass         meadows as slices
spectra       spectra as the bands of sRGB, of CIE 1931 or of a sensor
design        which readings to take, planned from the derivatives that the fits use
fits          reads the folder of any fit: parameters with errors, maps as arrays

:func:`command` does any other verb of the command line. Lengths are in mm, absorption and scattering in 1/mm, angles in
radians unless a name ends in ``_deg``. Arguments that are arrays broadcast against each other as NumPy's do. A table is
a dictionary of columns, a data frame, or the path of a file. Everything is computed on all cores, without Python's
lock; the environment variable ``RAYON_NUM_THREADS``, set before the first import, limits the number of threads. The
numbers are those of the command line ``mesophyll``, digit by digit.

Every function answers a :class:`Result`, or plain arrays where nothing but numbers can come out: entries by name, as in
a dictionary, which are attributes too. ``result.params`` has each parameter with its standard error, unit and, where
the measurement leaves it open, the reason; ``result.status`` says how it ended, ``result.ok`` whether it is good, and
``result.to_dict()`` is all of it as plain Python.

Errors are of one type, :class:`Error`, in the sentences of the command line. Each is besides what Python calls it:
``ValueError`` for arguments and for files that do not say what they should, ``OSError`` for files that are not there,
may not be opened or cannot be written, ``RuntimeError`` for a fit that as a whole failed.
"""

from . import branch, design, fits, foliar, gloss, grass, leaf, scene, sky, slab, spectra, translucency
from ._command import command
from ._errors import Error
from ._native import __version__
from ._result import Parameter, Result

__all__ = [
    "Error",
    "Parameter",
    "Result",
    "__version__",
    "branch",
    "command",
    "design",
    "fits",
    "foliar",
    "gloss",
    "grass",
    "leaf",
    "scene",
    "sky",
    "slab",
    "spectra",
    "translucency",
]
