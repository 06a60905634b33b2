"""The solid texture evaluated from its shader tables in plain Python, one point at a time: what a shader must do.

Slow and obvious. 32-bit integers as every shading language has them; no numba, no vectorisation.
"""

import math

import numpy as np

from woodfit.shader_tables import Axis, ShaderTables

FIBRE, PORE, RAY, LAYER = 0, 1, 2, 3
MASK = 0xFFFFFFFF


def color_at(tables: ShaderTables, point: np.ndarray, detail: bool = True) -> tuple[float, float, np.ndarray]:
    """Ring age, lateness and linear rgb at one point of the board frame, in `tables.unit`."""
    tree = tables.axes @ (np.asarray(point, float) / tables.pixel_size) + tables.origin
    bend_x, bend_y, taper = tables.stem
    x, y, height = tree[0] - bend_x * tree[2] ** 2, tree[1] - bend_y * tree[2] ** 2, tree[2]
    r, azimuth = math.hypot(x, y) * max(1.0 + taper * height, 0.05), math.atan2(y, x)
    radius = r + moved(tables, r, azimuth, height)
    age = age_of(tables, radius)
    rgb, late = strip_at(tables, age)
    if detail and len(tables.grain.kind):
        u = max(radius - moved(tables, r, azimuth, tables.middle), 0.0)
        rgb = rgb * np.exp(grain_at(tables, u, azimuth, height, late))
    return age + tables.first_age, late, rgb


def moved(tables: ShaderTables, r: float, azimuth: float, height: float) -> float:
    ir, fr = cell(tables.radius, r)
    ih, fh = cell(tables.height, height)
    ia, ja, fa = cell_around(tables.azimuth, azimuth, tables.wraps)
    field = tables.displacement

    def along(i: int, a: int) -> float:
        return float(field[i, a, ih] * (1 - fh) + field[i, a, ih + 1] * fh)

    near = along(ir, ia) * (1 - fa) + along(ir, ja) * fa
    far = along(ir + 1, ia) * (1 - fa) + along(ir + 1, ja) * fa
    return near * (1 - fr) + far * fr


def cell(axis: Axis, value: float) -> tuple[int, float]:
    place = min(max((value - axis.first) / axis.step, 0.0), axis.count - 1.0)
    low = min(int(place), axis.count - 2)
    return low, place - low


def cell_around(axis: Axis, azimuth: float, wraps: bool) -> tuple[int, int, float]:
    turn = axis.count if wraps else 2 * math.pi / axis.step
    place = ((azimuth - axis.first) / axis.step) % turn
    last = axis.count - 1
    if not wraps and place > last:
        return last, 0, (place - last) / (turn - last)
    low = min(int(place), last)
    return low, (low + 1) % axis.count, place - low


def age_of(tables: ShaderTables, radius: float) -> float:
    table = tables.ring_radius
    if radius >= table[-1]:
        return len(table) - 1 + (radius - table[-1]) / tables.mean_width
    if radius <= table[0]:
        return (radius - table[0]) / tables.first_width if tables.first_age else 0.0
    low = int(np.searchsorted(table, radius, side="right")) - 1
    return float(low + (radius - table[low]) / (table[low + 1] - table[low]))


def strip_at(tables: ShaderTables, age: float) -> tuple[np.ndarray, float]:
    if age < 0.0:
        age %= tables.strip_period / tables.samples_per_ring
    place = max(age * tables.samples_per_ring - 0.5, 0.0)
    end = tables.strip_size - 0.5
    if place >= end:
        place = end + (place - end) % tables.strip_period
    low = int(place)
    value = tables.strip[low] + (tables.strip[low + 1] - tables.strip[low]) * (place - low)
    return value[:3].astype(float), float(value[3])


def grain_at(tables: ShaderTables, radius: float, azimuth: float, height: float, late: float) -> np.ndarray:
    grain = tables.grain
    x, y, turn = radius * math.cos(azimuth), radius * math.sin(azimuth), (azimuth / (2 * math.pi)) % 1.0
    total = np.zeros(3)
    for k, kind in enumerate(grain.kind):
        strength = grain.amplitude[k, 0] + late * (grain.amplitude[k, 1] - grain.amplitude[k, 0])
        c, seed, density = grain.cells[k], int(grain.seed[k]), float(grain.density[k])
        if kind == FIBRE:
            value = columns(x / c[0], y / c[1], height / c[2], 0, 0, seed)
        elif kind == PORE:
            value = pores(x / c[0], y / c[1], height / c[2], density, seed)
        else:
            around, part = sectors(2 * math.pi * radius / (c[0] if kind == RAY else c[2]))
            value = 0.0
            for end in (0, 1):
                fade = math.sin(0.5 * math.pi * part) if end else math.cos(0.5 * math.pi * part)
                if kind == RAY:
                    one = columns(turn * around, height / c[1], radius / c[2], around, 0, (seed + around) & MASK)
                else:
                    one = columns(radius / c[0], height / c[1], turn * around, 0, around, (seed + around) & MASK)
                value += fade * one
                around *= 2
        total += strength * value * grain.color[k]
    place = min(max(late, 0.0), 1.0) * 4
    low = min(int(place), 3)
    return total - (grain.log_mean[low] * (1 - (place - low)) + grain.log_mean[low + 1] * (place - low))


def sectors(circumference: float) -> tuple[int, float]:
    level = math.log2(max(circumference / 8.0, 1.0))
    return 8 * 2 ** int(level), level - int(level)


def columns(p: float, q: float, a: float, period_p: int, period_a: int, seed: int) -> float:
    total = 0.0
    for i in range(math.floor(p - 0.75), math.floor(p + 0.75) + 1):
        row = i % period_p if period_p else i
        place = q + (hashed(row, 104729, 7919, seed) & 0xFFFFFF) / 2**24
        above = math.floor(place - 0.5)
        for j in (above, above + 1):
            total += impulses(row, j, a, p - i, place - j, 0.75, period_a, 0.0, seed)
    return 10.0 * total


def pores(p: float, q: float, a: float, density: float, seed: int) -> float:
    ip, iq = math.floor(p), math.floor(q)
    return sum(
        impulses(i, j, a, p - i, q - j, 1.0, 0, density, seed)
        for i in (ip - 1, ip, ip + 1)
        for j in (iq - 1, iq, iq + 1)
    )


def impulses(
    i: int, j: int, a: float, p: float, q: float, reach: float, period: int, density: float, seed: int
) -> float:
    step = a + (hashed(i, j, 7919, seed) & 0xFFFFFF) / 2**24
    k = math.floor(step)
    later = (step - k) ** 2 * (3 - 2 * (step - k))
    total = 0.0
    for end in (0, 1):
        number = (k + end) % period if period else k + end
        bits = hashed(i, j, number, (seed + 0xC2B2AE3D) & MASK)
        dx = p - (bits & 0x7FF) / 2048
        dy = q - 0.5 - ((bits >> 11 & 0x7FF) / 2048 - 0.5) * (2 * reach - 1)
        near = reach * reach - dx * dx - dy * dy
        if near > 0:
            chance = (bits >> 22) / 1024
            depth = (-1.0 if chance < density else 0.0) if density > 0 else 2 * chance - 1
            total += (later if end else 1 - later) * depth * near * near
    return total


def hashed(i: int, j: int, k: int, seed: int) -> int:
    bits = (i * 0x9E3779B1 ^ j * 0x85EBCA77 ^ k * 0xC2B2AE3D ^ seed) & MASK
    bits = ((bits ^ bits >> 16) * 0x85EBCA6B) & MASK
    bits = ((bits ^ bits >> 13) * 0xC2B2AE35) & MASK
    return bits ^ bits >> 16
