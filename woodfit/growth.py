"""Which way the tree grew: one consistent outward direction over the whole face.

`curved_gabor` says locally, and with doubt, on which side of a ring the abrupt edge brightens. Here the doubtful
places are settled by their neighbours, and the whole by geometry: rings are convex outwards, and on a face that
shows both sides of the tree the growth directions part at the pith.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import cg

from woodfit.photograph import thickness

FloatArray = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Growth:
    """Outward direction of growth on an image of shape (M, N).

    Attributes
    ----------
    direction : float32 array of shape (M, N)
        Outward direction in rad, image frame.
    bright_outwards : bool
        True where the abrupt edge brightens outwards (conifers); False where it darkens (ring-porous wood).
    sureness : float
        0.5 for a guess to 1 for certain.
    flux : float
        Mean outward flux per unit length of the wood's outline, -1..1: its sign decides `bright_outwards`.
    """

    direction: FloatArray
    bright_outwards: bool
    sureness: float
    flux: float


@dataclass(frozen=True)
class _Cells:
    """The face on a grid of half a ring: unit normals, bonds to eight neighbours, evidence for the normal's sign."""

    normal_x: FloatArray
    normal_y: FloatArray
    bonds: list[tuple[int, int, FloatArray]]
    asymmetry: FloatArray
    convexity: FloatArray
    strength: FloatArray


def _cells(
    normal: npt.NDArray[Any],
    asymmetry: npt.NDArray[Any],
    confidence: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    ring_scale_px: float,
) -> _Cells:
    height, width = normal.shape
    step = max(1, round(0.5 * ring_scale_px))
    size = (max(2, width // step), max(2, height // step))

    def shrink(a: npt.NDArray[Any]) -> FloatArray:
        return np.asarray(cv2.resize(a.astype(np.float32), size, interpolation=cv2.INTER_AREA), dtype=np.float32)

    # Orientation by doubled angle survives averaging over cells in which the sign flickers.
    base = np.asarray(normal, np.float32)
    weight = confidence * valid + 1e-4
    cos2, sin2 = shrink(weight * np.cos(2 * base)), shrink(weight * np.sin(2 * base))
    angle = 0.5 * np.arctan2(sin2, cos2)
    nx, ny = np.cos(angle), np.sin(angle)
    strength = shrink(weight)
    pad_x, pad_y, pad_w = (np.pad(a, 1) for a in (nx, ny, strength))
    rows, cols = nx.shape
    bonds = []
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            if (dy, dx) == (0, 0):
                continue
            part = (slice(1 + dy, 1 + dy + rows), slice(1 + dx, 1 + dx + cols))
            # Along a ring growth never turns round; across, it may, at the pith.
            length = math.hypot(dx, dy)
            # So sharply that cells on the diagonal of a ring are not of that ring.
            along = ((ny * dx - nx * dy) / length) ** 8
            parallel = nx * pad_x[part] + ny * pad_y[part]
            bonds.append((dy, dx, np.sqrt(strength * pad_w[part]) * parallel * (0.4 + 12.0 * along) / length))
    vx, vy = (shrink(weight * asymmetry * trig(base)) for trig in (np.cos, np.sin))
    cos2, sin2 = (np.asarray(cv2.GaussianBlur(a, (0, 0), 2.0), np.float32) for a in (cos2, sin2))
    turn_x = cos2 * cv2.Scharr(sin2, cv2.CV_32F, 1, 0) - sin2 * cv2.Scharr(cos2, cv2.CV_32F, 1, 0)
    turn_y = cos2 * cv2.Scharr(sin2, cv2.CV_32F, 0, 1) - sin2 * cv2.Scharr(cos2, cv2.CV_32F, 0, 1)
    # Turn of the normal per cell along the tangent (-ny, nx): positive where the normal points away from the centre.
    bend = (turn_y * nx - turn_x * ny) / (64.0 * np.maximum(cos2 * cos2 + sin2 * sin2, 1e-9))
    return _Cells(nx, ny, bonds, vx * nx + vy * ny, (strength * np.tanh(3.0 * bend)).astype(np.float32), strength)


#: How fast one area's verdict fades into its neighbours', across the rings: about one over the square of the reach in
#: cells. Along the rings it carries some two and a half times as far.
_FADING = 0.03


def _joined(cells: _Cells) -> csr_array:
    """Bonds between all cells (N, N): each of two neighbours measures along its own ring, their bond is the mean."""
    rows, cols = cells.asymmetry.shape
    number = np.arange(rows * cols).reshape(rows, cols)
    entries = []
    for dy, dx, bond in cells.bonds:
        here = (slice(max(0, -dy), rows - max(0, dy)), slice(max(0, -dx), cols - max(0, dx)))
        there = (slice(max(0, dy), rows - max(0, -dy)), slice(max(0, dx), cols - max(0, -dx)))
        entries.append((number[here].ravel(), number[there].ravel(), bond[here].ravel().astype(np.float64)))
    i, j, value = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    bonds = coo_array((value, (i, j)), shape=(rows * cols, rows * cols)).tocsr()
    return csr_array(0.5 * (bonds + bonds.T))


def _settle(cells: _Cells, bonds: csr_array, evidence: Sequence[FloatArray]) -> list[npt.NDArray[np.float64]]:
    """Evidence spread over the bonds: the sign of each result is the verdict of a cell's whole surroundings.

    The relaxed Ising model: minimises the weighted squared differences between neighbours (turned where their normals
    oppose) with a weak pull to zero, driven by the evidence. Convex, so no wall can be left standing by accident.
    """
    diagonal = np.asarray(abs(bonds).sum(axis=1)).ravel() + _FADING * cells.strength.ravel() + 1e-6
    matrix = diags_array(diagonal) - bonds
    scale = diags_array(1.0 / diagonal)
    solved = [cg(matrix, e.ravel().astype(np.float64), rtol=1e-5, maxiter=2000, M=scale)[0] for e in evidence]
    return [x.reshape(cells.asymmetry.shape) for x in solved]


def _without_tears(bonds: csr_array, spin: npt.NDArray[Any], evidence: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Spins of which areas are turned that cost more at the rings they tear than the evidence within them says.

    The relaxed model gives way to the evidence of a faint area, although growth never turns round along a ring. Here
    the same energy is compared with whole spins: an area is one within which all bonds agree.
    """
    s, pull = np.asarray(spin, np.float64).ravel().copy(), np.asarray(evidence, np.float64).ravel()
    while True:
        kept = bonds.multiply(s[:, None]).multiply(s[None, :]).tocsr()
        count, area = connected_components(kept.maximum(0.0), directed=False)
        pairs = kept.tocoo()
        across = area[pairs.row] != area[pairs.col]
        cost = np.bincount(area[pairs.row[across]], pairs.data[across], count) + np.bincount(area, pull * s, count)
        # Of neighbours that both would gain the one that gains more is turned: turned together they might gain nothing.
        beside = np.zeros(count)
        np.minimum.at(beside, area[pairs.row[across]], cost[area[pairs.col[across]]])
        turned = cost < beside
        if count < 2 or not turned.any():
            return s.reshape(spin.shape)
        s[turned[area]] *= -1.0


def outward_flux(direction: npt.NDArray[Any], confidence: npt.NDArray[Any], ring_scale_px: float) -> float:
    """Confidence-weighted divergence of a direction field per unit length of outline, -1..1.

    Positive where the directions spread: convex rings, and the pith line at which two sides part.
    """
    step = max(1, round(0.5 * ring_scale_px))
    size = (max(3, direction.shape[1] // step), max(3, direction.shape[0] // step))

    def shrink(a: npt.NDArray[Any]) -> FloatArray:
        return np.asarray(cv2.resize(a.astype(np.float32), size, interpolation=cv2.INTER_AREA), dtype=np.float32)

    weight = shrink(confidence) + 1e-6
    gx, gy = shrink(confidence * np.cos(direction)) / weight, shrink(confidence * np.sin(direction)) / weight
    spread = 0.0
    for a, axis in ((gx, 1), (gy, 0)):
        ahead, behind = (slice(None), slice(1, None)), (slice(None), slice(None, -1))
        if axis == 0:
            ahead, behind = ahead[::-1], behind[::-1]
        spread += float(np.sum(np.sqrt(weight[ahead] * weight[behind]) * (a[ahead] - a[behind])))
    outline = 2.0 * (size[0] + size[1]) * float(weight.mean())
    return float(np.clip(spread / max(outline, 1e-9), -1.0, 1.0))


def find_growth(
    normal: npt.NDArray[Any],
    asymmetry: npt.NDArray[Any],
    confidence: npt.NDArray[Any],
    valid: npt.NDArray[np.bool_],
    ring_scale_px: float,
    bright_outwards: bool | None = None,
    pores: float = 0.0,
    along_stem: float = 0.0,
    pith: tuple[float, float] | None = None,
) -> Growth:
    """Outward direction of growth over a face.

    A relaxed Ising model on a grid of half a ring: each cell holds a sign relative to its normal. Evidence is the
    asymmetry of the profile and the convexity of the rings; neighbours agree, along a ring much more strongly than
    across. Whether edges brighten or darken outwards is settled by what agrees with the geometry and the texture.

    Parameters
    ----------
    normal, asymmetry, confidence : arrays of shape (M, N)
        From the curved Gabor filter: direction in rad, 0..1, 0..1.
    valid : bool array of shape (M, N)
        The wood.
    ring_scale_px : float
        Characteristic ring width in pixels of these arrays.
    bright_outwards : bool, optional
        The user's word on whether the abrupt edge brightens outwards; found when not given.
    pores : float
        From `woodfit.fine_texture.pore_evidence`: vessels make the abrupt edge the onset of dark pores.
    along_stem : float
        1 on faces along the stem, where rings wave and their bends say little; 0 on others.
    pith : x, y in pixels, optional
        Where rings close around the pith on the face: growth is then away from it, and only the kind of wood is open.

    Returns
    -------
    Growth
    """
    if pith is not None:
        return _around(pith, normal, asymmetry, confidence * valid, ring_scale_px, bright_outwards)
    cells = _cells(normal, asymmetry, confidence, valid, ring_scale_px)
    bonds = _joined(cells)
    bent, stepped = _settle(cells, bonds, (cells.convexity, cells.asymmetry))
    # How well the two kinds of evidence agree over the face, -1..1: convex rings against brightening edges.
    together = float((cells.convexity * stepped).sum())
    apart = float((cells.convexity * bent).sum()) * float((cells.asymmetry * stepped).sum())
    lead = together / max(math.sqrt(max(apart, 0.0)), 1e-12)
    # On a face that shows both sides of the tree the edges' directions part at the pith, or meet there.
    parting = outward_flux(_expand(cells, np.sign(stepped), normal), confidence * valid, ring_scale_px)
    bends = (1.5 - 1.1 * along_stem) * _turn(cells, valid, ring_scale_px) * lead
    vote = bends + 5.0 * parting + float(np.clip((pores + 0.8) / 0.3, -1.2, 1.2)) + 0.1
    # Conifer is the rule; geometry or pores must speak clearly against it.
    outwards = vote > 0.0 if bright_outwards is None else bright_outwards
    sureness = 0.5 + 0.5 * min(1.0, abs(vote) / 1.2) if bright_outwards is None else 1.0
    edges = 1.0 if outwards else -1.0
    agreed = edges * float((np.sign(bent) * cells.asymmetry).sum()) > 0.0
    one_sided = along_stem < 0.5 and agreed and _one_sided(cells, bent, valid, ring_scale_px)
    verdict = np.sign(bent if one_sided else bent + edges * stepped)
    if not one_sided:
        verdict = _without_tears(bonds, verdict, cells.convexity + edges * cells.asymmetry)
    direction = _expand(cells, verdict, normal)
    flux = outward_flux(direction, confidence * valid, ring_scale_px)
    return Growth(direction, outwards, float(sureness), flux)


def _around(
    pith: tuple[float, float],
    normal: npt.NDArray[Any],
    asymmetry: npt.NDArray[Any],
    confidence: npt.NDArray[Any],
    ring_scale_px: float,
    bright_outwards: bool | None,
) -> Growth:
    """Growth away from a pith that is seen."""
    base = np.asarray(normal, np.float32)
    away_x = np.arange(base.shape[1], dtype=np.float32)[None, :] - np.float32(pith[0])
    away_y = np.arange(base.shape[0], dtype=np.float32)[:, None] - np.float32(pith[1])
    outwards = away_x * np.cos(base) + away_y * np.sin(base)
    direction = np.where(outwards < 0.0, base + np.float32(np.pi), base)
    direction = np.arctan2(np.sin(direction), np.cos(direction)).astype(np.float32)
    # Normals point to the bright side of the abrupt edges: outwards in conifers.
    vote = float((confidence * asymmetry * np.sign(outwards)).sum() / max(float((confidence * asymmetry).sum()), 1e-12))
    bright = vote > 0.0 if bright_outwards is None else bright_outwards
    sureness = 1.0 if bright_outwards is not None else 0.5 + 0.5 * min(1.0, abs(vote) / 0.5)
    return Growth(direction, bright, sureness, outward_flux(direction, confidence, ring_scale_px))


def _turn(cells: _Cells, valid: npt.NDArray[np.bool_], ring_scale_px: float) -> float:
    """How far bends can be believed, 0..1: over the width of a core rings hardly turn, and what is left is noise."""
    # A ring is as long as the wood is thick.
    thick = thickness(valid)
    # Evidence is the tanh of three times the turn per cell.
    per_cell = float(np.abs(cells.convexity).sum()) / (3.0 * float(cells.strength.sum()))
    return min(1.0, per_cell * thick / max(1, round(0.5 * ring_scale_px)) / 0.15)


#: Turn in rad over the wood's thickness above which rings that bend to one side everywhere are no accident.
_ONE_SIDED = 0.15


def _one_sided(
    cells: _Cells, bent: npt.NDArray[np.float64], valid: npt.NDArray[np.bool_], ring_scale_px: float
) -> bool:
    """Whether the rings bend to one side all over the face: then no pith lies in it, and growth turns nowhere round.

    Where vessels are few or the wood is dull, the abrupt edge may seem to lie on the wrong side for rings on end.
    """
    spin = np.pad(np.sign(bent), 1)
    for dy, dx, bond in cells.bonds:
        rows, cols = bent.shape
        if (bond * spin[1:-1, 1:-1] * spin[1 + dy : 1 + dy + rows, 1 + dx : 1 + dx + cols] < -1e-3).any():
            return False
    thick = thickness(valid) / max(1, round(0.5 * ring_scale_px))
    turn = float((np.sign(bent) * cells.convexity).sum()) / (3.0 * float(cells.strength.sum())) * thick
    return turn > _ONE_SIDED


def _expand(cells: _Cells, spin: npt.NDArray[Any], normal: npt.NDArray[Any]) -> FloatArray:
    """Normals of shape (M, N) turned by 180 degrees where the spins of their cells say so."""
    height, width = normal.shape
    full_x, full_y = (
        cv2.resize((spin * n).astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
        for n in (cells.normal_x, cells.normal_y)
    )
    base = np.asarray(normal, np.float32)
    turned = np.where(full_x * np.cos(base) + full_y * np.sin(base) < 0.0, base + np.pi, base)
    return np.asarray(np.arctan2(np.sin(turned), np.cos(turned)), dtype=np.float32)
