"""The texture of benchmarks of carving, rendering and the page: named on the command line, or of a drawn board."""

import sys
import tempfile
from pathlib import Path

from typer.testing import CliRunner

from pipeline.cli import app
from woodfit import SolidTexture
from woodfit.synthetic_scenes import write_sample


def board_texture() -> SolidTexture:
    """Open the texture of the first argument, or run a flat-sawn board of 750 x 735 px."""
    if len(sys.argv) > 1:
        return SolidTexture.open(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        scan = next(path for path in write_sample(Path(folder) / "scans", (735, 750), 0) if path.stem == "flat_sawn")
        config = Path(folder) / "one.yaml"
        config.write_text(f"scans: {scan}\noutput: out\n")
        done = CliRunner().invoke(app, ["run", str(config)])
        if done.exit_code:
            raise SystemExit(done.output)
        return SolidTexture.open(Path(folder) / "out" / scan.stem / "texture.zarr.zip")
