"""Time of every preset at 512 x 512 with its own samples, relative to `block`; and of its preview.

python benchmarks/rendering.py [TEXTURE]
"""

import time

from board_texture import board_texture

from pipeline.render import PRESETS, render_preset


def main() -> None:
    texture = board_texture()
    times = {}
    for name in ("block", *(name for name in PRESETS if name != "block")):
        for preview in (True, False):
            start = time.perf_counter()
            render_preset(name, texture, (512, 512), preview=preview)
            times[name, preview] = time.perf_counter() - start
        whole, quick = times[name, False], times[name, True]
        print(f"{name:12s} {whole:6.1f} s = {whole / times['block', False]:5.1f} blocks; preview {quick:5.1f} s")


if __name__ == "__main__":
    main()
