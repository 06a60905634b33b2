"""Time to carve a mesh of 200,000 triangles at 2k, and its parts relative to the whole."""

import time

import numpy as np

from pipeline.carve.atlas import atlas_of
from pipeline.carve.carving import Wish, carve
from pipeline.carve.mesh_files import Mesh
from pipeline.carve.sample_meshes import sample_mesh
from woodfit.synthetic_scenes import write_sample


def main() -> None:
    import sys
    import tempfile
    from pathlib import Path

    from typer.testing import CliRunner

    from pipeline.cli import app
    from woodfit import SolidTexture

    if len(sys.argv) > 1:
        texture = SolidTexture.open(sys.argv[1])
    else:
        with tempfile.TemporaryDirectory() as folder:
            scan = next(path for path in write_sample(Path(folder) / "scans", (735, 750), 0) if "flat" in path.name)
            config = Path(folder) / "one.yaml"
            config.write_text(f"scans: {scan}\noutput: out\n")
            CliRunner().invoke(app, ["run", str(config)])
            texture = SolidTexture.open(Path(folder) / "out" / scan.stem / "texture.zarr.zip")
    mesh = Mesh(*sample_mesh("knot", 225), None, "knot")
    start = time.perf_counter()
    atlas_of(mesh, 2048)
    charts = time.perf_counter() - start
    start = time.perf_counter()
    carve(mesh, texture, Wish(2048))
    whole = time.perf_counter() - start
    print(f"{len(mesh.faces):,} triangles, 2k: {whole:.1f} s; charts take {charts / whole:.0%} of it")
    plain = time.perf_counter()
    texture.evaluate(np.random.default_rng(0).uniform(0, 50, (1_000_000, 3)), detail=False)
    plain = time.perf_counter() - plain
    fine = time.perf_counter()
    texture.evaluate(np.random.default_rng(0).uniform(0, 50, (1_000_000, 3)))
    fine = time.perf_counter() - fine
    print(f"a point with fine grain takes {fine / plain:.1f} times one without")


if __name__ == "__main__":
    main()
