"""Ring tracing: ring boundaries as polylines on the true latewood edge, numbered outwards."""

from __future__ import annotations

import numpy as np
import xarray as xr
from pydantic import Field, NonNegativeFloat, PositiveFloat

from stages.stage import InputFile, Params, place_in_array, scalar, stage
from stages.variables import (
    ASYMMETRY,
    BRIGHT_OUTWARDS,
    CORRECTED_ABSENT_X,
    CORRECTED_ABSENT_Y,
    CORRECTED_LATEWOOD_X,
    CORRECTED_LATEWOOD_Y,
    EXPLAINED,
    FACE_PITH_X,
    FACE_PITH_Y,
    FREQUENCY,
    GRAIN_RATIO,
    GROWTH_ANGLE,
    GROWTH_SURENESS,
    NORMAL,
    PHASE_CONFIDENCE,
    REDUCTION,
    RESPONSE,
    RING_CLOSED,
    RING_CONFIDENCE,
    RING_COUNT_FIGURE,
    RING_GROUP,
    RING_INDEX,
    RING_ORIENTATION,
    RING_PHASE,
    RING_SCALE,
    RING_X,
    RING_Y,
    VALID,
    VALUE,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
    VESSEL_SCALE,
)


class RingTracingParams(Params):
    """Parameters of `ring_tracing`."""

    bright_outwards: bool | None = None
    """Whether the abrupt edge of a ring brightens outwards (true for conifers); found when not given."""

    seed_confidence: float = Field(default=0.3, ge=0.0, le=1.0)
    """Confidence of the phase at which a trace may start."""

    floor_confidence: float = Field(default=0.1, ge=0.0, le=1.0)
    """Confidence below which a trace keeps its heading instead of following the phase."""

    max_gap_rings: NonNegativeFloat = 1.5
    """How far a trace carries on without confidence, in local ring widths."""

    shortest_rings: PositiveFloat = 2.0
    """Shortest trace kept, in local ring widths."""

    corrected: tuple[InputFile, ...] = ()
    """Files in which a person marked boundaries along paths: CooRecorder's .pos, or a table of boundaries."""


@stage(
    requires=(
        VALUE,
        VALID,
        RESPONSE,
        EXPLAINED,
        NORMAL,
        ASYMMETRY,
        FREQUENCY,
        RING_ORIENTATION,
        RING_SCALE,
        REDUCTION,
        VESSEL_SCALE,
        FACE_PITH_X,
        FACE_PITH_Y,
    ),
    provides=(
        RING_X,
        RING_Y,
        VERTEX_CONFIDENCE,
        VERTEX_COUNT,
        RING_INDEX,
        RING_GROUP,
        RING_CONFIDENCE,
        RING_CLOSED,
        RING_PHASE,
        PHASE_CONFIDENCE,
        GROWTH_ANGLE,
        BRIGHT_OUTWARDS,
        GROWTH_SURENESS,
        GRAIN_RATIO,
        CORRECTED_LATEWOOD_X,
        CORRECTED_LATEWOOD_Y,
        CORRECTED_ABSENT_X,
        CORRECTED_ABSENT_Y,
    ),
    version=14,
    params=RingTracingParams,
)
def ring_tracing(ds: xr.Dataset, params: RingTracingParams) -> xr.Dataset:
    """Trace the ring boundaries, move them onto their edges and number them outwards."""
    from woodfit import correction, rings
    from woodfit.dendro.marked_files import read_marked_paths

    step = scalar(ds, REDUCTION)
    found = rings.find_rings(
        ds[VALUE.name].values,
        ds[VALID.name].values,
        ds[RESPONSE.name].values,
        ds[EXPLAINED.name].values,
        ds[NORMAL.name].values,
        ds[ASYMMETRY.name].values,
        ds[FREQUENCY.name].values * step,
        ds[RING_ORIENTATION.name].values,
        scalar(ds, RING_SCALE) / step,
        bright_outwards=params.bright_outwards,
        seed_confidence=params.seed_confidence,
        floor_confidence=params.floor_confidence,
        max_gap_rings=params.max_gap_rings,
        shortest_rings=params.shortest_rings,
        vessels=scalar(ds, VESSEL_SCALE) > 0,
        pith=place_in_array(ds, FACE_PITH_X, FACE_PITH_Y),
    )
    origin = [float(ds.coords[name][0]) if name in ds.coords else 0.0 for name in ("x", "y")]
    marked = [path for file in params.corrected for path in read_marked_paths(file.text, file.name)]
    corrected = correction.apply_corrections(
        found,
        [path.scaled(origin, step) for path in marked],
        ds[VALID.name].values,
        ds[FREQUENCY.name].values * step,
    )
    found = corrected.rings
    points, belief, counts = rings.ragged(found.traces)
    vertex_count = VERTEX_COUNT.array(counts)
    # The CF convention's mark of a contiguous ragged array.
    vertex_count.attrs["sample_dimension"] = "vertex"
    image = ("y", "x")
    coords = {name: ds.coords[name] for name in image if name in ds.coords}
    return xr.Dataset(
        {
            RING_X.name: RING_X.array(points[:, 0] * step + origin[0]),
            RING_Y.name: RING_Y.array(points[:, 1] * step + origin[1]),
            VERTEX_CONFIDENCE.name: VERTEX_CONFIDENCE.array(belief),
            VERTEX_COUNT.name: vertex_count,
            RING_INDEX.name: RING_INDEX.array(found.order.index),
            RING_GROUP.name: RING_GROUP.array(found.order.group),
            RING_CONFIDENCE.name: RING_CONFIDENCE.array(np.maximum(rings.ring_confidence(found), corrected.certain)),
            RING_CLOSED.name: RING_CLOSED.array(np.array([t.closed for t in found.traces], bool)),
            RING_PHASE.name: RING_PHASE.array(found.phase),
            PHASE_CONFIDENCE.name: PHASE_CONFIDENCE.array(found.confidence),
            GROWTH_ANGLE.name: GROWTH_ANGLE.array(found.growth.direction),
            BRIGHT_OUTWARDS.name: BRIGHT_OUTWARDS.array(np.bool_(found.growth.bright_outwards)),
            GROWTH_SURENESS.name: GROWTH_SURENESS.array(np.float64(found.growth.sureness)),
            GRAIN_RATIO.name: GRAIN_RATIO.array(np.float64(found.grain_ratio)),
            CORRECTED_LATEWOOD_X.name: CORRECTED_LATEWOOD_X.array(corrected.latewood[:, 0] * step + origin[0]),
            CORRECTED_LATEWOOD_Y.name: CORRECTED_LATEWOOD_Y.array(corrected.latewood[:, 1] * step + origin[1]),
            CORRECTED_ABSENT_X.name: CORRECTED_ABSENT_X.array(corrected.absent[:, 0] * step + origin[0]),
            CORRECTED_ABSENT_Y.name: CORRECTED_ABSENT_Y.array(corrected.absent[:, 1] * step + origin[1]),
        },
        coords=coords,
        attrs={
            "warnings": [*rings.describe_doubt(found), *corrected.notes],
            "figures": {
                RING_COUNT_FIGURE: len(np.unique(np.stack([found.order.group, found.order.index]), axis=1).T),
                "polylines": len(found.traces),
                "doubtful polylines (confidence under 0.9)": int((rings.ring_confidence(found) < 0.9).sum()),
                **corrected.figures,
                "growth sureness": round(found.growth.sureness, 2),
                "wood": "brightens outwards (conifer-like)"
                if found.growth.bright_outwards
                else "darkens outwards (ring-porous-like)",
            },
        },
    )
