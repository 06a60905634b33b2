"""Fitting the fine grain: noises whose sum makes up for the power that the color map lacks on the face."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from woodfit.fine_grain import FineGrain
from woodfit.fine_grain_measure import LUMINANCE, LineSamples, luminance, measure
from woodfit.fine_grain_pool import Pool
from woodfit.grain_spectrum import BANDS, band_power, difference_db, line_power

FloatArray = npt.NDArray[np.float64]


def fit_fine_grain(
    directions: Sequence[LineSamples], ring_width_px: float, seed: int = 0, rounds: int = 4
) -> FineGrain:
    """Noises that give the color map the power that the photograph has, along each direction.

    The power spectra of every candidate are measured on the very lines that the photograph was read on, so bends,
    oblique cuts and the width of the window need no theory; non-negative least squares, relative to the photograph's
    power, picks the amplitudes. What the exponential and chance correlations change is corrected in further rounds,
    of which the best counts.

    Parameters
    ----------
    directions : sequence of LineSamples
        Lines along and across the grain, of end grain, of faces along the stem, or of both.
    ring_width_px : float
        Mean ring width.
    seed : int
        Of the noises.
    rounds : int
        Rounds of correction.

    Returns
    -------
    FineGrain
        Empty when there are no lines.
    """
    directions = [lines for lines in directions if len(lines.photo) > 0]
    if not directions:
        return FineGrain.none()
    pool = Pool(directions, measure(directions), ring_width_px, seed)
    wanted = pool.spectra([luminance(lines.photo) for lines in directions])
    missing = np.maximum(wanted - pool.spectra([luminance(lines.base) for lines in directions]), 0.0)
    pool.choose_pores(pool.solve(missing, wanted))
    checked, linear = pool.checked(wanted), pool.spectra([lines.photo @ LUMINANCE for lines in directions])
    best, least = FineGrain.none(), np.inf
    for _ in range(rounds):
        grain = pool.grain(pool.solve(missing, wanted))
        given = [_given_back(grain, lines) for lines in directions]
        # Half of the correction by encoded grey and half by light, so that the texture holds whichever one measures.
        off = [
            np.maximum(pool.spectra([grey(rgb) for rgb in given]), 1e-30) / np.maximum(of_photo, 1e-30)
            for grey, of_photo in ((luminance, wanted), (lambda rgb: rgb @ LUMINANCE, linear))
        ]
        worst = max(float(np.abs(np.log(one[checked])).max(initial=0.0)) for one in off)
        if worst < least:
            best, least = grain, worst
        missing = np.maximum(missing + wanted * (1.0 - np.sqrt(off[0] * off[1])), 0.0)
    return best


def _given_back(grain: FineGrain, lines: LineSamples) -> npt.NDArray[Any]:
    """Color of lines with their fine grain, linear RGB (S, L, 3)."""
    flat = (axis.ravel() for axis in (lines.radius, lines.azimuth, lines.height, lines.lateness))
    return np.asarray(lines.base * np.exp(grain.log_factor(*flat)).reshape(lines.base.shape))


def differences_db(grain: FineGrain, directions: Sequence[LineSamples]) -> FloatArray:
    """How much stronger the spectrum of the texture is than the photograph's, dB; (directions, 9), NaN if unknown."""
    return np.array(
        [
            difference_db(
                band_power(line_power(luminance(_given_back(grain, lines)))),
                band_power(line_power(luminance(lines.photo))),
            )
            for lines in directions
        ]
    ).reshape(len(directions), len(BANDS))


def worst_differences(grain: FineGrain, directions: Sequence[LineSamples]) -> dict[str, float]:
    """Of lines along and across the grain, the band (1/64 to 1/4 cycles per px) furthest off, dB, with its sign."""
    worst: dict[str, float] = {}
    for lines, off in zip(directions, differences_db(grain, directions), strict=True):
        if lines.direction in ("along", "across") and np.isfinite(off).any():
            what = "the rings of end grain" if lines.end_grain else "the fibre"
            largest = off[int(np.nanargmax(np.abs(off)))]
            worst[f"power {lines.direction} {what}, worst band against the photograph's (dB)"] = round(
                float(largest), 1
            )
    return worst
