"""Judging results: rings and texture of scans against synthetic truth or hand labels.

As little logic as possible: files are read here, figures come from :mod:`woodfit.scoring`,
:mod:`woodfit.dendro_scoring` and :mod:`woodfit.influence`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.labels import TRUTH_SUFFIX, TruthError, pith_of, read_label, species_of
from pipeline.scene_figures import ring_figures, texture_figures
from woodfit import scoring
from woodfit.dendro_scoring import PathComparison, compare_path, reliability
from woodfit.influence import DiscTruth, InfluenceComparison, influence_score, truth_from_rays, truth_from_rings
from woodfit.scoring import FaceComparison

ALL = "all"
MEANS = ("sensitivity", "precision", "f", "fine_f", "width_r", "series_r", "influence_f", "label_share", "traced_share")

Figure = float | list[int | str]
Part = TypeVar("Part", PathComparison, FaceComparison, InfluenceComparison)


# --- what was traced ----------------------------------------------------------------------------------------
@dataclass(frozen=True)
class TracedRings:
    """Content of a ``rings.json``.

    Parameters
    ----------
    polylines
        x, y, shape (n, 2) each, image px; closed ones repeat their first point at the end.
    confidence
        Of each polyline.
    identity
        Group and id of each polyline.
    pixel_size_mm
        None when unknown.
    image
        Name of the scan.
    """

    polylines: tuple[NDArray[np.float64], ...]
    confidence: tuple[float, ...]
    identity: tuple[tuple[int, int], ...]
    pixel_size_mm: float | None
    image: str

    @classmethod
    def read(cls, path: Path) -> TracedRings:
        """Read ``rings.json`` (docs/rings_json.md)."""
        content = json.loads(path.read_text(encoding="utf-8"))
        polylines, confidence, identity = [], [], []
        for number, ring in enumerate(content["rings"]):
            points = np.asarray(ring["points"], dtype=float).reshape(-1, 2)
            if ring.get("closed") and len(points) > 1 and not np.array_equal(points[0], points[-1]):
                points = np.concatenate([points, points[:1]])
            if len(points) > 1:
                polylines.append(points)
                confidence.append(float(ring.get("confidence", math.nan)))
                identity.append((int(ring.get("group", 0)), int(ring.get("id", number))))
        return cls(
            tuple(polylines), tuple(confidence), tuple(identity), content.get("pixel_size_mm"), content.get("image", "")
        )

    def rings(self) -> list[list[NDArray[np.float64]]]:
        """Polylines of one identity together."""
        pieces: dict[tuple[int, int], list[NDArray[np.float64]]] = {}
        for key, polyline in zip(self.identity, self.polylines, strict=True):
            pieces.setdefault(key, []).append(polyline)
        return list(pieces.values())


def read_polylines(rings_json: Path) -> tuple[NDArray[np.float64], ...]:
    """Polylines (n, 2) of x, y, image px, of a ``rings.json``; closed ones repeat their first point at the end."""
    return TracedRings.read(rings_json).polylines


# --- one scan -----------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Judgement:
    """What comparing one scan with what is known of it gave; parts that do not apply are None.

    Parameters
    ----------
    paths, face, disc
        Comparison with labelled paths, a labelled face, the rings of a disc.
    scene
        Figures against synthetic truth.
    species
        As the labels have it.
    dated
        Whether missed and false boundaries are named by year.
    note
        What could not be judged and why.
    """

    paths: PathComparison | None = None
    face: FaceComparison | None = None
    disc: InfluenceComparison | None = None
    scene: Mapping[str, float] = field(default_factory=dict)
    species: str | None = None
    dated: bool = False
    note: str = ""

    def figures(self) -> dict[str, Figure]:
        """Every figure by name; NaN where there was nothing to judge."""
        figures: dict[str, Figure] = dict(self.scene)
        for part in (self.paths, self.face, self.disc):
            figures |= {} if part is None else part.figures()
        if self.paths is not None:
            unit = "years" if self.dated else "rings"
            figures |= {f"missed_{unit}": sorted(self.paths.missed), f"false_{unit}": sorted(self.paths.false)}
        if self.disc is not None:
            figures["influence_missed_rings"] = list(self.disc.missed)
        return figures


def judge(
    rings_json: Path,
    truth: Path,
    texture: Path | None = None,
    scan: Path | None = None,
    tolerance_px: float = 3.0,
    species: Mapping[str, str] | None = None,
    by_folder: bool = False,
) -> Judgement:
    """Compare one scan's result with `truth`: synthetic truth, or labelled paths, faces and discs.

    Parameters
    ----------
    rings_json
        The traced rings, image px.
    truth
        ``.truth.npz`` as `woodpipe sample` writes it, or labels ``.json``.
    texture
        The solid texture; needed for the figures of ring age and color, synthetic truth only.
    scan
        The photograph, for the color's PSNR and the species; if None, the image named in `rings_json` beside the truth.
    tolerance_px
        How far from the truth still is a hit.
    species
        Species by pattern of file names.
    by_folder
        Whether a scan of no known species counts to one named as its folder.

    Raises
    ------
    TruthError
        The truth cannot be used.
    """
    traced = TracedRings.read(rings_json)
    photograph = scan if scan is not None else truth.with_name(Path(traced.image).name or truth.name)
    if truth.name.endswith(TRUTH_SUFFIX):
        with np.load(truth) as file:
            known = {name: file[name] for name in file.files}
        figures = ring_figures(traced.polylines, known["age"], tolerance_px)
        if texture is not None:
            seen = photograph if photograph.is_file() and photograph != truth else None
            figures |= texture_figures(texture, known, seen)
        return Judgement(scene=figures, species=species_of(photograph, {}, species or {}, by_folder))
    label = read_label(truth)
    named = species_of(photograph, label, species or {}, by_folder)
    try:
        return _judge_labels(traced, label, tolerance_px, named)
    except KeyError as error:
        raise TruthError(f"{truth}: a labelled path or ring lacks {error}.") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise TruthError(f"{truth}: cannot be used as labels: {error}.") from error


def _judge_labels(traced: TracedRings, label: Mapping[str, Any], tolerance_px: float, species: str | None) -> Judgement:
    size = label.get("pixel_size_mm") or traced.pixel_size_mm
    paths, face, disc, note = None, None, None, ""
    if label.get("paths") is not None:
        each = (compare_path(traced.polylines, path, tolerance_px, size, traced.confidence) for path in label["paths"])
        paths = sum(each, PathComparison())
    if label.get("rings") is not None:
        face = scoring.compare_face(traced.polylines, label, tolerance_px)
    if (pith := pith_of(label)) is not None:
        try:
            disc = influence_score(traced.rings(), _disc_truth(label, pith), pixel_size_mm=size)
        except ValueError as error:
            note = f"no influence-area figures: {error}"
    dated = any(path.get("year") is not None for path in label.get("paths") or ())
    return Judgement(paths, face, disc, {}, species, dated, note)


def _disc_truth(label: Mapping[str, Any], pith: NDArray[np.float64]) -> DiscTruth:
    return truth_from_rings(label["rings"], pith) if label.get("rings") else truth_from_rays(label["paths"], pith)


def evaluate(
    rings_json: Path,
    truth: Path,
    texture: Path | None = None,
    scan: Path | None = None,
    tolerance_px: float = 3.0,
) -> dict[str, Figure]:
    """Figures of :func:`judge` by name."""
    return judge(rings_json, truth, texture, scan, tolerance_px).figures()


# --- many scans ---------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Evaluation:
    """Judgements of many scans by name, and notes on what could not be judged."""

    scans: Mapping[str, Judgement]
    notes: Sequence[str] = ()
    tolerance_px: float = 3.0

    def pooled(self) -> dict[str, dict[str, Figure]]:
        """Figures of every species and of all scans: of the boundaries, lengths and rings taken together.

        ``images`` counts the scans; ``mean_...`` are means over scans, each scan counting alike. No species, no row but
        ``all``. Figures against synthetic truth are not pooled.
        """
        members: dict[str, list[Judgement]] = {}
        for judgement in self.scans.values():
            if judgement.species is not None:
                members.setdefault(judgement.species, []).append(judgement)
        return {name: _pool(group) for name, group in [*sorted(members.items()), (ALL, list(self.scans.values()))]}

    def reliability(self) -> list[dict[str, float]]:
        """Share of right boundaries by confidence, over every labelled path."""
        paths = sum((one.paths for one in self.scans.values() if one.paths is not None), PathComparison())
        return reliability(paths.confidence, paths.right)

    def as_json(self) -> dict[str, Any]:
        """Everything, with None for what is not known."""
        images = {
            name: {"species": judgement.species, **_plain(judgement.figures())}
            for name, judgement in self.scans.items()
        }
        return {
            "tolerance_px": self.tolerance_px,
            "images": images,
            "pooled": {name: _plain(figures) for name, figures in self.pooled().items()},
            "reliability": [_plain(row) for row in self.reliability()],
        }


def _pool(group: Sequence[Judgement]) -> dict[str, Figure]:
    together = Judgement(
        _sum(group, lambda one: one.paths), _sum(group, lambda one: one.face), _sum(group, lambda one: one.disc)
    )
    named = ("missed_rings", "false_rings", "influence_missed_rings")
    figures: dict[str, Figure] = {"images": float(len(group))}
    figures |= {name: value for name, value in together.figures().items() if name not in named}
    for name in MEANS:
        values = [
            value for one in group if isinstance(value := one.figures().get(name), float) and math.isfinite(value)
        ]
        if name in figures:
            figures[f"mean_{name}"] = float(np.mean(values)) if values else math.nan
    return figures


def _sum(group: Sequence[Judgement], part_of: Callable[[Judgement], Part | None]) -> Part | None:
    total: Part | None = None
    for judgement in group:
        part = part_of(judgement)
        if part is not None:
            total = part if total is None else total + part
    return total


def _plain(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Figures as JSON has them: None instead of NaN."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in figures.items()
    }
