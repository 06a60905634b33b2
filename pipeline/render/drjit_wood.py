"""The solid texture in Dr.Jit, evaluated by the renderer at the points that its rays hit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.render.drjit_grain import noise
from woodfit.shader_tables import Axis, tables_of

if TYPE_CHECKING:
    from woodfit import SolidTexture


class DrjitWood:
    """Wood at points of the board frame.

    Parameters
    ----------
    mi
        Mitsuba with a vectorised variant set.
    texture : SolidTexture
        The wood.
    detail : bool
        Whether the color has its fine grain.
    """

    def __init__(self, mi: Any, texture: SolidTexture, detail: bool = True) -> None:
        known = tables_of(texture)
        self.mi, self.known, self.detail = mi, known, detail
        self.displacement = mi.Float(known.displacement.ravel())
        self.ring_radius = mi.Float(known.ring_radius.astype(np.float32))
        self.strip = [mi.Float(np.ascontiguousarray(known.strip[:, channel])) for channel in range(4)]

    def __call__(self, point: Any) -> tuple[Any, Any, Any]:
        """Linear color (three Floats), lateness and ring age at points (a Point3f, board frame, the texture's unit)."""
        import drjit as dr

        mi, known = self.mi, self.known
        x, y, z = (point[axis] / known.pixel_size for axis in range(3))
        across_x, across_y, height = (
            x * axis[0] + y * axis[1] + z * axis[2] + shift
            for axis, shift in zip(known.axes.tolist(), known.origin.tolist(), strict=True)
        )
        bend_x, bend_y, taper = (float(part) for part in known.stem)
        across_x, across_y = across_x - bend_x * height * height, across_y - bend_y * height * height
        r = dr.sqrt(across_x * across_x + across_y * across_y) * dr.maximum(1.0 + taper * height, 0.05)
        azimuth = dr.atan2(across_y, across_x)
        radius = r + self.moved(r, azimuth, height)
        age = self.age(radius)
        red, green, blue, late = self.color(age)
        if self.detail and len(known.grain.kind):
            u = dr.maximum(radius - self.moved(r, azimuth, mi.Float(known.middle)), 0.0)
            factors = self.grain(u, azimuth, height, late)
            red, green, blue = red * factors[0], green * factors[1], blue * factors[2]
        return (red, green, blue), late, age + float(known.first_age)

    def moved(self, r: Any, azimuth: Any, height: Any) -> Any:
        """Displacement m, px."""
        import drjit as dr

        mi, known = self.mi, self.known
        ir, fr = self._cell(known.radius, r)
        ih, fh = self._cell(known.height, height)
        count = known.azimuth.count
        turn = float(count) if known.wraps else 2.0 * np.pi / known.azimuth.step
        place = (azimuth - known.azimuth.first) / known.azimuth.step
        place = place - turn * dr.floor(place / turn)
        last = count - 1.0
        if not known.wraps:
            place = dr.select(place > last, last + (place - last) / (turn - last), place)
        ia = dr.minimum(mi.Int32(place), count - 1)
        ja, fa = dr.select(ia + 1 == count, 0, ia + 1), place - mi.Float(ia)

        def column(i: Any, a: Any) -> Any:
            at = mi.UInt32((i * count + a) * known.height.count + ih)
            low, high = dr.gather(mi.Float, self.displacement, at), dr.gather(mi.Float, self.displacement, at + 1)
            return dr.lerp(low, high, fh)

        near = dr.lerp(column(ir, ia), column(ir, ja), fa)
        return dr.lerp(near, dr.lerp(column(ir + 1, ia), column(ir + 1, ja), fa), fr)

    def _cell(self, axis: Axis, value: Any) -> tuple[Any, Any]:
        import drjit as dr

        place = dr.clip((value - axis.first) / axis.step, 0.0, axis.count - 1.0)
        low = dr.minimum(self.mi.Int32(place), axis.count - 2)
        return low, place - self.mi.Float(low)

    def age(self, radius: Any) -> Any:
        """Ring age counted from the tables' first."""
        import drjit as dr

        mi, known = self.mi, self.known
        # Plain numbers: those of numpy would turn Dr.Jit's arrays into its own.
        table, count = known.ring_radius.tolist(), len(known.ring_radius)
        low = mi.UInt32(0)
        # Binary search with a fixed number of halvings, so that all lanes go the same way.
        step = 1 << max(0, (count - 1).bit_length() - 1)
        while step:
            on = low + step
            inside = on <= count - 2
            there = dr.gather(mi.Float, self.ring_radius, dr.minimum(on, count - 2))
            low = dr.select(inside & (there <= radius), on, low)
            step //= 2
        inner, outer = (dr.gather(mi.Float, self.ring_radius, low + one) for one in (0, 1))
        age = mi.Float(low) + (radius - inner) / (outer - inner)
        age = dr.select(radius >= table[-1], count - 1 + (radius - table[-1]) / known.mean_width, age)
        before = (radius - table[0]) / known.first_width if known.first_age else mi.Float(0.0)
        return dr.select(radius <= table[0], before, age)

    def color(self, age: Any) -> list[Any]:
        """Linear red, green, blue and lateness."""
        import drjit as dr

        mi, known = self.mi, self.known
        rings = known.strip_period / known.samples_per_ring
        age = dr.select(age < 0.0, age - rings * dr.floor(age / rings), age)
        place, end = dr.maximum(age * known.samples_per_ring - 0.5, 0.0), known.strip_size - 0.5
        over = place - end
        again = end + over - known.strip_period * dr.floor(over / known.strip_period)
        place = dr.select(over >= 0.0, again, place)
        low = dr.minimum(mi.UInt32(place), len(known.strip) - 2)
        part = place - mi.Float(low)
        return [dr.lerp(dr.gather(mi.Float, one, low), dr.gather(mi.Float, one, low + 1), part) for one in self.strip]

    def grain(self, u: Any, azimuth: Any, height: Any, late: Any) -> list[Any]:
        """Factors on red, green and blue."""
        import drjit as dr

        mi, grain = self.mi, self.known.grain
        total = [mi.Float(0.0)] * 3
        for k, kind in enumerate(grain.kind):
            early, latewood = (float(part) for part in grain.amplitude[k])
            value = noise(
                mi, int(kind), grain.cells[k], float(grain.density[k]), int(grain.seed[k]), u, azimuth, height
            )
            value = value * (early + late * (latewood - early))
            total = [part + value * float(share) for part, share in zip(total, grain.color[k], strict=True)]
        place = dr.clip(late, 0.0, 1.0) * 4.0
        for channel in range(3):
            table = grain.log_mean[:, channel]
            mean = mi.Float(float(table[0]))
            # A broken line as a sum of ramps: no look-up.
            for low in range(4):
                mean += float(table[low + 1] - table[low]) * dr.clip(place - low, 0.0, 1.0)
            total[channel] = dr.exp(total[channel] - mean)
        return total
