"""The YAML file: which scans, where to, and the parameters that differ from their defaults.

What changes results (the stages' parameters) is apart from what only changes how they are computed
(:class:`Execution`); the second never enters a key.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, PositiveInt, ValidationError

from pipeline.blocks import Block, clashing_names, read_blocks
from pipeline.discover import find_scans
from pipeline.input_files import check_files, read_files
from pipeline.problems import Problem, UsageError, did_you_mean, join_path, problem_of, validation_problems

if TYPE_CHECKING:
    from stages.stage import Params, Stage

CHUNK = 1024

StageSettings = dict[str, dict[str, Any] | None]


class Execution(BaseModel):
    """How to compute, never what: nothing here may change a value."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    workers: PositiveInt | None = None
    """Worker processes; by default one per core."""
    tile: Annotated[int, Field(ge=CHUNK, multiple_of=CHUNK)] = 2 * CHUNK
    """Side of the tiles that large scans are cut into, px."""
    scheduler: str = "auto"
    """``local`` for a cluster of its own, ``tcp://...`` for an existing one, ``threads`` for this process; ``auto``
    takes this process for one scan of few pixels and a cluster for anything more."""


class Override(BaseModel):
    """Other parameters for some of the scans."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scans: str
    stages: StageSettings


class _File(BaseModel):
    """The YAML file as written."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scans: str | list[str] = []
    block: Any = None
    output: str
    stages: StageSettings = {}
    overrides: list[Override] = []
    execution: Execution = Execution()


class Config(BaseModel):
    """A checked configuration, with absolute paths."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    path: Path
    scans: tuple[Path, ...]
    blocks: tuple[Block, ...] = ()
    output: Path
    stages: StageSettings
    overrides: tuple[Override, ...]
    execution: Execution

    def selected(self, pattern: str | None) -> tuple[list[Path], list[Block]]:
        """Scans and blocks that a pattern names, all without one; a block brings its faces."""
        root = self.path.parent
        blocks = [block for block in self.blocks if pattern is None or matches(block.path, pattern, root)]
        faces = {scan for block in blocks for scan in block.scans}
        return [s for s in self.scans if pattern is None or s in faces or matches(s, pattern, root)], blocks

    @property
    def names(self) -> tuple[Path, ...]:
        """Scans, then blocks, as the command line names them."""
        return (*self.scans, *(block.path for block in self.blocks))

    def params(self, scan: Path, stages: Sequence[Stage]) -> dict[str, Params]:
        """Full parameters of every stage for one scan, or one block by its path.

        Raises
        ------
        ScanError
            Where a file among them cannot be read.
        """
        chosen: dict[str, dict[str, Any]] = {name: dict(values or {}) for name, values in self.stages.items()}
        for override in self.overrides:
            if matches(scan, override.scans, self.path.parent):
                for name, values in override.stages.items():
                    chosen.setdefault(name, {}).update(values or {})
        others = {other.stem for other in self.names}
        full = {}
        for stage in stages:
            model = stage.params_type
            values = read_files(chosen.get(stage.name, {}), model, self.path.parent, scan.stem, others)
            full[stage.name] = model.model_validate(values)
        return full


def matches(scan: Path, pattern: str, root: Path) -> bool:
    """Whether `pattern` names the scan: by file name, by stem, or by its path from `root`."""
    names = [scan.name, scan.stem, scan.as_posix()]
    if scan.is_relative_to(root):
        names.append(scan.relative_to(root).as_posix())
    return any(fnmatch(name, pattern) for name in names)


def load_config(path: Path, stages: Sequence[Stage]) -> Config:
    """Read and check a YAML config; raise one `UsageError` with everything that is wrong with it."""
    path = path.absolute()
    title = f"{path.name} cannot be used"
    raw = _read_yaml(path, title)
    problems: list[Problem] = []
    file = None
    try:
        file = _File.model_validate(raw)
    except ValidationError as error:
        problems += [problem_of(item, _known_keys(item["loc"])) for item in error.errors()]
    problems += _stage_problems(raw, stages, path.parent)
    scans: tuple[Path, ...] = ()
    wanted = raw.get("scans")
    if isinstance(wanted, str) or (isinstance(wanted, list) and all(isinstance(item, str) for item in wanted)):
        output = path.parent / str(raw.get("output", "")) if isinstance(raw.get("output"), str) else None
        scans, more = find_scans(wanted, path.parent, output)
        problems += more
    blocks, more = read_blocks(raw.get("block"), path.parent)
    scans = tuple(sorted({*scans, *(scan for block in blocks for scan in block.scans)}))
    problems += [*more, *clashing_names(blocks, scans)]
    if "scans" not in raw and not raw.get("block"):
        problems.append(Problem("scans", "is missing"))
    names = (*scans, *(block.path for block in blocks))
    for index, override in enumerate(_overrides(raw)):
        pattern = override.get("scans")
        if names and isinstance(pattern, str) and not any(matches(name, pattern, path.parent) for name in names):
            problems.append(Problem(join_path("overrides", index, "scans"), f"{pattern!r} matches no scan"))
    if problems or file is None:
        raise UsageError(title, sorted(set(problems)))
    return Config(
        path=path,
        scans=scans,
        blocks=blocks,
        output=path.parent / file.output,
        stages=file.stages,
        overrides=tuple(file.overrides),
        execution=file.execution,
    )


def _known_keys(loc: tuple[str | int, ...]) -> list[str]:
    models: dict[Hashable, type[BaseModel]] = {"overrides": Override, "execution": Execution}
    model = models.get(loc[0], _File) if len(loc) > 1 else _File
    return list(model.model_fields)


def _stage_problems(raw: Mapping[str, Any], stages: Sequence[Stage], root: Path) -> list[Problem]:
    """Check every stage's parameters, in ``stages`` and merged in each of ``overrides``."""
    base = raw.get("stages")
    base = base if isinstance(base, dict) else {}
    problems = _settings_problems(base, {}, stages, root, ("stages",))
    for index, override in enumerate(_overrides(raw)):
        settings = override.get("stages")
        if isinstance(settings, dict):
            problems += _settings_problems(settings, base, stages, root, ("overrides", index, "stages"))
    return problems


def _overrides(raw: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """List the overrides as far as they can be understood, each in its place."""
    overrides = raw.get("overrides")
    return [item if isinstance(item, dict) else {} for item in overrides] if isinstance(overrides, list) else []


def _settings_problems(
    settings: Mapping[Any, Any],
    base: Mapping[Any, Any],
    stages: Sequence[Stage],
    root: Path,
    prefix: tuple[str | int, ...],
) -> list[Problem]:
    by_name = {stage.name: stage for stage in stages}
    problems = []
    for name, values in settings.items():
        if name not in by_name:
            problems.append(Problem(join_path(*prefix, str(name)), "no such stage" + did_you_mean(str(name), by_name)))
            continue
        if not isinstance(values, dict | None):
            problems.append(Problem(join_path(*prefix, name), f"expected parameters with values, found {values!r}"))
            continue
        below = base.get(name)
        below = below if isinstance(below, dict) else {}
        model = by_name[name].params_type
        merged = {**{k: v for k, v in below.items() if k in model.model_fields}, **(values or {})}
        merged, found = check_files(merged, model, root, *prefix, name)
        try:
            model.model_validate(merged)
        except ValidationError as error:
            found += validation_problems(error, model.model_fields, *prefix, name)
        here = join_path(*prefix, name)
        inherited = tuple(join_path(here, str(key)) for key in below if key not in (values or {}))
        problems += [problem for problem in found if not problem.where.startswith(inherited)]
    return problems


def _read_yaml(path: Path, title: str) -> dict[str, Any]:
    """Parse the file into a mapping."""
    import yaml

    try:
        raw = yaml.load(path.read_text(encoding="utf-8"), Loader=_strict_loader())
    except FileNotFoundError:
        near = [other.name for other in path.parent.glob("*.y*ml")] if path.parent.is_dir() else []
        raise UsageError(title, [Problem("", f"there is no file {path}" + did_you_mean(path.name, near))]) from None
    except IsADirectoryError:
        raise UsageError(title, [Problem("", f"{path} is a folder, expected a YAML file")]) from None
    except (UnicodeDecodeError, PermissionError) as error:
        raise UsageError(title, [Problem("", f"cannot be read: {error}")]) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise UsageError(title, [Problem(where, f"not valid YAML: {error.problem}")]) from None
    except yaml.YAMLError as error:
        raise UsageError(title, [Problem("", f"not valid YAML: {' '.join(str(error).split())}")]) from None
    if not isinstance(raw, dict):
        found = "an empty file" if raw is None else f"a {type(raw).__name__}"
        raise UsageError(title, [Problem("", f"expected keys `scans` and `output`, found {found}")])
    return {str(key): value for key, value in raw.items()}


def _strict_loader() -> Any:
    """Build a safe YAML loader that refuses a key given twice."""
    import yaml

    class Loader(yaml.SafeLoader):
        pass

    def mapping(loader: Any, node: Any) -> Any:
        seen: set[str] = set()
        for key, _ in node.value:
            if key.value in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key `{key.value}` is given twice", key.start_mark)
            seen.add(key.value)
        return yaml.SafeLoader.construct_mapping(loader, node, deep=True)

    Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, mapping)
    return Loader
