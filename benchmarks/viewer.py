"""Time to the first frame of a texture's page in headless Chromium, its size, and a full frame relative to the first.

python benchmarks/viewer.py [TEXTURE]
"""

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from board_texture import board_texture
from browser import chromium

from pipeline.viewer import write_viewer


def main() -> None:
    with tempfile.TemporaryDirectory() as folder, chromium() as driver:
        page = write_viewer(board_texture(), Path(folder) / "wood.html", "wood")
        driver.get(page.as_uri())
        while not (ready := driver.execute_script("return document.body.dataset.ready")):
            time.sleep(0.05)
        time.sleep(1.0)
        whole = driver.execute_script("const s = performance.now(); woodpipe.draw(true); return performance.now() - s")
        print(f"first frame after {float(ready) / 1000:.2f} s, {page.stat().st_size / 1e6:.2f} MB")
        print(f"a frame of all pixels takes {whole / float(ready):.1f} times that, drawn in software")


if __name__ == "__main__":
    main()
