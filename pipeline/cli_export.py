"""The command that exports."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli_app import DebugOption, app, told_to_people
from pipeline.cli_carve import TextureOption


@app.command()
def export(
    texture: TextureOption,
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="NAMES",
            help="materialx, osl, blender, usd, vdb, mitsuba, threejs, slices, faces, sheet, liu, or all.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where to write; a folder for each.")] = Path(
        "export"
    ),
    name: Annotated[str | None, typer.Option(help="Begins the files' names; default: the texture's folder.")] = None,
    cells: Annotated[int, typer.Option(help="Cells or px along the block's longest side (volumes, pictures).")] = 256,
    slices: Annotated[int, typer.Option(help="Slices across each axis.")] = 5,
    dpi: Annotated[float, typer.Option(help="Of the printed sheet.")] = 300.0,
    depth: Annotated[float, typer.Option(metavar="MM", help="How deep behind the face the sheet is cut.")] = 0.0,
    pixel_size: Annotated[
        float | None, typer.Option(metavar="MM", help="mm per px of the photograph, if not the texture's.")
    ] = None,
    mesh: Annotated[str | None, typer.Option(metavar="MESH", help="A mesh to dress (usd); default: the block.")] = None,
    map_px: Annotated[int, typer.Option("--map", metavar="PX", help="Texels along a side of baked maps.")] = 2048,
    detail: Annotated[bool, typer.Option("--detail/--no-detail", help="With or without fine grain.")] = True,
    debug: DebugOption = False,
) -> None:
    """Write the wood in the formats of other programs.

    What fails is told in a line and stops no other; the exit status is then 1.
    """
    with told_to_people(debug):
        from pipeline.carve.carving import open_texture
        from pipeline.export.registry import Options, export_all, exporters_named

        options = Options(
            name or texture.absolute().parent.name, cells, slices, dpi, depth, detail, pixel_size, mesh, map_px
        )
        exporters = exporters_named(to)
        files, problems = export_all(open_texture(texture), exporters, out, options)
    for path in files:
        print(path)
    for line in problems:
        print(line, file=sys.stderr)
    raise typer.Exit(1 if problems else 0)
