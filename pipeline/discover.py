"""Finding the scans that a config names: folders, files, globs, or a list of these."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pipeline.problems import Problem, join_path

IMAGE_SUFFIXES = frozenset(
    [
        ".png",
        ".jpg",
        ".jpeg",
        ".jpe",
        ".jfif",
        ".tif",
        ".tiff",
        ".exr",
        ".jp2",
        ".j2k",
        ".jxl",
        ".webp",
        ".bmp",
        ".ppm",
        ".pgm",
        ".pnm",
    ]
)


def find_scans(
    wanted: str | Sequence[str], root: Path, output: Path | None = None
) -> tuple[tuple[Path, ...], list[Problem]]:
    """List the scans named by `wanted`, sorted and without repeats, and what is wrong with the naming.

    A folder gives the images directly in it; a glob gives the images it matches, ``**`` for subfolders too;
    a file named in full is taken whatever its suffix. Hidden files and everything below `output` are left out.
    """
    entries = [wanted] if isinstance(wanted, str) else list(wanted)
    problems = [] if entries else [Problem("scans", "is empty")]
    found: dict[Path, None] = {}
    for index, entry in enumerate(entries):
        where = "scans" if isinstance(wanted, str) else join_path("scans", index)
        paths, problem = _expand(entry, root, output)
        found.update(dict.fromkeys(paths))
        if problem:
            problems.append(Problem(where, problem))
    return tuple(sorted(found)), problems


def is_image_name(path: Path) -> bool:
    """Whether the name looks like an image's and is not hidden."""
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")


def _expand(entry: str, root: Path, output: Path | None) -> tuple[list[Path], str]:
    path = _absolute(Path(entry).expanduser(), root)
    if not entry.strip():
        return [], "is empty"
    if path.is_dir() and not is_image_name(path):
        images = [child for child in sorted(path.iterdir()) if is_image_name(child)]
        if images:
            return images, ""
        hint = f"; for its subfolders write {entry.rstrip('/')}/**/*" if any(map(Path.is_dir, path.iterdir())) else ""
        return [], f"no images in the folder {entry!r}{hint}"
    if path.exists():
        return [path], ""
    if any(char in entry for char in "*?["):
        images = [match for match in _glob(path) if output is None or not match.is_relative_to(_absolute(output, root))]
        return images, "" if images else f"no image matches {entry!r}"
    return [], f"there is no file or folder {entry!r} (looked for {path})"


def _glob(pattern: Path) -> list[Path]:
    """Images that `pattern` matches, none of them in a hidden folder below its fixed part."""
    depth = next(index for index, part in enumerate(pattern.parts) if any(char in part for char in "*?["))
    base = Path(*pattern.parts[:depth])
    found = base.glob(str(Path(*pattern.parts[depth:])))
    return sorted(
        p for p in found if is_image_name(p) and not any(x.startswith(".") for x in p.relative_to(base).parts)
    )


def _absolute(path: Path, root: Path) -> Path:
    """Absolute and free of ``..``, links kept as they are."""
    import os

    return Path(os.path.normpath(root / path))
