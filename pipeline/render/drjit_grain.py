"""Fine grain in Dr.Jit: woodfit/fine_grain_noise.py over the renderer's arrays; `mi` is Mitsuba, its variant set."""

from __future__ import annotations

from typing import Any

from woodfit.fine_grain_noise import FIBRE, PORE, RAY


def hashed(mi: Any, i: Any, j: Any, k: Any, seed: Any) -> Any:
    """32 mixed bits of three Int32 and a UInt32."""
    word = mi.UInt32
    bits = (word(i) * word(0x9E3779B1)) ^ (word(j) * word(0x85EBCA77)) ^ (word(k) * word(0xC2B2AE3D)) ^ seed
    bits = (bits ^ (bits >> 16)) * word(0x85EBCA6B)
    bits = (bits ^ (bits >> 13)) * word(0xC2B2AE35)
    return bits ^ (bits >> 16)


def around(mi: Any, number: Any, period: Any) -> Any:
    """Cell number on an axis that closes; `period` is None for one that does not."""
    import drjit as dr

    if period is None:
        return number
    rest = number % period
    return dr.select(rest < 0, rest + period, rest)


def impulses(mi: Any, cell: Any, place: Any, reach: float, period: Any, density: float, seed: Any) -> Any:
    """What a column of cells (i, j) gives at (p, q, a); in cells."""
    import drjit as dr

    (i, j), (p, q, a) = cell, place
    along = a + mi.Float(hashed(mi, i, j, mi.Int32(7919), seed) & 0xFFFFFF) / 16777216.0
    low = dr.floor(along)
    part = along - low
    later = part * part * (3.0 - 2.0 * part)
    total = mi.Float(0.0)
    for end in range(2):
        bits = hashed(mi, i, j, around(mi, mi.Int32(low) + end, period), seed + mi.UInt32(0xC2B2AE3D))
        dx = p - mi.Float(bits & 0x7FF) / 2048.0
        dy = q - 0.5 - (mi.Float((bits >> 11) & 0x7FF) / 2048.0 - 0.5) * (2.0 * reach - 1.0)
        near = dr.maximum(reach * reach - dx * dx - dy * dy, 0.0)
        chance = mi.Float(bits >> 22) / 1024.0
        depth = dr.select(chance < density, -1.0, 0.0) if density > 0.0 else 2.0 * chance - 1.0
        total += (later if end else 1.0 - later) * depth * near * near
    return total


def columns(mi: Any, place: Any, period_p: Any, period_a: Any, seed: Any) -> Any:
    """Signed noise, see `woodfit.fine_grain_noise`."""
    import drjit as dr

    p, q, a = place
    first, total = mi.Int32(dr.floor(p - 0.75)), mi.Float(0.0)
    # Three columns reach a place at most; where it is two, the third gives nothing.
    for step in range(3):
        i = first + step
        row = around(mi, i, period_p)
        across = q + mi.Float(hashed(mi, row, mi.Int32(104729), mi.Int32(7919), seed) & 0xFFFFFF) / 16777216.0
        above = mi.Int32(dr.floor(across - 0.5))
        for j in (above, above + 1):
            own = (p - mi.Float(i), across - mi.Float(j), a)
            total += impulses(mi, (row, j), own, 0.75, period_a, 0.0, seed)
    return 10.0 * total


def pores(mi: Any, place: Any, density: float, seed: Any) -> Any:
    """Dark impulses in a share of the cells."""
    import drjit as dr

    p, q, a = place
    ip, iq, total = mi.Int32(dr.floor(p)), mi.Int32(dr.floor(q)), mi.Float(0.0)
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            i, j = ip + di, iq + dj
            total += impulses(mi, (i, j), (p - mi.Float(i), q - mi.Float(j), a), 1.0, None, density, seed)
    return total


def noise(mi: Any, kind: int, cells: Any, density: float, seed: int, radius: Any, azimuth: Any, height: Any) -> Any:
    """One noise at places in the tree, px and rad."""
    import drjit as dr

    c0, c1, c2 = (float(cell) for cell in cells)
    if kind in (FIBRE, PORE):
        place = (radius * dr.cos(azimuth) / c0, radius * dr.sin(azimuth) / c1, height / c2)
        if kind == FIBRE:
            return columns(mi, place, None, None, mi.UInt32(seed))
        return pores(mi, place, density, mi.UInt32(seed))
    turn = azimuth / (2.0 * dr.pi)
    turn = turn - dr.floor(turn)
    arc = c0 if kind == RAY else c2
    level = dr.log2(dr.maximum(2.0 * dr.pi * radius / (8.0 * arc), 1.0))
    whole = dr.floor(level)
    part, sectors = level - whole, mi.Int32(8.0 * dr.exp2(whole) + 0.5)
    total = mi.Float(0.0)
    for end in range(2):
        fade = dr.sin(0.5 * dr.pi * part) if end else dr.cos(0.5 * dr.pi * part)
        own, place = mi.UInt32(seed) + mi.UInt32(sectors), turn * mi.Float(sectors)
        if kind == RAY:
            value = columns(mi, (place, height / c1, radius / c2), sectors, None, own)
        else:
            value = columns(mi, (radius / c0, height / c1, place), None, sectors, own)
        total += fade * value
        sectors = sectors * 2
    return total
