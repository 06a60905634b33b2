"""``woodpipe ablate``: a scan fitted by image loss and by phase loss, side by side, front and volume."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipeline.problems import Problem, UsageError

if TYPE_CHECKING:
    import xarray as xr

    from pipeline.layout import Layout
    from pipeline.plan import Selection
    from pipeline.project import Project
    from woodfit.solid_texture import SolidTexture

Array = npt.NDArray[Any]

LAST_STAGE = "color_map"
TITLES = (
    "(a) image loss, no initial distortion",
    "(b) image loss, initial distortion",
    "(c) phase loss (woodpipe)",
)
IMAGE_ERROR = "image error (rms, linear rgb)"
PHASE_ERROR = "phase error (median, rad)"
FACE_FOLD = "folded over (share of the face)"
FOLD_OVER = "folded over (share of the block)"
ROUGHNESS = "roughness of the rings (ring widths)"
_MOST_PIXELS = 150_000
_DEPTH_SHARE = 0.4
_PROBES = 200_000


@dataclass(frozen=True)
class Variant:
    """One way to fit the scan, and what came of it.

    Parameters
    ----------
    title
        What was done.
    texture
        The fitted solid.
    front
        The face rendered, linear RGB (M, N, 3).
    figures
        Name to value.
    """

    title: str
    texture: SolidTexture
    front: Array
    figures: Mapping[str, float]


@dataclass(frozen=True)
class Face:
    """A scan's face, thinned to at most some hundred thousand pixels.

    Parameters
    ----------
    points
        Board frame, px, shape (M, N, 3).
    rgb, valid, phase, belief
        Photograph, sound wood, ring phase (rad) and its confidence there.
    step
        Scan px between neighbours.
    """

    points: Array
    rgb: Array
    valid: npt.NDArray[np.bool_]
    phase: Array
    belief: Array
    step: float

    @classmethod
    def of(cls, ds: xr.Dataset) -> Face:
        """Take it from the results of the stages."""
        from stages.polylines import planes_of
        from stages.variables import ANOMALY, PHASE_CONFIDENCE, RGB, RING_PHASE, VALID
        from woodfit.face import stride_for

        every = stride_for(ds[VALID.name].size, _MOST_PIXELS)
        ds = ds.isel(y=slice(None, None, every), x=slice(None, None, every))
        x, y = np.meshgrid(ds.coords["x"].values, ds.coords["y"].values)
        return cls(
            planes_of(ds).lift(x, y),
            ds[RGB.name].values,
            ds[VALID.name].values & (ds[ANOMALY.name].values == 0),
            ds[RING_PHASE.name].values,
            ds[PHASE_CONFIDENCE.name].values,
            float(x[0, 1] - x[0, 0]),
        )


def ablate_scan(config: Path, scan: str, steps: int, out: Path | None, debug: bool) -> Path | None:
    """Bring a scan up to date as far as its colors, fit the variants and draw them; None where the scan failed.

    Parameters
    ----------
    config
        The YAML file.
    scan
        Name of one of its scans, with or without suffix, or its path.
    steps
        Of Adam.
    out
        Picture to write; default: ``ablation.png`` in the scan's folder.
    debug
        Show tracebacks.
    """
    from pipeline.ablation_picture import draw
    from pipeline.commands import run_and_tell
    from pipeline.layout import Layout
    from pipeline.plan import Selection
    from pipeline.project import Project

    if out is not None and out.suffix.lower() != ".png":
        raise UsageError("The command cannot be followed", [Problem("--out", f"expected a .png file, found {out}")])
    project = Project.load(config)
    name = str(Path(scan).absolute()) if Path(scan).exists() else scan
    project.select(Selection(scan=name))
    chosen = project.selected(name)
    if len(chosen) > 1:
        found = ", ".join(path.name for path in chosen)
        raise UsageError("The command cannot be followed", [Problem("SCAN", f"expected one scan, found {found}")])
    if any(chosen[0] in block.scans for block in project.config.blocks):
        problem = Problem("SCAN", f"{chosen[0].name} is a face of a block, expected a scan that stands alone")
        raise UsageError("The command cannot be followed", [problem])
    selection = Selection(until=LAST_STAGE, scan=str(chosen[0]))
    rows, loaded = run_and_tell(config, selection, {}, debug)
    if any(row.outcome == "failed" for row in rows):
        return None
    layout = Layout(loaded.output)
    ds = stored_results(project, selection, layout)
    target = layout.product(chosen[0].stem, "ablation.png") if out is None else out
    target.parent.mkdir(parents=True, exist_ok=True)
    draw(fit_variants(ds, steps), Face.of(ds), target)
    return target


def stored_results(project: Project, selection: Selection, layout: Layout) -> xr.Dataset:
    """Everything that the stages of one scan gave, read where it is used."""
    import xarray as xr

    from pipeline.store import open_data
    from stages.faces import single_face

    (plan,) = project.plan(selection)
    stored = [open_data(layout.result(node.stage, node.key)) for node in plan.stages]
    bare = [part.drop_attrs(deep=False) for part in (*stored, single_face())]
    return xr.merge(bare, compat="override", join="outer", combine_attrs="override")


def fit_variants(ds: xr.Dataset, steps: int = 500) -> list[Variant]:
    """Fit both image-loss variants from what the stages found, and take the stages' own fit beside them.

    Parameters
    ----------
    ds
        Results of the stages up to `LAST_STAGE`.
    steps
        Of Adam.
    """
    from stages.products import solid_texture_of
    from stages.variables import BRIGHT_OUTWARDS, DISPLACEMENT

    ours, face = solid_texture_of(ds), Face.of(ds)
    dark_latewood = bool(ds[BRIGHT_OUTWARDS.name])
    initial = ds[DISPLACEMENT.name].values
    textures = [_by_image(ours, face, start, dark_latewood, steps) for start in (np.zeros_like(initial), initial)]
    return [_judged(title, texture, face) for title, texture in zip(TITLES, [*textures, ours], strict=True)]


def _by_image(ours: SolidTexture, face: Face, start: Array, dark_latewood: bool, steps: int) -> SolidTexture:
    """The texture that Adam on the image loss gives, from a displacement to start with."""
    from woodfit.color_strip import fit_color_strip
    from woodfit.cylinder_grid import cylindrical
    from woodfit.image_loss import FacePixels, fit_image

    seen = face.points[face.valid]
    rgb, weight = face.rgb[face.valid], np.ones(len(seen))
    begun = replace(ours, displacement=start)
    age = begun.evaluate(seen * _unit(ours), detail=False).ring_age
    samples, rings = ours.samples_per_ring, len(ours.color_strip) // ours.samples_per_ring
    # Colors begin as the best map for the displacement that is there, as they do in woodpipe itself.
    strip = fit_color_strip(age, rgb, weight, rings, samples, dark_latewood)
    pixels = FacePixels(*cylindrical(seen, ours.board_to_tree, ours.stem), rgb, weight)
    fit = fit_image(ours.grid, start, pixels, ours.ring_radius, strip.rgb, samples, steps)
    # Where colors stand for fact, not for a few pixels each, the strip's own lateness is asked for.
    certain = np.full(len(fit.rgb), 1e9)
    lateness = fit_color_strip(strip.age, fit.rgb, certain, rings, samples, dark_latewood).lateness
    return replace(ours, displacement=fit.displacement, color_strip=fit.rgb, lateness_strip=lateness)


def _unit(texture: SolidTexture) -> float:
    """The texture's units per px."""
    return 1.0 if texture.pixel_size is None else texture.pixel_size


def _judged(title: str, texture: SolidTexture, face: Face) -> Variant:
    wood = texture.evaluate(face.points * _unit(texture), detail=False)
    return Variant(title, texture, wood.rgb, figures_of(texture, face, wood.rgb, wood.ring_age))


def figures_of(texture: SolidTexture, face: Face, front: Array, age: Array) -> dict[str, float]:
    """What a fit is worth: on the face, and inside the block.

    Parameters
    ----------
    texture, face
        The fit and what it was fitted to.
    front, age
        Linear RGB (M, N, 3) and ring age (M, N) that the texture has on the face.

    Returns
    -------
    dict
        `IMAGE_ERROR`; `PHASE_ERROR` at pixels of more than half confidence; `FACE_FOLD` and `FOLD_OVER`, the share of
        the face and of random points of the block at which ``r + m_r`` does not grow with r; `ROUGHNESS`, how far the
        displacement on the face strays from its own mean over about a ring width, rms.
    """
    from woodfit.cylinder_grid import cylindrical, sample
    from woodfit.image_loss import folded_share, mean_ring_width, roughness
    from woodfit.rings import wrap

    ring = mean_ring_width(texture.ring_radius)
    model = texture.grid, texture.displacement
    on_face = cylindrical(face.points[face.valid], texture.board_to_tree, texture.stem)
    probes = np.random.default_rng(0).uniform(*block_of(face), (_PROBES, 3))
    inside = cylindrical(probes, texture.board_to_tree, texture.stem)
    moved = np.zeros(face.valid.shape)
    moved[face.valid] = sample(*model, *on_face)[0]
    sure = face.valid & (face.belief > 0.5)
    phase = np.abs(wrap(face.phase - 2.0 * np.pi * age)[sure])
    return {
        IMAGE_ERROR: float(np.sqrt(((front - face.rgb)[face.valid] ** 2).mean())),
        PHASE_ERROR: float(np.median(phase)) if phase.size else float("nan"),
        FACE_FOLD: folded_share(*model, *on_face),
        FOLD_OVER: folded_share(*model, *inside),
        ROUGHNESS: roughness(moved, face.valid, ring / face.step) / ring,
    }


def block_of(face: Face) -> tuple[Array, Array]:
    """Opposite corners (3,) of the block behind a face, board frame, px."""
    low, high = face.points[0, 0].copy(), face.points[-1, -1].copy()
    high[2] = _DEPTH_SHARE * float((high - low)[:2].min())
    return low, high


def lateness_of_block(texture: SolidTexture, face: Face, longer: int) -> Array:
    """Lateness of cubic voxels (D, H, W), slices into the wood, `longer` of them along the face's longer side."""
    low, high = block_of(face)
    side = float((high - low)[:2].max()) / longer
    x, y, z = (low[axis] + side * (np.arange(max(1, round((high - low)[axis] / side))) + 0.5) for axis in range(3))
    points = np.empty((len(y), len(x), 3))
    points[..., 0], points[..., 1] = np.meshgrid(x, y)
    volume = np.empty((len(z), len(y), len(x)), np.float32)
    for k, depth in enumerate(z):
        points[..., 2] = depth
        volume[k] = texture.evaluate(points * _unit(texture), detail=False).lateness
    return volume
