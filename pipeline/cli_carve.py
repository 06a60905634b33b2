"""The command that carves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli_app import DebugOption, app, told_to_people

TextureOption = Annotated[Path, typer.Option("--texture", metavar="FILE", help="A texture.zarr.zip of a run.")]


@app.command()
def carve(
    mesh: Annotated[
        str, typer.Argument(metavar="MESH", help="OBJ, PLY, STL or GLB; or sample:bowl, pawn, knot, ball.")
    ],
    texture: TextureOption,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The .glb to write; default: carved_MESH.glb here.")
    ] = None,
    size: Annotated[str, typer.Option("--size", help="Texels along a side of the maps: 1k, 2k, 4k, 8k.")] = "2k",
    position: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Where the middle goes, board frame; default: of the block.")
    ] = None,
    rotate: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Degrees about the board's axes; default: longest along the grain."),
    ] = None,
    scale: Annotated[
        float | None, typer.Option(help="Units of the texture per unit of the mesh; default: as large as fits.")
    ] = None,
    detail: Annotated[bool, typer.Option("--detail/--no-detail", help="With or without fine grain.")] = True,
    debug: DebugOption = False,
) -> None:
    """Cut a mesh from the wood: one GLB with baked maps, the maps, and where in the log it was.

    MESH keeps its own places and size in the GLB; where it lies in the block
    only decides which wood it shows. A negative first number needs `=`, as in
    --position=-5,0,2.
    """
    with told_to_people(debug):
        from pipeline.carve.carving import Wish, carve_file, parse_size, parse_triple

        wish = Wish(
            parse_size(size),
            parse_triple(position, "--position"),
            parse_triple(rotate, "--rotate"),
            scale,
            detail,
        )
        name = Path(mesh.removeprefix("sample:")).stem
        files, words = carve_file(mesh, texture, out or Path(f"carved_{name}.glb"), wish)
        for line in words:
            print(line)
        for path in files:
            print(path)
