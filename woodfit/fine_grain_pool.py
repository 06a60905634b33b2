"""The noises to choose the fine grain from, as they look on the lines that were read of a face."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from woodfit import fine_grain_noise as noise
from woodfit.fine_grain import FineGrain
from woodfit.fine_grain_measure import LUMINANCE, RANGES, LineSamples, Measured, band_pass, skewness
from woodfit.grain_spectrum import BANDS, band_power, line_power
from woodfit.photograph import srgb_encode

Array = npt.NDArray[Any]
FloatArray = npt.NDArray[np.float64]

#: Bands that are fitted; those finer than the checked ones count less, as sharpening and JPEG have their way there.
_FITTED: FloatArray = np.concatenate([BANDS, 2.0 ** np.array([-1.5, -1.0])])
_BAND_WEIGHT: FloatArray = np.concatenate([np.ones(len(BANDS)), [0.3, 0.1]])

#: Widths of streaks, px.
_WIDTHS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)

#: Length over width of streaks along the fibre where the face shows both, and of what end grain cannot show.
_SHOWN, _UNSEEN = (1.0, 4.0, 16.0, 64.0), 30.0

#: Height over thickness of rays, which no one face shows together with their length; their length over thickness on
#: end grain, and over their height on other faces.
_RAY_HEIGHT, _RAY_LENGTHS, _RAY_DEPTH = 10.0, (5.0, 25.0), 4.0

#: Widths of rays and of streaks along the rings, px; coarser ones would be seen as smears.
_WIDEST_RAY, _WIDEST_LAYER = 8.0, 16.0

#: Shares of cells that hold a pore, dense to sparse.
_DENSITIES = (0.5, 0.25, 0.1, 0.04)

#: Skewness up to which nothing is called dark spots.
_LEAST_DARK = 0.1

#: Largest share of the power of streaks that pores get.
_MOST_PORES = 0.95


def candidates(end_grain: bool, along_stem: bool, ring_width_px: float) -> list[tuple[int, tuple[float, ...]]]:
    """Kinds and cells of the noises to choose from, by what the faces show."""
    found: list[tuple[int, tuple[float, ...]]] = []
    for width in _WIDTHS:
        found += [(noise.FIBRE, (width, width, width * ratio)) for ratio in (_SHOWN if along_stem else (_UNSEEN,))]
        for ratio in _RAY_LENGTHS if end_grain else (_RAY_DEPTH * _RAY_HEIGHT,):
            if width <= _WIDEST_RAY:
                found.append((noise.RAY, (width, width * _RAY_HEIGHT, width * ratio)))
            # Streaks along the rings are thinner than a ring.
            if end_grain and width <= min(_WIDEST_LAYER, ring_width_px):
                found.append((noise.LAYER, (width, width * _UNSEEN, width * ratio)))
    return found


class Pool:
    """Candidates, and their spectra on the lines of a face.

    Parameters
    ----------
    directions : sequence of LineSamples
        Lines of each direction.
    measured : Measured
        Color, share by lateness and skewness of what the color map leaves.
    ring_width_px : float
        Mean ring width.
    seed : int
        Of the noises.
    """

    def __init__(self, directions: Sequence[LineSamples], measured: Measured, ring_width_px: float, seed: int) -> None:
        shown = {lines.end_grain for lines in directions}
        self._directions, self._seed = directions, seed
        self._chosen = candidates(True in shown, False in shown, ring_width_px)
        self._range = np.array(
            [next(n for n, (_, _, widest) in enumerate(RANGES) if cells[0] <= widest) for _, cells in self._chosen]
        )
        self._color = measured.color[self._range]
        # Only where a ring is several widths wide can its early- and latewood differ in what is seen.
        uneven = np.array([4.0 * cells[0] <= ring_width_px for _, cells in self._chosen])
        self._profile = np.where(uneven[:, None], measured.profile[self._range], 1.0)
        self._skewness = measured.skewness
        self._round = np.array([kind == noise.FIBRE for kind, _ in self._chosen])
        # Coarse dark spots are no vessels.
        self._porous = self._round & (measured.skewness < -_LEAST_DARK)[self._range] & (self._range < 2)
        base = [lines.base @ LUMINANCE.astype(np.float32) for lines in directions]
        # What the encoded luminance gains where the logarithm of the luminance gains 1.
        self._slope = [50.0 * (srgb_encode(y * 1.01) - srgb_encode(y / 1.01)) for y in base]
        self._share, self._density = np.zeros(len(RANGES)), np.full(len(RANGES), _DENSITIES[0])
        self._matrix = np.stack([self._spectrum(number, None) for number in range(len(self._chosen))], axis=1)

    def spectra(self, values: Sequence[Array]) -> FloatArray:
        """Band power of values (S, L) of each direction, in one row."""
        return np.concatenate([band_power(line_power(part), _FITTED) for part in values])

    def checked(self, wanted: FloatArray) -> npt.NDArray[np.bool_]:
        """Bands that the lines hold and that are asked for."""
        known = np.isfinite(wanted) & (wanted > 0.0)
        return np.asarray(known & np.tile(_BAND_WEIGHT == 1.0, len(self._directions)), dtype=np.bool_)

    def _field(self, number: int, lines: LineSamples, density: float | None) -> npt.NDArray[np.float32]:
        """One candidate on lines (S, L), as pores of a density or signed; power 1 before its profile."""
        kind, cells = self._chosen[number]
        one = FineGrain.unit(kind if density is None else noise.PORE, cells, density or 1.0, self._seed)
        early, late = self._profile[number] / (1.0 if density is None else noise.pore_spread(density))
        flat = lines.radius.ravel(), lines.azimuth.ravel(), lines.height.ravel()
        field = one.log_factor(*flat, np.zeros(flat[0].size, np.float32))[:, 0].reshape(lines.radius.shape)
        return np.asarray(field * (early + lines.lateness * (late - early)), dtype=np.float32)

    def _spectrum(self, number: int, density: float | None) -> FloatArray:
        values = zip(self._directions, self._slope, strict=True)
        return self.spectra([self._field(number, lines, density) * slope for lines, slope in values])

    def solve(self, missing: FloatArray, wanted: FloatArray) -> FloatArray:
        """Power of each candidate that makes up for the missing power; errors count relative to the wanted power.

        What all directions of end grain miss is made of round spots; only what is left, of rays and layers.
        """
        power = np.zeros(len(self._chosen))
        common = missing.reshape(len(self._directions), -1).copy()
        ends = [number for number, lines in enumerate(self._directions) if lines.end_grain]
        if ends:
            common[ends] = np.nanmin(np.where(np.isfinite(common[ends]), common[ends], np.inf), axis=0)
        rest = common.ravel()
        # In the end the spots once more, now that rays and layers have their part.
        for columns in (self._round, ~self._round, self._round):
            if columns.any():
                power[columns] = self._least_squares(columns, rest, missing, wanted, power)
            given = self._matrix[:, columns] @ power[columns]
            rest = np.maximum(missing - given, 0.0)
        return power

    def _least_squares(
        self,
        columns: npt.NDArray[np.bool_],
        target: FloatArray,
        missing: FloatArray,
        wanted: FloatArray,
        power: FloatArray,
    ) -> FloatArray:
        """Powers of some candidates that come to a target, the others' being given."""
        known = np.isfinite(wanted) & (wanted > 0.0)
        weight = (np.tile(_BAND_WEIGHT, len(self._directions)) / np.where(known, wanted, 1.0))[known]
        matrix, found, total = self._matrix[known], power.copy(), weight
        for _ in range(4):
            found[columns] = nnls(matrix[:, columns] * total[:, None], target[known] * total)[0]
            # Too little by half is as wrong as twice too much: what counts is the difference in dB.
            reached = np.maximum(wanted[known] - missing[known] + matrix @ found, 0.1 * wanted[known])
            total = weight * np.sqrt(wanted[known] / reached)
        return np.asarray(found[columns], dtype=np.float64)

    def choose_pores(self, power: FloatArray) -> None:
        """Turn streaks of given powers into as many pores, and as sparse ones, as the face's skewness asks for."""
        for number, (low, high, _) in enumerate(RANGES):
            used = np.flatnonzero(self._porous & (self._range == number) & (power > 0.0))
            across = [lines for lines in self._directions if lines.direction == "across"]
            if len(used) == 0 or not across:
                continue
            for density in _DENSITIES:
                parts = [
                    np.sum([np.sqrt(power[one]) * self._field(int(one), lines, density) for one in used], axis=0)
                    for lines in across
                ]
                whole = skewness(np.concatenate([band_pass(part[..., None], low, high).ravel() for part in parts]))
                if whole < self._skewness[number]:
                    break
            if whole < -_LEAST_DARK:
                # Third moments add as powers do, so the skewness goes with the share to the power 3/2.
                share = (self._skewness[number] / whole) ** (2.0 / 3.0)
                self._share[number], self._density[number] = min(_MOST_PORES, share), density
        for one in np.flatnonzero(self._porous & (self._share[self._range] > 0.0)):
            share, density = self._share[self._range[one]], float(self._density[self._range[one]])
            self._matrix[:, one] = (1.0 - share) * self._matrix[:, one] + share * self._spectrum(int(one), density)

    def grain(self, power: FloatArray) -> FineGrain:
        """Fine grain of given powers; those that matter nowhere are left out."""
        parts = np.nan_to_num(self._matrix * power)
        total = np.maximum(parts.sum(axis=1, keepdims=True), 1e-30)
        kind, cells, density, amplitude, color = [], [], [], [], []
        for number in np.flatnonzero((parts / total).max(axis=0) > 0.02):
            place = self._range[number]
            dark, sparse = (self._share[place] if self._porous[number] else 0.0), float(self._density[place])
            strength = np.sqrt(power[number]) * self._profile[number]
            for part, spread, name in (
                (1.0 - dark, 1.0, self._chosen[number][0]),
                (dark, noise.pore_spread(sparse), noise.PORE),
            ):
                if part > 0.01:
                    kind.append(name)
                    cells.append(self._chosen[number][1])
                    density.append(sparse if name == noise.PORE else 1.0)
                    amplitude.append(np.sqrt(part) * strength / spread)
                    color.append(self._color[number])
        if not kind:
            return FineGrain.none()
        return FineGrain.of(
            np.array(kind), np.array(cells), np.array(density), np.array(amplitude), np.array(color), self._seed
        )
