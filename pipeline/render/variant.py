"""Which Mitsuba variant works on this machine: LLVM where its library is found and sound, scalar otherwise."""

from __future__ import annotations

import glob
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

from pipeline.extras import need
from pipeline.problems import Problem, UsageError

#: With older libraries Dr.Jit aborts the whole process; so each is tried in a process of its own.
_OLDEST_LLVM = 17

_PLACES = ("/usr/lib/*/libLLVM*.so*", "/usr/lib/llvm-*/lib/libLLVM*.so*", "/usr/local/lib/libLLVM*.so*")

_TRIAL = (
    "import mitsuba as mi; mi.set_variant('llvm_ad_rgb'); import drjit as dr; "
    "x = dr.sum(dr.arange(mi.Float, 10)); assert abs(float(x[0]) - 45) < 1e-6; print('works')"
)


@dataclass(frozen=True)
class Variant:
    """A Mitsuba variant.

    Attributes
    ----------
    name : str
        ``llvm_ad_rgb`` or ``scalar_rgb``.
    library : str
        Path of the LLVM library; empty for scalar.
    said : str
        Why this one, for people.
    """

    name: str
    library: str
    said: str

    @property
    def vectorised(self) -> bool:
        """Whether arrays of Dr.Jit are at hand."""
        return self.name.startswith("llvm")


def choose_variant(wish: str = "auto") -> Variant:
    """Find a variant that works.

    Parameters
    ----------
    wish : str
        ``auto``, ``llvm`` or ``scalar``.

    Raises
    ------
    UsageError
        When Mitsuba is not installed, or LLVM is asked for and does not work.
    """
    if wish not in ("auto", "llvm", "scalar"):
        problem = Problem("--variant", f"found {wish!r}, expected auto, llvm or scalar")
        raise UsageError("The command cannot be followed", [problem])
    need("mitsuba", "render", "to render")
    if wish == "scalar":
        return Variant("scalar_rgb", "", "scalar, as asked")
    tried = []
    for library in llvm_libraries():
        if works(library):
            return Variant("llvm_ad_rgb", library, f"LLVM ({library})")
        tried.append(library)
    why = f"none of these worked: {', '.join(tried)}" if tried else "no LLVM library of version 17 or newer was found"
    advice = "install one (on Debian and Ubuntu: libllvm19), or name it in DRJIT_LIBLLVM_PATH"
    if wish == "llvm":
        raise UsageError("The command cannot be followed", [Problem("--variant", f"{why}; {advice}")])
    return Variant("scalar_rgb", "", f"scalar, which is far slower and reads the wood from a grid: {why}; {advice}")


def llvm_libraries() -> list[str]:
    """Candidates, the best first: the one that the environment names, then the newest."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if named:
        return [named]
    found = {os.path.realpath(path): path for pattern in _PLACES for path in glob.glob(pattern)}
    usable = [path for path in found if _version(path) >= _OLDEST_LLVM]
    return sorted(usable, key=_version, reverse=True)


def _version(path: str) -> int:
    numbers = re.search(r"libLLVM[-.](?:so\.)?(\d+)", os.path.basename(path))
    return int(numbers[1]) if numbers else 0


def works(library: str) -> bool:
    """Whether Mitsuba runs with an LLVM library, tried in a process of its own."""
    environment = os.environ | {"DRJIT_LIBLLVM_PATH": library}
    try:
        done = subprocess.run(
            [sys.executable, "-c", _TRIAL], env=environment, capture_output=True, text=True, timeout=120, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0 and "works" in done.stdout


def start(variant: Variant) -> Any:
    """Mitsuba with a variant set."""
    if variant.library:
        os.environ["DRJIT_LIBLLVM_PATH"] = variant.library
    mitsuba = need("mitsuba", "render", "to render")
    if mitsuba.variant() != variant.name:
        mitsuba.set_variant(variant.name)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    return mitsuba
