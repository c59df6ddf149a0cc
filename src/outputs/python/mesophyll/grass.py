"""Meadows as slices, for drawing them in real time."""

from __future__ import annotations

from ._command import Option, Place
from ._result import Result
from .fits import made

__all__ = ["fit"]


def fit(
    meadow: Place,
    out: Place,
    *,
    slices: int = 16,
    texels: tuple[int, int] = (256, 64),
    upright_only: bool = False,
    rays: int = 4,
    entries: int = 48,
    leaves: Place | None = None,
    force: bool = False,
    progress: bool = False,
) -> Result:
    """Slices of a meadow from its blades; what ``mesophyll fit grass`` does.

    Parameters
    ----------
    meadow : path
        Description of the meadow (.toml), or what ``mesophyll grow`` makes of it (.glb).
    out : path
        Folder to write.
    slices : int
        Slices across x, and as many across y, 1 to 128.
    texels : (int, int)
        Texels along a slice and along its height: powers of two from 4 to 1024.
    upright_only : bool
        Leave out the level slice, which only views from above need.
    rays : int
        Rays along each side of a texel, 1 to 64.
    entries : int
        Points of entry along each side of the square, 4 to 1024, by which the fit is judged.
    leaves : path, optional
        What the leaves of each material reflect and let through (.toml).
    force : bool
        Fit again although the folder holds this very fit.
    progress : bool
        Lines of progress on standard error.

    Returns
    -------
    Result
        ``result.maps("slices")`` has the slices, ``result.record`` how far they are from the blades.
    """
    options: dict[str, Option] = {"slices": slices, "texels": f"{texels[0]}x{texels[1]}", "rays": rays}
    options |= {"upright_only": upright_only, "entries": entries, "leaves": leaves, "force": force}
    return made(["fit", "grass", meadow], out, options, progress)
