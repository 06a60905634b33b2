"""Which parts of a carved mesh lie where the photographs support the wood, and which are only continued."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.carve.mesh_files import Mesh

if TYPE_CHECKING:
    from woodfit import SolidTexture

Array = npt.NDArray[Any]

#: Points on the surface that are asked.
_POINTS = 20_000

#: Below this confidence wood counts as continued (docs/solid_texture.md).
SUPPORTED = 0.5

_MOST_PARTS = 20


@dataclass(frozen=True)
class Part:
    """A connected piece of the mesh.

    Attributes
    ----------
    area_share : float
        Of the whole surface.
    unsupported_share : float
        Of its own surface.
    low, high : tuple of float
        Its bounding box in the wood.
    """

    area_share: float
    unsupported_share: float
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True)
class Support:
    """How much of the surface is continued rather than seen.

    Attributes
    ----------
    area_share : float
        Share of the surface with confidence below `SUPPORTED`.
    unseen_rings_share : float
        Share of it in rings that no photograph shows.
    furthest : float
        Greatest distance from a photographed face, in `SolidTexture.unit`; infinite when none is known.
    parts : tuple of Part
        Connected pieces, largest first.
    """

    area_share: float
    unseen_rings_share: float
    furthest: float
    parts: tuple[Part, ...]

    def words(self, unit: str) -> list[str]:
        """Lines for people."""
        lines = [
            f"{100 * self.area_share:.0f} % of the surface lies where the photograph hardly supports the wood, "
            f"up to {self.furthest:.3g} {unit} from it; "
            f"{100 * self.unseen_rings_share:.0f} % in rings that it does not show"
        ]
        for number, part in enumerate(self.parts, 1):
            if len(self.parts) > 1 and part.unsupported_share > 0.05:
                low, high = (", ".join(f"{value:.3g}" for value in corner) for corner in (part.low, part.high))
                share = f"{100 * part.unsupported_share:.0f} %"
                lines.append(f"part {number}, from ({low}) to ({high}) {unit}: {share} hardly supported")
        return lines


def support_of(texture: SolidTexture, mesh: Mesh, corners: Array) -> Support:
    """Ask the texture at points spread evenly over a surface; corners (F, 3, 3) in the board frame."""
    points, face, _ = spread_points(corners, _POINTS, np.random.default_rng(0))
    wood = texture.evaluate(points, detail=False)
    weak = wood.confidence < SUPPORTED
    low, high = texture.seen.ages
    unseen = (wood.ring_age < low) | (wood.ring_age > high)
    scale = texture.pixel_size or 1.0
    piece = _pieces(mesh)
    parts = []
    for number in np.argsort(-np.bincount(piece[face]), kind="stable")[:_MOST_PARTS]:
        mine = piece[face] == number
        if mine.any():
            box = corners[piece == number].reshape(-1, 3)
            ends = tuple(box.min(axis=0).tolist()), tuple(box.max(axis=0).tolist())
            parts.append(Part(float(mine.mean()), float(weak[mine].mean()), *ends))
    furthest = float(texture.seen.distance(points / scale).max()) * scale
    return Support(float(weak.mean()), float(unseen.mean()), furthest, tuple(parts))


def spread_points(corners: Array, count: int, rng: np.random.Generator) -> tuple[Array, npt.NDArray[np.int64], Array]:
    """Random points (K, 3) of a surface, evenly by area, their faces (K,) and barycentric weights (K, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(first, second), axis=1)
    face = rng.choice(len(corners), count, p=area / area.sum())
    s, t = rng.uniform(size=(2, count))
    s, t = np.where(s + t > 1.0, 1.0 - s, s), np.where(s + t > 1.0, 1.0 - t, t)
    weight = np.stack([1.0 - s - t, s, t], axis=-1)
    return np.einsum("kc,kcd->kd", weight, corners[face]), face.astype(np.int64), weight


def _pieces(mesh: Mesh) -> npt.NDArray[np.int64]:
    """Number of the connected piece of each face, by places rather than vertices."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    _, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
    at = place.reshape(-1)[mesh.faces]
    rows, columns = at[:, [0, 1]].T.ravel(), at[:, [1, 2]].T.ravel()
    count = int(at.max()) + 1
    graph = coo_matrix((np.ones(len(rows), bool), (rows, columns)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    return np.asarray(label[at[:, 0]], np.int64)
