"""Parameters that are files: the YAML names them, the scan's parameters hold what is in them."""

from __future__ import annotations

import difflib
import glob
import os
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel

from pipeline.problems import Problem, ScanError, join_path
from stages.stage import InputFile

MOST_BYTES = 16 * 2**20
_PLACEHOLDER = re.compile(r"\{([^{}]*)\}")


def check_files(
    values: Mapping[str, Any], model: type[BaseModel], root: Path, *prefix: str | int
) -> tuple[dict[str, Any], list[Problem]]:
    """Values with nothing in place of the files that are named rightly, and what is wrong with the naming.

    Parameters
    ----------
    values
        Parameters of one stage as written.
    model
        The stage's parameters.
    root
        Folder that relative paths start from.
    prefix
        Where in the YAML the values stand.
    """
    kept, problems = dict(values), []
    for name, takes_many in _file_fields(model):
        if values.get(name) is None:
            continue
        kept[name] = () if takes_many else None
        for where, entry in _entries(values[name], takes_many, join_path(*prefix, name)):
            problem = _wrong_name(entry, takes_many, root)
            problems += [Problem(where, problem)] if problem else []
    return kept, problems


def read_files(
    values: Mapping[str, Any], model: type[BaseModel], root: Path, stem: str, others: Collection[str] = ()
) -> dict[str, Any]:
    """Values with the files that are there for one scan in place of their paths.

    Parameters
    ----------
    values, model, root
        As in `check_files`.
    stem
        Name of the scan without suffix.
    others
        Names of other scans: of ``core_1`` and ``core_10`` only the second has ``core_10.pos`` for ``{stem}*.pos``.

    Raises
    ------
    ScanError
        For a file that is there and cannot be read as text.
    """
    read = dict(values)
    longer = [other for other in others if other != stem and other.startswith(stem)]
    for name, takes_many in _file_fields(model):
        if values.get(name) is None:
            if name in values and takes_many:
                read[name] = ()
            continue
        entries = [entry for _, entry in _entries(values[name], takes_many, name)]
        paths: dict[Path, None] = {}
        for entry in entries:
            rivals = longer if "{stem}" in entry else []
            theirs = {path for other in rivals for path in _paths(entry, takes_many, root, other)}
            paths.update((path, None) for path in _paths(entry, takes_many, root, stem) if path not in theirs)
        files = tuple(_read(path) for path in paths)
        read[name] = files if takes_many else next(iter(files), None)
    return read


def stored_files(value: Any) -> list[InputFile] | None:
    """Files of a parameter as records keep it, none of them for nothing; None for a parameter that is no file."""
    files = [] if value is None else value if isinstance(value, list) else [value]
    if not all(isinstance(file, dict) and set(file) == set(InputFile.model_fields) for file in files):
        return None
    return [InputFile.model_validate(file) for file in files]


def without_texts(value: Any) -> Any:
    """Value of a parameter as records keep it, for people: files by their names."""
    files = stored_files(value)
    return ", ".join(file.name for file in files) if files else value


def _file_fields(model: type[BaseModel]) -> Iterator[tuple[str, bool]]:
    """Names of the fields that are files, and whether each takes several."""
    for name, field in model.model_fields.items():
        kinds = get_args(field.annotation) or (field.annotation,)
        if InputFile in kinds:
            yield name, Ellipsis in kinds


def _entries(value: Any, takes_many: bool, where: str) -> list[tuple[str, Any]]:
    """Each path as written, with its place in the YAML."""
    if takes_many and isinstance(value, list | tuple):
        return [(join_path(where, index), entry) for index, entry in enumerate(value)]
    return [(where, value)]


def _wrong_name(entry: Any, takes_many: bool, root: Path) -> str:
    """What is wrong with a path as written, before any scan is looked at; empty if nothing is."""
    if not isinstance(entry, str) or not entry.strip():
        return f"expected a path relative to the YAML, found {entry!r}"
    if "\0" in entry:
        return f"{entry!r} is no path"
    for word in _PLACEHOLDER.findall(entry):
        if word != "stem":
            close = " (did you mean '{stem}'?)" if difflib.get_close_matches(word, ["stem"]) else ""
            return f"'{{{word}}}' is unknown in {entry!r}, only '{{stem}}' is replaced{close}"
    if "{stem}" in entry or (takes_many and glob.has_magic(entry)):
        return ""
    path = _absolute(entry, root)
    if not path.exists():
        return f"there is no file {entry!r} (looked for {path})"
    return "" if path.is_file() else f"{entry!r} is not a file"


def _paths(entry: str, takes_many: bool, root: Path, stem: str) -> list[Path]:
    """Files that a path as written means for one scan; none when there is none."""
    if takes_many and glob.has_magic(entry):
        # A stem such as `core[1]` stands for itself.
        pattern = entry.replace("{stem}", glob.escape(stem))
        found = glob.iglob(os.path.expanduser(pattern), root_dir=root, recursive=True)
        return sorted(path for path in (_absolute(match, root) for match in found) if not path.is_dir())
    path = _absolute(entry.replace("{stem}", stem), root)
    return [path] if path.exists() else []


def _absolute(entry: str, root: Path) -> Path:
    return Path(os.path.normpath(root / Path(entry).expanduser()))


def _read(path: Path) -> InputFile:
    """Content of a text file."""
    from woodfit.dendro.series import FormatError
    from woodfit.dendro.text import decode

    if not path.is_file():
        raise ScanError(f"{path} is not a file, expected a text file")
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise ScanError(f"{path} cannot be read: {error.strerror or error}") from None
    if len(content) > MOST_BYTES:
        raise ScanError(f"{path} is larger than {MOST_BYTES >> 20} MB, expected a text file")
    try:
        return InputFile(name=path.name, text=decode(content, path.name))
    except FormatError as error:
        raise ScanError(f"{path.parent}{os.sep}{error}") from None
