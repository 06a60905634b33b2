"""The command that renders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli_app import DebugOption, app, told_to_people
from pipeline.cli_carve import TextureOption


@app.command()
def render(
    preset: Annotated[
        str, typer.Argument(metavar="PRESET", help="front, block, carved, veneer, lampshade or false-color.")
    ],
    texture: TextureOption,
    mesh: Annotated[
        str, typer.Option(metavar="MESH", help="What `carved` carves: OBJ, PLY, STL, GLB, or sample:NAME.")
    ] = "sample:bowl",
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The .png to write; default: PRESET.png here.")
    ] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Size of the picture, px.")] = "512x512",
    spp: Annotated[int | None, typer.Option(min=1, help="Samples per pixel; default: the preset's own.")] = None,
    preview: Annotated[bool, typer.Option("--preview", help="A quick one, with few samples.")] = False,
    pixel_size: Annotated[
        float | None,
        typer.Option(min=1e-6, metavar="MM", help="mm per px of the photograph, if not the texture's."),
    ] = None,
    variant: Annotated[str, typer.Option(help="Mitsuba's: auto, llvm or scalar.")] = "auto",
    detail: Annotated[bool, typer.Option("--detail/--no-detail", help="With or without fine grain.")] = True,
    denoise: Annotated[bool, typer.Option("--denoise/--no-denoise", help="Denoise the picture.")] = True,
    debug: DebugOption = False,
) -> None:
    """Render the wood with Mitsuba 3: as a block, carved, as backlit veneer, as a lampshade, in false color."""
    with told_to_people(debug):
        from pipeline.carve.carving import open_texture
        from pipeline.commands import parse_size
        from pipeline.render.writing import render_file

        width, height = parse_size(size)
        options = {
            "size": (width, height),
            "spp": spp,
            "mesh": mesh,
            "detail": detail,
            "pixel_size_mm": pixel_size,
            "variant": variant,
            "denoise": denoise,
            "preview": preview,
        }
        print(render_file(preset, open_texture(texture), out or Path(f"{preset}.png"), options, print))
