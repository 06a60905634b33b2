"""Wood as a participating medium: extinction by lateness, single-scattering albedo from the color of a surface.

Nindel et al. 2023, Sec. 5 (volumetric appearance): extinction about 16 /mm in latewood and 6.5 /mm in earlywood. Their
map from surface albedo to single-scattering albedo is Eq. 4 of Elek et al. 2017; the same form was fitted here by Monte
Carlo (semi-infinite medium, isotropic phase function, diffuse light), for several refractive indices of its boundary.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

#: 1/mm, of pure early- and latewood.
EXTINCTION_EARLY, EXTINCTION_LATE = 6.5, 16.0

#: a, b and c of ``albedo = 1 - exp(a A + b A² + c A³)`` by refractive index of the boundary that is rendered.
_COEFFICIENTS = {
    1.0: (-4.9183, 1.7871, -3.4600),
    1.3: (-12.1008, 22.7077, -26.7405),
    1.5: (-17.8653, 51.8491, -77.3471),
    1.55: (-19.4671, 61.9797, -98.6798),
}

#: Surface albedos are taken no nearer to 0 and 1 than this: the fit does not hold there.
_LEAST, _MOST = 0.002, 0.97


def extinction_per_mm(lateness: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Extinction (1/mm) at lateness 0..1, same shape; linear, as density is."""
    late = np.clip(lateness, 0.0, 1.0)
    return np.asarray(EXTINCTION_EARLY + (EXTINCTION_LATE - EXTINCTION_EARLY) * late, np.float32)


def scattering_albedo(surface: npt.NDArray[Any], index: float = 1.0) -> npt.NDArray[np.float32]:
    """Single-scattering albedo of a medium that, thick enough, has the diffuse albedo `surface`; same shape.

    Parameters
    ----------
    surface : array
        Linear color 0..1, of any shape.
    index : float
        Refractive index of the boundary that is rendered: 1 where there is none.

    Raises
    ------
    KeyError
        When the fit was not made for this index.
    """
    a, b, c = _COEFFICIENTS[index]
    color = np.clip(surface, _LEAST, _MOST)
    return np.asarray(1.0 - np.exp(color * (a + color * (b + color * c))), np.float32)


def surface_albedo(scattering: npt.NDArray[Any], index: float = 1.0) -> Floats:
    """Inverse of `scattering_albedo`, by halving the interval; same shape."""
    wanted = np.asarray(scattering, float)
    low, high = np.full(wanted.shape, _LEAST), np.full(wanted.shape, _MOST)
    for _ in range(50):
        middle = 0.5 * (low + high)
        above = scattering_albedo(middle, index) > wanted
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.asarray(0.5 * (low + high), np.float64)
