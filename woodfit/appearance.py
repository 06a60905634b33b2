"""What a finished surface of the wood looks like beside its color: one rule for every renderer and export.

Latewood is denser and harder than earlywood: planed, sanded or worn it is smoother, and it stands out a little.
(Nindel et al. 2023, Sec. 5: roughness and displacement as functions of the lateness of growth.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Finish:
    """A surface finish.

    Attributes
    ----------
    roughness_early, roughness_late : float
        Roughness (the square root of GGX alpha, as in glTF and USD) of earlywood and latewood; linear in lateness.
    relief : float
        How far latewood stands out over earlywood, in mean ring widths.
    index_of_refraction : float
        Of the dielectric coat: cellulose and most varnishes.
    """

    roughness_early: float = 0.62
    roughness_late: float = 0.42
    relief: float = 0.03
    index_of_refraction: float = 1.5

    def roughness(self, lateness: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """Roughness at lateness (0..1), same shape."""
        late = np.clip(lateness, 0.0, 1.0)
        return np.asarray(self.roughness_early + (self.roughness_late - self.roughness_early) * late, np.float32)

    def height(self, lateness: npt.NDArray[Any], ring_width: float) -> npt.NDArray[np.float32]:
        """Height over the earlywood's surface at lateness (0..1), in the unit of `ring_width`."""
        return np.asarray(self.relief * ring_width * np.clip(lateness, 0.0, 1.0), np.float32)


#: What everything uses that is not told otherwise.
SATIN = Finish()
