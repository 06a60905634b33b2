"""Threads and imports of the libraries inside one worker."""

from __future__ import annotations

import contextlib
import os
import sys
import threading

# OpenMP's threads sleep between two kernels rather than spin; read when the library starts, in workers too.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

HEAVY = ("numba", "cv2", "scipy.ndimage", "xarray", "zarr", "stages")
_preloading: list[threading.Thread] = []


def limit_threads(count: int) -> None:
    """Set the threads of those libraries that are loaded, once what is preloaded is there."""
    for thread in _preloading:
        thread.join()
    if (torch := sys.modules.get("torch")) is not None and hasattr(torch, "set_num_threads"):
        torch.set_num_threads(count)
    if (cv2 := sys.modules.get("cv2")) is not None and hasattr(cv2, "setNumThreads"):
        cv2.setNumThreads(count)
    if (numba := sys.modules.get("numba")) is not None and hasattr(numba, "set_num_threads"):
        numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))


def preload_in_background(modules: tuple[str, ...]) -> None:
    """Import modules while the worker waits for its first job; `limit_threads` waits for that."""
    if modules:
        thread = threading.Thread(target=_import_all, args=(modules,), daemon=True)
        _preloading.append(thread)
        thread.start()


def _import_all(modules: tuple[str, ...]) -> None:
    import importlib

    for module in modules:
        with contextlib.suppress(ImportError):
            importlib.import_module(module)
