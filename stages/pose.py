"""Pose: where in the tree the board was."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from pydantic import Field, PositiveFloat

from stages.polylines import planes_of, polylines_of, vertex_weights
from stages.stage import Params, scalar, stage
from stages.variables import (
    ANOMALY,
    BOARD_TO_TREE,
    FACE_PLANE,
    FACE_TOP,
    GRAIN_RATIO,
    INNERMOST_AGE,
    POSE_SPREAD,
    POSE_UNDETERMINED,
    RGB,
    RING_AGE_SHIFT,
    RING_AGE_SIGN,
    RING_GROUP,
    RING_INDEX,
    RING_RADIUS,
    RING_SCALE,
    RING_WIDTH,
    RING_X,
    RING_Y,
    STEM,
    VALID,
    VERTEX_CONFIDENCE,
    VERTEX_COUNT,
)

if TYPE_CHECKING:
    from woodfit.face_ties import Ties
    from woodfit.planes import Planes

Array = npt.NDArray[Any]


class PoseParams(Params):
    """Parameters of `pose`."""

    pith_side: Literal["behind", "before"] = "behind"
    """On which side of the photographed face the pith lies at the face's centre; a single photograph cannot tell."""

    narrowest_share: PositiveFloat = 0.25
    """Least width of a ring across the growth layers, as a share of the mean width."""

    pith_x_px: float | None = None
    """x of the pith line's point nearest to the face's centre, scan px; with y and z overrules the fit."""

    pith_y_px: float | None = None
    """y of that point, scan px."""

    pith_z_px: float | None = None
    """z of that point, scan px into the wood."""

    pith_tilt_deg: float | None = Field(default=None, ge=0.0, le=90.0)
    """Angle between the pith and the face's normal: 0 on end grain, 90 on a face along the stem."""

    pith_azimuth_deg: float | None = None
    """Direction in the face towards which the pith leans, from +x towards +y."""

    ring_width_px: PositiveFloat | None = None
    """Mean ring width across the growth layers where it is known, scan px; decides the distance of the pith."""

    stem: Literal["straight", "auto"] = "straight"
    """Whether the pith may bend slowly and the stem taper, where the face shows it."""

    bend_x_per_px: float | None = None
    """Bend of the pith along tree x (outwards at the face's centre): offset over squared height, 1/px."""

    bend_y_per_px: float | None = None
    """Bend along tree y, 1/px."""

    taper_per_px: float | None = None
    """Relative growth of the radius that a ring would have in a cylinder, per px of height."""


@stage(
    requires=(
        FACE_PLANE,
        FACE_TOP,
        RGB,
        VALID,
        ANOMALY,
        RING_X,
        RING_Y,
        VERTEX_CONFIDENCE,
        VERTEX_COUNT,
        RING_INDEX,
        RING_GROUP,
        GRAIN_RATIO,
        RING_SCALE,
    ),
    provides=(
        BOARD_TO_TREE,
        INNERMOST_AGE,
        RING_RADIUS,
        RING_AGE_SIGN,
        RING_AGE_SHIFT,
        RING_WIDTH,
        POSE_SPREAD,
        POSE_UNDETERMINED,
        STEM,
    ),
    version=7,
    params=PoseParams,
    sees_block=True,
)
def pose(ds: xr.Dataset, params: PoseParams) -> xr.Dataset:
    """Fit the pith line that makes the traced rings round and their widths regular."""
    from woodfit import fiber, pith, pith_energy, pith_stem, pose_story
    from woodfit.ring_radii import ring_radii

    lines, _ = polylines_of(ds)
    belief = np.split(vertex_weights(ds), np.cumsum([len(line) for line in lines])[:-1]) if lines else []
    # A face alone is fitted as if it faced the camera, wherever it lies on its block.
    planes, to_facing = planes_of(ds).facing()
    x, y = ds.coords["x"].values, ds.coords["y"].values
    ties, (index, group, cluster) = _tied(ds, planes)
    rings = pith_energy.sample_rings(lines, belief, index, group, planes=planes)
    face = pose_story.Face.around(planes, rings.points, x, y)
    fibers = fiber.fibers_of_faces(ds[RGB.name].values, ds[VALID.name].values, lines, planes, x, y)
    fixed = pith.Fixed(
        (params.pith_x_px, params.pith_y_px, params.pith_z_px),
        params.pith_tilt_deg,
        params.pith_azimuth_deg,
        params.ring_width_px,
    )
    behind = params.pith_side == "behind"
    fitted = pith.fit_pith(
        rings, face.size_px, behind, scalar(ds, GRAIN_RATIO), face.aspect, fixed, face.centre, fibers
    )
    given = (params.bend_x_per_px, params.bend_y_per_px, params.taper_per_px)
    fitted, stem = pith_stem.with_stem(rings, fitted, face.centre, params.stem == "auto", given)
    radius, shift, width, innermost = ring_radii(rings, fitted, params.narrowest_share, stem)
    story = pose_story.describe(fitted, face, float(width))
    figures = dict(story.figures)
    if stem.any():
        figures["bend and taper of the stem (1/px)"] = ", ".join(f"{value:.2e}" for value in stem)
    return xr.Dataset(
        {
            BOARD_TO_TREE.name: BOARD_TO_TREE.array(pith.board_to_tree(fitted, face.centre) @ to_facing),
            INNERMOST_AGE.name: INNERMOST_AGE.array(np.int64(innermost)),
            RING_RADIUS.name: RING_RADIUS.array(radius),
            RING_AGE_SIGN.name: RING_AGE_SIGN.array(ties.sign),
            RING_AGE_SHIFT.name: RING_AGE_SHIFT.array(ties.shift + shift[cluster]),
            RING_WIDTH.name: RING_WIDTH.array(np.float64(width)),
            POSE_SPREAD.name: POSE_SPREAD.array(fitted.spread),
            POSE_UNDETERMINED.name: POSE_UNDETERMINED.array(story.undetermined),
            STEM.name: STEM.array(stem),
        },
        coords={"boundary": np.arange(len(radius))},
        attrs={"warnings": story.warnings, "figures": figures},
    )


def _tied(ds: xr.Dataset, planes: Planes) -> tuple[Ties, tuple[Array, Array, Array]]:
    """Ring indices of all faces tied where their boundaries meet; index, group and cluster as numbered together."""
    from woodfit import face_ties

    index, group, counts = (ds[variable.name].values for variable in (RING_INDEX, RING_GROUP, VERTEX_COUNT))
    x, y = ds[RING_X.name].values, ds[RING_Y.name].values
    points, face = planes.lift(x, y), planes.face_of(y)
    ties = face_ties.tie_groups(
        points, face, np.repeat(index, counts), np.repeat(group, counts), scalar(ds, RING_SCALE)
    )
    return ties, face_ties.numbered_together(ties, index, group, counts)
