"""Finding and reading what is known about scans: truth files, label files, species."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

TRUTH_SUFFIX = ".truth.npz"
LABEL_KEYS = frozenset({"paths", "rings", "shapes"})


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
        label = _peek(candidate)
        if label is None:
            continue
        named = _image_named(label, scan.name)
        agreement = _common_end(named, scan.absolute())
        # A bare name such as A_col.png occurs in many folders: it needs its folder too, unless the stem says the rest.
        if agreement >= min(2, len(named.parts)) or (agreement == 1 and candidate.stem == scan.stem):
            ranked.append((-agreement, candidate.stem != scan.stem, order, candidate))
    return min(ranked)[-1] if ranked else None


def _peek(path: Path) -> dict[str, Any] | None:
    """Content of a label file as it stands; None for a file that is missing or is something else."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) and not content.keys().isdisjoint(LABEL_KEYS) else None


def read_label(path: Path) -> dict[str, Any]:
    """Labels of a file, labelme's outlines taken as the rings of a disc.

    Raises
    ------
    TruthError
        The file holds no labels.
    """
    content = _peek(path)
    if content is None:
        raise TruthError(
            f"{path}: expected labels with `paths` or `rings`, labelme's `shapes`, or a file named *{TRUTH_SUFFIX}."
        )
    return _from_labelme(content, path) if "shapes" in content else content


def _image_named(content: Mapping[str, Any], default: str) -> Path:
    """Image that a label is of. Labelme writes a path of the computer it ran on, Windows with backslashes."""
    if "imagePath" in content:
        return Path(str(content["imagePath"]).replace("\\", "/").split("/")[-1])
    return Path(str(content.get("image", default)))


def _common_end(a: Path, b: Path) -> int:
    """How many last components two paths share."""
    count = 0
    for left, right in zip(reversed(a.parts), reversed(b.parts), strict=False):
        if left != right:
            break
        count += 1
    return count


# --- discs --------------------------------------------------------------------------------------------------
def _from_labelme(content: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Labels of ours from a labelme file: every outline is a closed ring of a disc, one called pith is the pith."""
    rings: list[dict[str, Any]] = []
    label: dict[str, Any] = {"kind": "disc", "rings": rings}
    label |= {key: content[key] for key in ("pixel_size_mm", "species", "pith") if key in content}
    try:
        for number, shape in enumerate(content["shapes"]):
            points = np.asarray(shape["points"], dtype=float).reshape(-1, 2)
            if str(shape.get("label", "")).lower() == "pith":
                label["pith"] = centroid(points).tolist()
            elif len(points) > 2:
                is_open = shape.get("shape_type", "polygon") in ("line", "linestrip")
                rings.append({"id": number, "name": shape.get("label"), "points": points, "closed": not is_open})
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise TruthError(f"{path}: expected labelme's `shapes`, each with `points` [[x, y], ...]; {error}.") from error
    return label


def centroid(points: ArrayLike) -> NDArray[np.float64]:
    """Middle (x, y) of the area inside an outline (n, 2); of its points when it has no area."""
    p = np.asarray(points, dtype=float).reshape(-1, 2)
    origin = p.mean(axis=0)
    a = p - origin
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    if abs(cross.sum()) < 1e-9:
        return np.asarray(origin)
    return np.asarray(origin + ((a + b) * cross[:, None]).sum(axis=0) / (3 * cross.sum()))


def pith_of(label: Mapping[str, Any]) -> NDArray[np.float64] | None:
    """Pith (x, y) of a labelled disc, None where the label is of something else.

    Given as ``pith``; else where the labelled rays begin; else the middle of the smallest closed ring.
    """
    if label.get("pith") is not None:
        return np.asarray(label["pith"], dtype=float).reshape(2)
    if label.get("kind") != "disc":
        return None
    if label.get("paths"):
        return np.asarray(label["paths"][0]["start"], dtype=float).reshape(2)
    closed = [np.asarray(ring["points"], dtype=float) for ring in label.get("rings", []) if ring.get("closed")]
    return centroid(min(closed, key=lambda points: float(np.ptp(points, axis=0).prod()))) if closed else None


# --- species ------------------------------------------------------------------------------------------------
SPECIES_FILES = ("species.yaml", "species.yml", "species.json")


def read_species(folder: Path | None) -> dict[str, str]:
    """Species by pattern of file names, from ``species.yaml`` or ``species.json`` in the folder of labels.

    Either the mapping itself or one under the key ``species``.

    Raises
    ------
    TruthError
        The file is no such mapping.
    """
    path = next((folder / name for name in SPECIES_FILES if (folder / name).is_file()), None) if folder else None
    if path is None:
        return {}
    import yaml

    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise TruthError(f"{path}: cannot be read: {error}.") from error
    if isinstance(content, dict) and isinstance(content.get("species"), dict):
        content = content["species"]
    if not isinstance(content, dict) or not all(isinstance(value, str) for value in content.values()):
        raise TruthError(f"{path}: expected lines such as `core_*: Picea abies`, a name pattern and a species.")
    return {str(pattern): species for pattern, species in content.items()}


def species_of(
    scan: Path, label: Mapping[str, Any], patterns: Mapping[str, str], by_folder: bool = False
) -> str | None:
    """Species of a scan: as its label says, else by the first pattern that fits, else its folder's name if asked."""
    if isinstance(label.get("species"), str):
        return str(label["species"])
    names: Sequence[str] = (scan.name, scan.stem, str(scan))
    for pattern, species in patterns.items():
        if any(fnmatch(name, pattern) for name in names):
            return species
    return scan.absolute().parent.name if by_folder else None
