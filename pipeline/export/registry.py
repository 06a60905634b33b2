"""The exporters by name. Adding one is a module with a ``write`` and a line here."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.problems import Problem, UsageError, did_you_mean

if TYPE_CHECKING:
    from woodfit import SolidTexture


@dataclass(frozen=True)
class Options:
    """What exporters are told; each reads what concerns it.

    Attributes
    ----------
    name : str
        What the wood is called; begins file names.
    cells : int
        Cells of a volume, or pixels of a slice, along the longest side of the block.
    slices : int
        Slices along each axis.
    dpi : float
        Of what is printed.
    depth_mm : float
        How far behind the photographed face a printed sheet is cut.
    detail : bool
        With fine grain.
    pixel_size_mm : float or None
        mm per px of the photograph, instead of the texture's own.
    mesh : str or None
        A mesh to dress; None is the block.
    map_px : int
        Texels along a side of baked maps.
    """

    name: str = "wood"
    cells: int = 256
    slices: int = 5
    dpi: float = 300.0
    depth_mm: float = 0.0
    detail: bool = True
    pixel_size_mm: float | None = None
    mesh: str | None = None
    map_px: int = 2048


Writer = Callable[["SolidTexture", Path, Options], list[Path]]


@dataclass(frozen=True)
class Exporter:
    """One format.

    Attributes
    ----------
    name : str
        As given to ``--to``.
    module : str
        With a function ``write(texture, folder, options)`` that returns the files it wrote.
    help : str
        What it is.
    extra : str
        Extra of woodpipe that it needs; empty for none.
    """

    name: str
    module: str
    help: str
    extra: str = ""

    def write(self, texture: SolidTexture, folder: Path, options: Options) -> list[Path]:
        """Write the export into a folder of its own."""
        folder.mkdir(parents=True, exist_ok=True)
        writer: Writer = importlib.import_module(f"pipeline.export.{self.module}").write
        return writer(texture, folder, options)


EXPORTERS = (
    Exporter("materialx", "materialx", "MaterialX document: the whole wood as a graph of nodes", "export"),
    Exporter("osl", "osl", "Open Shading Language shader with its tables"),
    Exporter("blender", "blender", "script that builds the material in Blender"),
    Exporter("usd", "usd", "USDZ with baked maps, of the block or a mesh", "export"),
    Exporter("vdb", "openvdb", "OpenVDB grids: color, lateness, extinction"),
    Exporter("mitsuba", "mitsuba_grids", "Mitsuba grid volumes: color, lateness, extinction"),
    Exporter("threejs", "threejs", "GLSL and a three.js module"),
    Exporter("slices", "slices", "PNG slices through the block along its axes"),
    Exporter("faces", "slices_of_box", "PNG of the six faces of the block, and their net"),
    Exporter("sheet", "sheet", "PDF of a veneer sheet at true scale"),
    Exporter("liu", "liu", "parameters of a Liu-type model, to edit by hand"),
)


def exporters_named(text: str) -> list[Exporter]:
    """Exporters of ``a,b`` or ``all``.

    Raises
    ------
    UsageError
        When there is none of a name.
    """
    known = {exporter.name: exporter for exporter in EXPORTERS}
    words = [word.strip() for word in text.split(",") if word.strip()]
    if words == ["all"]:
        return list(EXPORTERS)
    problems = [
        Problem("--to", f"there is no export {word!r}{did_you_mean(word, known)}")
        for word in words
        if word not in known
    ]
    if not words:
        problems = [Problem("--to", f"names nothing; there is {', '.join(known)}, or all")]
    if problems:
        raise UsageError("The command cannot be followed", problems)
    return [known[word] for word in dict.fromkeys(words)]


def export_all(
    texture: SolidTexture, exporters: Sequence[Exporter], folder: Path, options: Options
) -> tuple[list[Path], list[str]]:
    """Write exports, each into its own folder; what fails is told in a line and stops no other."""
    check(options)
    files: list[Path] = []
    problems: list[str] = []
    for exporter in exporters:
        try:
            files += exporter.write(texture, folder / exporter.name, options)
        except UsageError as error:
            problems += [f"{exporter.name}: {problem.what}" for problem in error.problems]
        except OSError as error:
            problems.append(f"{exporter.name}: {error}")
    return files, problems


def check(options: Options) -> None:
    """Refuse what no exporter can follow."""
    limits: dict[str, tuple[Any, float, float]] = {
        "--cells": (options.cells, 8, 2048),
        "--slices": (options.slices, 1, 500),
        "--dpi": (options.dpi, 10, 2400),
        "--map": (options.map_px, 64, 8192),
        "--pixel-size": (1.0 if options.pixel_size_mm is None else options.pixel_size_mm, 1e-6, 1e3),
        "--depth": (options.depth_mm, 0.0, 1e5),
    }
    problems = [
        Problem(name, f"found {value:g}, expected {low:g} to {high:g}")
        for name, (value, low, high) in limits.items()
        if not low <= value <= high
    ]
    if problems:
        raise UsageError("The command cannot be followed", problems)


def mm_or_one(texture: SolidTexture, options: Options) -> float:
    """Size of a unit of the texture, mm; 1 where that is not known."""
    return mm_per_unit(texture, options, "") if options.pixel_size_mm or texture.unit == "mm" else 1.0


def mm_per_unit(texture: SolidTexture, options: Options, why: str) -> float:
    """Mm per unit of the texture.

    Raises
    ------
    UsageError
        When neither the texture nor the options know.
    """
    if options.pixel_size_mm is not None:
        return options.pixel_size_mm / (texture.pixel_size or 1.0)
    if texture.unit == "mm":
        return 1.0
    what = f"the texture is in {texture.unit}, {why} needs mm: give --pixel-size, the mm per px of the photograph"
    raise UsageError("The size of the wood is not known", [Problem("", what)])
