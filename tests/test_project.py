"""The project itself: what the layout, the docs and the declarations promise each other."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from pipeline.config import load_config
from stages import STAGES
from stages.stage import Stage
from woodfit import SolidTexture

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("pipeline", "stages", "woodfit")
HEADINGS = ("Purpose", "Method", "Limitations")
DOCS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])

# What a dependency is imported as where that is not its name, and those that only others import for us.
IMPORTED_AS = {
    "mitsuba-oidn": "mitsuba_oidn",
    "opencv-contrib-python-headless": "cv2",
    "pyyaml": "yaml",
    "scikit-image": "skimage",
    "usd-core": "pxr",
}
NOT_IMPORTED_BY_US = {"bokeh": "draws the Dask dashboard", "scikit-image": "part of the stack that users count on"}

each_stage = pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)


def sources() -> list[Path]:
    """Modules of the three packages."""
    return [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


def module_names() -> set[str]:
    """Dotted names of the three packages' modules, the packages themselves left out."""
    names = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in sources()}
    return names - set(PACKAGES)


def parameter_models(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """A parameter model and those nested in it, in unions too."""

    def inside(kind: Any) -> Iterator[type[BaseModel]]:
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from parameter_models(kind)
        for part in get_args(kind):
            yield from inside(part)

    yield model
    for field in model.model_fields.values():
        yield from inside(field.annotation)


def source_of(stage: Stage) -> str:
    """Text of the module that a stage is declared in."""
    return Path(str(sys.modules[stage.function.__module__].__file__)).read_text()


def pyproject() -> dict[str, Any]:
    """The project's metadata."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def distribution(requirement: str) -> str:
    """Normal name of a requirement such as ``dask[distributed]>=2025.1``."""
    return re.split(r"[\[<>=~! ;]", requirement, maxsplit=1)[0].lower().replace("_", "-")


def test_the_three_packages_load_from_one_parent_folder() -> None:
    parents = {Path(str(importlib.import_module(name).__file__)).resolve().parent.parent for name in PACKAGES}
    assert parents == {ROOT}


@each_stage
def test_a_stage_is_named_after_its_module(stage: Stage) -> None:
    assert stage.function.__module__ == f"stages.{stage.name}"


@each_stage
def test_a_stage_says_in_one_line_what_it_does(stage: Stage) -> None:
    assert stage.summary.endswith("."), f"first docstring line of {stage.name}: {stage.summary!r}"


@each_stage
def test_a_stage_has_a_page_with_purpose_method_and_limitations(stage: Stage) -> None:
    page = ROOT / "docs" / "stages" / f"{stage.name}.md"
    assert page.exists(), f"write {page.relative_to(ROOT)}"
    found = re.findall(r"^## (.+)$", page.read_text(), flags=re.MULTILINE)
    assert [heading for heading in HEADINGS if heading not in found] == [], f"headings missing in {page.name}"


@each_stage
def test_a_stage_page_tells_every_parameter_and_no_other(stage: Stage) -> None:
    text = (ROOT / "docs" / "stages" / f"{stage.name}.md").read_text()
    told = set(re.findall(r"^\| `(\w+)` \|", text, flags=re.MULTILINE))
    assert told == set(stage.params_type.model_fields), f"the table of parameters of docs/stages/{stage.name}.md"


@each_stage
def test_a_stage_has_tests(stage: Stage) -> None:
    others = [path for path in (ROOT / "tests").glob("test_*.py") if path != Path(__file__)]
    word = re.compile(rf"\b{stage.name}\b")
    assert any(word.search(path.read_text()) for path in others), f"no file in tests/ mentions {stage.name}"


@each_stage
def test_every_parameter_has_a_description(stage: Stage) -> None:
    silent = [
        f"{model.__name__}.{name}"
        for model in parameter_models(stage.params_type)
        for name, field in model.model_fields.items()
        if not (field.description or "").strip()
    ]
    assert silent == [], "put a string under the field: it is the help text of `woodpipe stages`"


@each_stage
def test_every_parameter_is_read_by_its_stage(stage: Stage) -> None:
    read = {node.attr for node in ast.walk(ast.parse(source_of(stage))) if isinstance(node, ast.Attribute)}
    fields = {name for model in parameter_models(stage.params_type) for name in model.model_fields}
    assert fields - read == set(), "a parameter that nothing reads only invalidates results when it changes"


def test_every_variable_that_a_stage_requires_has_one_provider() -> None:
    provided = [variable.name for stage in STAGES for variable in stage.provides]
    assert sorted(provided) == sorted(set(provided))


def test_no_module_path_in_the_example_config_nor_in_default_parameters() -> None:
    texts = [(ROOT / "pipeline.yaml").read_text(), *(stage.params_type().model_dump_json() for stage in STAGES)]
    assert [name for name in module_names() if any(name in text for text in texts)] == []


def test_no_module_path_in_keys_records_or_zarr_attributes(project: Any) -> None:
    from rich.console import Console

    dummies = importlib.import_module("dummy_stages")
    from pipeline.plan import Selection
    from pipeline.progress import PlainLines
    from pipeline.project import Project

    config = project(scans=1)
    loaded = Project.load(config, dummies.STAGES, dummies.PRODUCTS)
    loaded.run(Selection(), PlainLines(Console(quiet=True)), {"scheduler": "threads", "workers": 1})
    written = list((config.parent / "out").rglob("*.json"))
    assert any(path.name == "meta.json" for path in written)
    assert any(path.name == "zarr.json" for path in written)
    forbidden = {*module_names(), "dummy_stages"}
    found = {path.name: name for path in written for name in forbidden if name in path.read_text()}
    assert found == {}, "a module's path in what is stored ties results to where the code lies"


def test_no_module_path_in_a_saved_texture(tmp_path: Path) -> None:
    import numpy as np

    from woodfit.cylinder_grid import CylinderGrid

    axes = np.array([1.0, 2.0]), np.array([0.0, 1.0]), np.array([0.0, 1.0])
    texture = SolidTexture(
        board_to_tree=np.eye(4),
        grid=CylinderGrid(*axes, wraps=False),
        displacement=np.zeros((2, 2, 2), np.float32),
        ring_radius=np.array([0.0, 1.0, 2.0]),
        color_strip=np.zeros((8, 3), np.float32),
        lateness_strip=np.zeros(8, np.float32),
        samples_per_ring=4,
    )
    texture.save(tmp_path / "texture.zarr.zip")
    stored = (tmp_path / "texture.zarr.zip").read_bytes().decode("latin-1")
    assert [name for name in module_names() if name in stored] == []


def photos(folder: Path) -> None:
    """Files by the names that the examples use; their content is not looked at."""
    boards = ("samples/board.png", "photos/core_1.png", "photos/board_1.jpg", "photos/year/board_2.tif", "oak.png")
    faces = (*(f"photos/{name}.png" for name in ("front", "right", "top")), "cube/B.png", "cube/C.png")
    for name in (*boards, *faces, "cores/FCP01A_2019.png"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def test_the_example_config_validates(tmp_path: Path) -> None:
    photos(tmp_path)
    config = tmp_path / "pipeline.yaml"
    config.write_text((ROOT / "pipeline.yaml").read_text())
    assert load_config(config, STAGES).output == tmp_path / "out"


@pytest.mark.parametrize("page", DOCS, ids=lambda page: page.name)
def test_the_configs_shown_in_the_docs_validate(page: Path, tmp_path: Path) -> None:
    photos(tmp_path)
    for number, block in enumerate(re.findall(r"^```yaml\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)):
        whole = block if re.search(r"^(scans|block):", block, re.MULTILINE) else f"scans: photos\noutput: out\n{block}"
        config = tmp_path / f"{number}.yaml"
        config.write_text(whole)
        load_config(config, STAGES)


@pytest.mark.parametrize("page", DOCS, ids=lambda page: page.name)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text())
    broken = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert broken == []


def test_what_is_imported_is_declared_and_what_is_declared_is_imported() -> None:
    imported = set()
    for path in sources():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(str(node.module).split(".")[0])
    imported -= {*PACKAGES, *sys.stdlib_module_names}
    requirements = pyproject()["project"]["dependencies"]
    declared = {distribution(requirement) for requirement in requirements}
    extras = {extra for requirement in requirements for extra in re.findall(r"\[(\w+)\]", requirement)}
    # Of woodpipe's own extras only `dev` is not for users.
    optional = pyproject()["project"]["optional-dependencies"]
    extras |= {distribution(part) for name, parts in optional.items() if name != "dev" for part in parts}
    names = {IMPORTED_AS.get(name, name) for name in declared}
    extras = {IMPORTED_AS.get(name, name) for name in extras}
    assert {name.lower() for name in imported} - names - extras == set(), "imported, not declared"
    unused = {name for name in declared if IMPORTED_AS.get(name, name) not in {name.lower() for name in imported}}
    assert unused - set(NOT_IMPORTED_BY_US) == set(), "declared, not imported"


def test_every_dependency_is_pinned_in_the_constraints() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = {distribution(line): line for line in lines if line and not line.startswith("#")}
    metadata = pyproject()["project"]
    extras = [requirement for extra in metadata["optional-dependencies"].values() for requirement in extra]
    wanted = {distribution(requirement) for requirement in (*metadata["dependencies"], *extras)}
    assert wanted - {"woodpipe"} - set(pins) == set(), "woodpipe itself only brings its extras"
    assert [line for line in pins.values() if not re.fullmatch(r"[\w.-]+==[\w.]+", line)] == [], "no local versions"


def test_the_version_is_said_once() -> None:
    version = pyproject()["project"]["version"]
    newest = re.search(r"^## (\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest is not None
    assert newest[1] == version
    installed = {found.version for found in importlib.metadata.distributions(name="woodpipe")}
    assert installed <= {version}, "run `make setup` again"
