"""From texels of a UV atlas to points of a surface, and the maps of a solid texture on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import distance_transform_edt

from woodfit.appearance import SATIN, Finish
from woodfit.srgb import srgb_bytes

if TYPE_CHECKING:
    from woodfit.solid_texture import SolidTexture

Array = npt.NDArray[Any]
Bytes = npt.NDArray[np.uint8]

#: Texels beyond a chart's border whose wood is evaluated on the surface continued, so that bilinear look-ups at the
#: border see the same wood from both sides.
_BORDER = 1.5

#: Texels evaluated at a time.
_BATCH = 1 << 18


@dataclass(frozen=True)
class Texels:
    """Texels that show a surface.

    Attributes
    ----------
    triangle : int32 array of shape (N, N)
        Which triangle each texel shows, -1 for none. Row 0 is at v = 1, as images are stored.
    weight : float32 array of shape (N, N, 2)
        Barycentric weights of the triangle's second and third corner at the texel's centre; a little outside of 0..1
        beyond a chart's border.
    """

    triangle: npt.NDArray[np.int32]
    weight: npt.NDArray[np.float32]

    def points(self, rows: slice, corners: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Points (K, 3) of the texels in some rows that show something, and which do; corners of shape (F, 3, 3)."""
        shown = self.triangle[rows] >= 0
        which, part = self.triangle[rows][shown], self.weight[rows][shown].astype(np.float64)
        a, b, c = corners[which].transpose(1, 0, 2)
        return a + part[:, :1] * (b - a) + part[:, 1:] * (c - a), shown


@dataclass(frozen=True)
class Maps:
    """What a surface shows, N x N texels.

    Attributes
    ----------
    color : uint8 array of shape (N, N, 3)
        sRGB.
    roughness : uint8 array of shape (N, N)
        Linear, 255 is 1.
    height : uint16 array of shape (N, N)
        Displacement outwards; 65535 is `height_scale`.
    height_scale : float
        In `SolidTexture.unit`.
    normal : uint8 array of shape (N, N, 3)
        Tangent space, y up (OpenGL, glTF).
    """

    color: Bytes
    roughness: Bytes
    height: npt.NDArray[np.uint16]
    height_scale: float
    normal: Bytes


def rasterize(uv: Array, size: int) -> Texels:
    """Texels of an atlas that triangles cover, and a border around them.

    Parameters
    ----------
    uv : array of shape (F, 3, 2)
        Corners of the triangles; v up, inside of 0..1.
    size : int
        Texels along a side.
    """
    places = np.ascontiguousarray(uv, np.float64) * size
    places[..., 1] = size - places[..., 1]
    triangle = np.full((size, size), -1, np.int32)
    weight = np.zeros((size, size, 2), np.float32)
    _rasterize(places - 0.5, size, _BORDER, triangle, weight, np.full((size, size), np.inf, np.float32))
    return Texels(triangle, weight)


@njit(cache=True)
def _rasterize(places: Array, size: int, border: float, triangle: Array, weight: Array, off: Array) -> None:
    for number in range(places.shape[0]):
        ax, ay = places[number, 0]
        bx, by = places[number, 1, 0] - ax, places[number, 1, 1] - ay
        cx, cy = places[number, 2, 0] - ax, places[number, 2, 1] - ay
        area = bx * cy - by * cx
        if abs(area) < 1e-12:
            continue
        low_x = max(0, int(np.ceil(ax + min(0.0, bx, cx) - border)))
        high_x = min(size - 1, int(np.floor(ax + max(0.0, bx, cx) + border)))
        low_y = max(0, int(np.ceil(ay + min(0.0, by, cy) - border)))
        high_y = min(size - 1, int(np.floor(ay + max(0.0, by, cy) + border)))
        for y in range(low_y, high_y + 1):
            for x in range(low_x, high_x + 1):
                px, py = x - ax, y - ay
                s, t = (px * cy - py * cx) / area, (bx * py - by * px) / area
                if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
                    distance = 0.0
                else:
                    distance = min(
                        _from_edge(px, py, 0.0, 0.0, bx, by),
                        _from_edge(px, py, 0.0, 0.0, cx, cy),
                        _from_edge(px, py, bx, by, cx, cy),
                    )
                if distance <= border and distance < off[y, x]:
                    off[y, x] = distance
                    triangle[y, x] = number
                    weight[y, x, 0], weight[y, x, 1] = s, t


@njit(cache=True, inline="always")
def _from_edge(px: Any, py: Any, ax: Any, ay: Any, bx: Any, by: Any) -> Any:
    """Distance of a point from an edge between two others."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    part = ((px - ax) * dx + (py - ay) * dy) / square if square > 0.0 else 0.0
    part = min(1.0, max(0.0, part))
    return np.hypot(px - ax - part * dx, py - ay - part * dy)


def bake(
    texture: SolidTexture, corners: Array, uv: Array, size: int, detail: bool = True, finish: Finish = SATIN
) -> Maps:
    """Maps of a surface cut from a texture.

    Parameters
    ----------
    texture : SolidTexture
        The wood.
    corners : array of shape (F, 3, 3)
        Corners of the triangles, board frame, `texture.unit`; counter-clockwise from outside.
    uv : array of shape (F, 3, 2)
        Their texture coordinates, v up.
    size : int
        Texels along a side.
    detail : bool
        Whether the color has its fine grain.
    finish : Finish
        Roughness and relief.

    Returns
    -------
    Maps
        Texels of no triangle repeat the nearest that shows one.

    Raises
    ------
    ValueError
        When no texel shows anything.
    """
    texels = rasterize(uv, size)
    if not (texels.triangle >= 0).any():
        raise ValueError("the texture coordinates cover no texel")
    tangents, steps = _tangents(corners, uv, size)
    color, roughness = np.zeros((size, size, 3), np.uint8), np.zeros((size, size), np.uint8)
    height, normal = np.zeros((size, size), np.uint16), np.zeros((size, size, 3), np.uint8)
    scale = float(finish.relief * texture.ring_width)
    rows = max(1, _BATCH // size)
    for top in range(0, size, rows):
        part = slice(top, min(size, top + rows))
        points, shown = texels.points(part, corners)
        if not len(points):
            continue
        wood = texture.evaluate(points, detail)
        which = texels.triangle[part][shown]
        here = finish.height(wood.lateness, texture.ring_width)
        slopes = []
        for axis in range(2):
            aside = points + steps[which, None] * tangents[which, axis]
            there = finish.height(texture.evaluate(aside, False).lateness, texture.ring_width)
            slopes.append((there - here) / steps[which])
        bump = np.stack([-slopes[0], -slopes[1], np.ones(len(points))], axis=-1)
        bump /= np.linalg.norm(bump, axis=1, keepdims=True)
        color[part][shown] = srgb_bytes(wood.rgb)
        roughness[part][shown] = np.round(255.0 * finish.roughness(wood.lateness)).astype(np.uint8)
        height[part][shown] = np.round(65535.0 * here / scale).astype(np.uint16) if scale > 0.0 else 0
        normal[part][shown] = np.round(127.5 + 127.5 * bump).astype(np.uint8)
    nearest = distance_transform_edt(texels.triangle < 0, return_distances=False, return_indices=True)
    y, x = nearest
    return Maps(color[y, x], roughness[y, x], height[y, x], scale, normal[y, x])


def _tangents(corners: Array, uv: Array, size: int) -> tuple[Array, Array]:
    """Unit vectors along u and v on each triangle, (F, 2, 3), and about the length of a texel on it, (F,)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    du, dv = (uv[:, 1:, axis] - uv[:, :1, axis] for axis in range(2))
    area = du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0]
    safe = np.where(np.abs(area) < 1e-20, 1.0, area)[:, None]
    along_u = (dv[:, 1:] * first - dv[:, :1] * second) / safe
    along_v = (du[:, :1] * second - du[:, 1:] * first) / safe
    lengths = np.linalg.norm(np.stack([along_u, along_v], axis=1), axis=-1)
    tangents = np.stack([along_u, along_v], axis=1) / np.maximum(lengths, 1e-20)[..., None]
    return tangents, np.maximum(np.sqrt(lengths[:, 0] * lengths[:, 1]) / size, 1e-9)


def sample_map(image: Array, uv: Array) -> npt.NDArray[np.float64]:
    """Bilinear look-up of an image (N, N, C) at texture coordinates (K, 2), v up, as a renderer does it; (K, C)."""
    size = image.shape[0]
    x = np.clip(uv[:, 0] * size - 0.5, 0.0, size - 1.0)
    y = np.clip((1.0 - uv[:, 1]) * size - 0.5, 0.0, size - 1.0)
    i, j = np.minimum(y.astype(int), size - 2), np.minimum(x.astype(int), size - 2)
    fy, fx = (y - i)[:, None], (x - j)[:, None]
    upper = image[i, j] * (1.0 - fx) + image[i, j + 1] * fx
    lower = image[i + 1, j] * (1.0 - fx) + image[i + 1, j + 1] * fx
    return np.asarray(upper * (1.0 - fy) + lower * fy)
