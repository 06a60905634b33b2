"""The gallery: the paper's results figure of one's own scans, one row a scan, and a page over them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.gallery_panels import Subject, colors_panel, front_panel, read_photograph, rings_panel
from pipeline.problems import Problem, UsageError
from pipeline.report.pictures import Bytes, fit

if TYPE_CHECKING:
    from pipeline.config import Config

#: What the columns show, from left to right.
COLUMNS = ("photograph", "rings", "front", "carved", "inside", "colors")

#: Longer side of the overview.
_OVERVIEW_PX = 2200

_GAP, _PAPER, _INK = 12, 255, (40, 40, 40)


@dataclass(frozen=True)
class Look:
    """How the gallery is made.

    Attributes
    ----------
    side_px : int
        Height and width of a panel.
    spp : int
        Samples per px of the rendered panels.
    mesh : str
        What is carved; as ``woodpipe carve`` takes it.
    """

    side_px: int = 360
    spp: int = 64
    mesh: str = "sample:bowl"


def make_gallery(config: Config, folder: Path, look: Look, tell: Callable[[str], None]) -> list[Path]:
    """Write a picture of each scan, ``overview.jpg`` of all, and ``index.md``; returns the files.

    Parameters
    ----------
    config
        Of a run that is done; scans and blocks without texture are told and left out.
    folder
        Where to write.
    look
        Size and quality.
    tell
        Is given a line on each scan.

    Raises
    ------
    UsageError
        When no scan has a texture, or the renderer is not installed.
    """
    from pipeline.layout import Layout

    layout = Layout(config.output)
    rows: list[tuple[str, Bytes]] = []
    for name, photograph, rings in sources_of(config):
        texture = layout.product(name, "texture.zarr.zip")
        traced = layout.product(rings, "rings.json")
        if not (texture.exists() and traced.exists()):
            tell(f"{name}: no texture yet; run the pipeline first")
            continue
        rows.append((name, draw_row(_subject(name, photograph, traced, texture, look), look)))
        tell(f"{name}: drawn")
    if not rows:
        raise UsageError("Nothing to show", [Problem("", f"{config.output} holds no textures; `woodpipe run` first")])
    folder.mkdir(parents=True, exist_ok=True)
    files = [_write(folder / f"{name}.jpg", row) for name, row in rows]
    files.append(_write(folder / "overview.jpg", fit(stack(rows), _OVERVIEW_PX)))
    index = folder / "index.md"
    index.write_text(index_text([name for name, _ in rows]), encoding="utf-8")
    return [*files, index]


def sources_of(config: Config) -> list[tuple[str, Path, str]]:
    """Name, photograph, and name of the folder with the rings, of every scan and every block."""
    faces = {scan for block in config.blocks for scan in block.scans}
    single = [(scan.stem, scan, scan.stem) for scan in config.scans if scan not in faces]
    blocks = [(block.name, block.scans[0], block.scans[0].stem) for block in config.blocks]
    return sorted([*single, *blocks])


def _subject(name: str, scan: Path, rings: Path, texture: Path, look: Look) -> Subject:
    from pipeline.evaluation import TracedRings
    from woodfit import SolidTexture

    photograph, scale = read_photograph(scan, 2 * look.side_px)
    return Subject(name, photograph, scale, TracedRings.read(rings), SolidTexture.open(texture))


def draw_row(subject: Subject, look: Look) -> Bytes:
    """All panels of one scan side by side."""
    from pipeline.render import render_preset

    side = look.side_px
    size = (side, side)
    texture = subject.texture
    panels = [
        subject.photograph,
        rings_panel(subject),
        front_panel(subject),
        render_preset("carved", texture, size=size, spp=look.spp, mesh=look.mesh),
        # Paths in a medium cost many times those on surfaces, and the denoiser needs fewer.
        render_preset("false-color", texture, size=size, spp=max(4, look.spp // 4)),
        colors_panel(subject, (side // 2, side)),
    ]
    return beside([framed(panel, side) for panel in panels])


def framed(picture: Bytes, side: int) -> Bytes:
    """A picture shrunk to fit into a square of paper, or half of one where it is slender, in its middle."""
    height, width = picture.shape[:2]
    scale = side / max(height, width)
    shown = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(picture, shown, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    paper = np.full((side, side if shown[0] > side // 2 else side // 2, 3), _PAPER, np.uint8)
    left, top = (paper.shape[1] - shown[0]) // 2, (side - shown[1]) // 2
    paper[top : top + shown[1], left : left + shown[0]] = small
    return paper


def beside(pictures: Sequence[Bytes]) -> Bytes:
    """Pictures of one height in a row, with gaps."""
    gap = np.full((pictures[0].shape[0], _GAP, 3), _PAPER, np.uint8)
    parts: list[npt.NDArray[Any]] = []
    for picture in pictures:
        parts += [picture, gap]
    return np.concatenate(parts[:-1], axis=1)


def stack(rows: Sequence[tuple[str, Bytes]]) -> Bytes:
    """Rows below one another, each under its name."""
    width = max(row.shape[1] for _, row in rows)
    sheets = []
    for name, row in rows:
        sheet = np.full((row.shape[0] + 34, width, 3), _PAPER, np.uint8)
        sheet[34:, : row.shape[1]] = row
        cv2.putText(sheet, name, (2, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.6, _INK, 1, cv2.LINE_AA)
        sheets.append(sheet)
    return np.concatenate(sheets)


def index_text(names: Sequence[str]) -> str:
    """The page, in Markdown."""
    columns = (
        "From left to right: the photograph; the ring boundaries found on it; the face as the fitted texture gives it "
        "back; a piece carved from it; the wood as a translucent volume in which only latewood is dense, so that the "
        "growth layers show inside; and the color map, a row for each ring, earlywood on the left."
    )
    parts = [f"## {name}\n\n![{name}: {', '.join(COLUMNS)}]({name}.jpg)\n" for name in names]
    return "\n".join(["# Gallery\n", f"Made by `make gallery`. {columns}\n", *parts])


def _write(path: Path, picture: Bytes) -> Path:
    options = [cv2.IMWRITE_JPEG_QUALITY, 90, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(picture[..., ::-1]), options)
    if not done:
        raise ValueError(f"cannot encode a picture of shape {picture.shape}")
    path.write_bytes(data.tobytes())
    return path
