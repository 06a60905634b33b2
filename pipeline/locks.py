"""One writer per result, also between runs: a lock the system releases when its holder dies."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class Lock:
    """An advisory lock on a file, held by an open descriptor."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self.path = path
        self._descriptor: int | None = descriptor

    @classmethod
    def try_acquire(cls, path: Path) -> Lock | None:
        """Take the lock, or return ``None`` at once if another holds it."""
        path.parent.mkdir(parents=True, exist_ok=True)
        while True:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(descriptor)
                return None
            if _is_same_file(descriptor, path):
                return cls(path, descriptor)
            os.close(descriptor)  # the holder removed the file between our opening and locking it

    def release(self, remove: bool = False) -> None:
        """Give the lock back; with `remove`, delete its file while still holding it."""
        if self._descriptor is not None:
            if remove:
                self.path.unlink(missing_ok=True)
            os.close(self._descriptor)
            self._descriptor = None


@contextmanager
def try_lock(path: Path) -> Iterator[bool]:
    """Hold the lock within the block if it is free; yields whether it is held."""
    lock = Lock.try_acquire(path)
    try:
        yield lock is not None
    finally:
        if lock is not None:
            lock.release()


def _is_same_file(descriptor: int, path: Path) -> bool:
    try:
        there = os.stat(path)
    except FileNotFoundError:
        return False
    here = os.fstat(descriptor)
    return (here.st_ino, here.st_dev) == (there.st_ino, there.st_dev)
