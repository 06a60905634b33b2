"""The command that writes the page to hold the wood in the hand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli_app import DebugOption, app, told_to_people
from pipeline.cli_carve import TextureOption


@app.command()
def view(
    texture: TextureOption,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The .html to write; default: viewer.html beside it.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="What the page calls the wood; default: its folder.")] = None,
    debug: DebugOption = False,
) -> None:
    """Write one HTML page of a texture: turn it, cut it, read its rings, put it on a mesh of your own."""
    with told_to_people(debug):
        from pipeline.carve.carving import open_texture
        from pipeline.viewer import write_viewer

        opened = open_texture(texture)
        print(write_viewer(opened, out or texture.with_name("viewer.html"), name or texture.absolute().parent.name))
