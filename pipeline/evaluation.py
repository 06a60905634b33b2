"""Judging a result: rings and texture of one scan against synthetic truth or hand labels.

As little logic as possible: files are read here, figures come from :mod:`woodfit.scoring`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from woodfit import scoring
from woodfit.synthetic import srgb_decode

TRUTH_SUFFIX = ".truth.npz"


class TruthError(ValueError):
    """A truth or label file that cannot be used; the message names the file and what is wrong with it."""


def find_truth(scan: Path, labels_dir: Path | None = None) -> Path | None:
    """File with the truth of a scan, or None.

    In order: ``<stem>.truth.npz`` beside the scan, then in `labels_dir`; then labels ``.json``, there those whose
    ``"image"`` names the scan (the longer the agreeing end of the path, the better) before ``<stem>.json``.
    """
    folders = [scan.parent] if labels_dir is None else [scan.parent, labels_dir]
    for folder in folders:
        if (folder / f"{scan.stem}{TRUTH_SUFFIX}").is_file():
            return folder / f"{scan.stem}{TRUTH_SUFFIX}"
    candidates = [scan.with_suffix(".json")]
    if labels_dir is not None:
        candidates = [*sorted(labels_dir.glob("*.json")), labels_dir / f"{scan.stem}.json", *candidates]
    ranked = []
    for order, candidate in enumerate(candidates):
        label = _read_label_or_none(candidate)
        if label is None:
            continue
        named = Path(str(label.get("image", scan.name)))
        agreement = _common_end(named, scan.absolute())
        # A bare name such as A_col.png occurs in many folders: it needs its folder too, unless the stem says the rest.
        if agreement >= min(2, len(named.parts)) or (agreement == 1 and candidate.stem == scan.stem):
            ranked.append((-agreement, candidate.stem != scan.stem, order, candidate))
    return min(ranked)[-1] if ranked else None


def _read_label_or_none(path: Path) -> dict[str, Any] | None:
    """Content of a label file; None for a file that is missing or is something else."""
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) and ("paths" in content or "rings" in content) else None


def _common_end(a: Path, b: Path) -> int:
    """How many last components two paths share."""
    count = 0
    for left, right in zip(reversed(a.parts), reversed(b.parts), strict=False):
        if left != right:
            break
        count += 1
    return count


def read_polylines(rings_json: Path) -> tuple[NDArray[np.float64], ...]:
    """Polylines (n, 2) of x, y, image px, of a ``rings.json``; closed ones repeat their first point at the end."""
    polylines = []
    for ring in json.loads(rings_json.read_text())["rings"]:
        points = np.asarray(ring["points"], dtype=float).reshape(-1, 2)
        if ring.get("closed") and len(points) > 1 and not np.array_equal(points[0], points[-1]):
            points = np.concatenate([points, points[:1]])
        if len(points) > 1:
            polylines.append(points)
    return tuple(polylines)


def evaluate(
    rings_json: Path,
    truth: Path,
    texture: Path | None = None,
    scan: Path | None = None,
    tolerance_px: float = 3.0,
) -> dict[str, float]:
    """Figures of one scan's result, by what `truth` is: synthetic truth, labelled paths or a labelled face.

    Parameters
    ----------
    rings_json
        The traced rings, image px.
    truth
        ``.truth.npz`` as `woodpipe sample` writes it, or labels ``.json``.
    texture
        The solid texture; needed for the figures of ring age and color, synthetic truth only.
    scan
        The photograph, for the color's PSNR; if None, the image named in `rings_json` beside the truth, if any.
    tolerance_px
        How far from the truth still is a hit.

    Returns
    -------
    dict
        Figure by name; NaN where there was nothing to judge.
    """
    polylines = read_polylines(rings_json)
    if truth.name.endswith(TRUTH_SUFFIX):
        with np.load(truth) as file:
            known = {name: file[name] for name in file.files}
        figures = _ring_figures(polylines, known["age"], tolerance_px)
        beside = truth.with_name(Path(json.loads(rings_json.read_text()).get("image", "")).name or truth.name)
        photograph = scan if scan is not None else beside if beside.is_file() and beside != truth else None
        return figures if texture is None else figures | _texture_figures(texture, known, photograph)
    label = _read_label_or_none(truth)
    if label is None:
        raise TruthError(f"{truth}: expected labels with `paths` or `rings`, or a file named *{TRUTH_SUFFIX}.")
    try:
        if "paths" in label:
            return scoring.path_score(polylines, label["paths"], tolerance_px)
        return scoring.face_score(polylines, label, tolerance_px)
    except KeyError as error:
        raise TruthError(f"{truth}: a labelled path or ring lacks {error}.") from error


def _ring_figures(
    polylines: tuple[NDArray[np.float64], ...], age: NDArray[np.float32], tolerance_px: float
) -> dict[str, float]:
    lines = scoring.line_f(polylines, age, tolerance_px=tolerance_px)
    strict = scoring.line_f(polylines, age, tolerance_px=tolerance_px, grazing_deg=90.0, edge_px=0.0)
    pixels = scoring.boundary_recall_precision(polylines, age, tolerance_px)
    return (
        pixels
        | {f"line_{name}": lines[name] for name in ("f", "sensitivity", "precision")}
        | {"line_f_strict": strict["f"]}
    )


def _texture_figures(path: Path, known: Mapping[str, NDArray[Any]], scan: Path | None) -> dict[str, float]:
    # Lazily: the command line must not pay for the texture's imports, and rings can be judged without it.
    from woodfit import SolidTexture

    texture = SolidTexture.open(path)
    unit = px_to_texture_unit(texture)
    height, width = known["age"].shape
    face = np.zeros((height, width, 3))
    face[..., 1], face[..., 0] = np.mgrid[:height, :width]
    drawn = texture.evaluate(face * unit)
    figures = scoring.age_share(np.asarray(drawn.ring_age), known["age"])
    figures["age_correlation"] = scoring.age_correlation(np.asarray(drawn.ring_age), known["age"])
    if scan is not None:
        figures["psnr"] = scoring.psnr_blurred(np.asarray(drawn.rgb), _read_linear(scan))
    for name in (key.removesuffix("_points") for key in known if key.endswith("_points")):
        age = np.asarray(texture.evaluate(known[f"{name}_points"].astype(float) * unit).ring_age)
        # The planes keep the constant of the face: only a wrong depth may make them differ.
        error = np.abs(age - figures["age_offset"] - known[f"{name}_age"])
        figures[f"{name}_correlation"] = scoring.age_correlation(age, known[f"{name}_age"])
        figures[f"{name}_median_error"] = float(np.median(error))
    return figures


def px_to_texture_unit(texture: Any) -> float:
    """Length of a scan px in the texture's unit: its ``pixel_size`` in mm, or 1 when it knows no scale."""
    size = getattr(texture, "pixel_size", None)
    return 1.0 if size is None or not math.isfinite(size) or size <= 0 else float(size)


def _read_linear(scan: Path) -> NDArray[np.float64]:
    """Linear rgb 0..1, shape (H, W, 3), of a sample scan (8 bit)."""
    import cv2

    pixels = cv2.imread(str(scan), cv2.IMREAD_COLOR)
    if pixels is None:
        raise TruthError(f"{scan}: cannot be read as an image.")
    return srgb_decode(np.asarray(pixels[..., ::-1], dtype=float) / 255.0)
