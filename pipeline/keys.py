"""What a result is called: a hash of everything that can change its values, and of nothing else."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.reading import READER_VERSION

KEY_LENGTH = 32


def canonical(value: Any) -> str:
    """JSON with sorted keys and no spaces: equal values, equal text."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def key_of(value: Any) -> str:
    """Key of a JSON value."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()[:KEY_LENGTH]


def source_key(content: str) -> str:
    """Key of a scan as read: its file's content and the version of the reader."""
    return key_of({"content": content, "reader": READER_VERSION})


def stage_key(name: str, version: int, params: Mapping[str, Any], inputs: Mapping[str, str]) -> str:
    """Key of a stage's result from its full parameters and its inputs' keys."""
    return key_of({"stage": name, "version": version, "params": params, "inputs": inputs})


def product_key(name: str, version: int, image: str, inputs: Mapping[str, str]) -> str:
    """Key of a product; it names the image's file, so that name belongs to it."""
    return key_of({"product": name, "version": version, "image": image, "inputs": inputs})


def joint_key(parts: Any) -> str:
    """One key in place of those of several faces, or of where they lie."""
    return key_of({"faces": parts})


def hash_file(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def hash_tree(folder: Path) -> str:
    """SHA-256 over the names and bytes of every file below a folder."""
    digest = hashlib.sha256()
    for path in sorted(child for child in folder.rglob("*") if child.is_file()):
        digest.update(f"{path.relative_to(folder).as_posix()}\0{path.stat().st_size}\0".encode())
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()[:KEY_LENGTH]
