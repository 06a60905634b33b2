"""Time to carve a mesh of 200,000 triangles at 2k, and its parts relative to the whole."""

import time

import numpy as np
from board_texture import board_texture

from pipeline.carve.atlas import atlas_of
from pipeline.carve.carving import Wish, carve
from pipeline.carve.mesh_files import Mesh
from pipeline.carve.sample_meshes import sample_mesh


def main() -> None:
    texture = board_texture()
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
