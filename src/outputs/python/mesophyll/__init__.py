"""Measurements of leaves and skies in, fitted parameters out, on NumPy arrays.

Modules
-------
slab    what a leaf reflects and lets through from absorption and scattering, and back (``forward``, ``invert``)
gloss   how a surface reflects light: fits of linear-light-source traces and of goniometer samples
leaf    fits of whole scans, from a capture on disk or from arrays
sky     spherical harmonics of a clear sky (``coefficients``, ``evaluate``, ``irradiance``)
fits    reads the folder of any fit: parameters as dictionaries, maps as arrays

Functions
---------
beam    deflection and slope of a tapered branch
dipole  how light that enters a leaf at one point leaves on the far side
abm     reflectance and transmittance of a leaf of layers

Lengths are in mm, absorption and scattering in 1/mm, angles in radians unless a name ends in ``_deg``. Arguments
broadcast against each other as NumPy's do. Everything is computed on all cores, without Python's lock; the environment
variable ``RAYON_NUM_THREADS``, set before the first import, limits the number of threads. The numbers are those of the
command line ``mesophyll``, digit by digit.

A result is a :class:`Result`: a dictionary of arrays whose entries are attributes too. Its ``status`` says of every
element ``"ok"`` (nothing speaks against the model, and each error is below 10 %), ``"undetermined: ..."`` (the best
estimate, and what it leaves open) or ``"refused: ..."`` (no numbers, and why); ``result.ok`` is the mask of the good
ones.

Errors are ``ValueError`` for arguments and for files that do not say what they should, ``OSError`` for files that
are not there, may not be opened or cannot be written, ``RuntimeError`` for a fit that as a whole failed.
"""

from . import fits, gloss, leaf, sky, slab
from ._models import abm, beam, dipole
from ._native import __version__
from ._result import Result

__all__ = ["Result", "__version__", "abm", "beam", "dipole", "fits", "gloss", "leaf", "sky", "slab"]
