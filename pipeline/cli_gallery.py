"""The command that draws the gallery."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli_app import DEFAULT_CONFIG, DebugOption, OptionalConfig, app, told_to_people


@app.command()
def gallery(
    config: OptionalConfig = DEFAULT_CONFIG,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where to write; made if need be.")] = Path(
        "gallery"
    ),
    side: Annotated[int, typer.Option(min=64, max=2048, metavar="PX", help="Height of a row.")] = 360,
    spp: Annotated[int, typer.Option(min=1, help="Samples per pixel of what is rendered.")] = 64,
    mesh: Annotated[str, typer.Option(metavar="MESH", help="What is carved: a mesh, or sample:NAME.")] = "sample:bowl",
    debug: DebugOption = False,
) -> None:
    """Draw the results figure of a finished run: photograph, rings, front, carved, inside, colors."""
    with told_to_people(debug):
        from pipeline.gallery import Look, make_gallery
        from pipeline.project import Project

        for path in make_gallery(Project.load(config).config, out, Look(side, spp, mesh), print):
            print(path)
