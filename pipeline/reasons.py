"""Why something has to be computed, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.input_files import stored_files
from pipeline.wiring import BLOCK, SOURCE


def why_stage(
    stage: str, now: Mapping[str, Any], before: Mapping[str, Any] | None, again: Sequence[str], is_partial: bool
) -> str:
    """Why a stage without a result has to run.

    Parameters
    ----------
    stage
        Its name.
    now, before
        Key, version, params and inputs now and when it last ran for this scan (``None``: never).
    again
        Stages before it that run in this run.
    is_partial
        Whether a run was interrupted in the middle of it.
    """
    reasons = []
    if before is not None and before["key"] != now["key"]:
        reasons = _parameter_changes(stage, now["params"], before["params"])
        if now["version"] != before["version"]:
            reasons.append(f"version of {stage} changed from {before['version']} to {now['version']}")
        if now["inputs"].get(SOURCE) != before["inputs"].get(SOURCE):
            reasons.append("the scan's file changed")
        if BLOCK in before["inputs"] and now["inputs"].get(BLOCK) != before["inputs"][BLOCK]:
            reasons.append("the faces lie elsewhere")
    if reasons:
        return "; ".join(reasons)
    if is_partial:
        return "result is incomplete"
    if before is not None and before["key"] == now["key"]:
        return "result is gone"
    if before is None:
        return "never computed"
    if again:
        return f"{' and '.join(again)} {'runs' if len(again) == 1 else 'run'} before it"
    changed = [name for name in now["inputs"] if now["inputs"][name] != before["inputs"].get(name)]
    return f"never computed from this result of {' and '.join(changed)}" if changed else "never computed"


def why_product(product: str, key: str, before: Mapping[str, Any] | None, path: Path, again: Sequence[str]) -> str:
    """Why a product has to be made; empty if nothing speaks for it."""
    if before is None:
        return "never made"
    if before["key"] != key:
        return (
            f"{' and '.join(again)} {'runs' if len(again) == 1 else 'run'} before it"
            if again
            else "made from other results"
        )
    if not path.exists():
        return f"{path.name} is gone"
    if path.stat().st_size != before["size"]:
        return f"{path.name} was changed by hand"
    return ""


def _parameter_changes(stage: str, now: Mapping[str, Any], before: Mapping[str, Any]) -> list[str]:
    reasons = []
    for name in sorted(set(now) | set(before)):
        if name not in before:
            reasons.append(f"parameter `{name}` of {stage} is new")
        elif name not in now:
            reasons.append(f"parameter `{name}` of {stage} is gone")
        elif (files := _file_changes(now[name], before[name])) is not None:
            reasons += [f"parameter `{name}` of {stage}: {files}"] if files else []
        elif now[name] != before[name]:
            reasons.append(f"parameter `{name}` of {stage} changed from {_short(before[name])} to {_short(now[name])}")
    return reasons


def _file_changes(now: Any, before: Any) -> str | None:
    """Which files were edited, are new or are gone; empty for the same texts, None for values that are no files."""
    now, before = stored_files(now), stored_files(before)
    if now is None or before is None or not (now or before):
        return None
    if [file.text for file in now] == [file.text for file in before]:
        return ""
    there, was = ({file.name: file.text for file in files} for files in (now, before))
    changes = [
        f"{name} is new" if name not in was else f"{name} is gone" if name not in there else f"{name} was edited"
        for name in sorted(set(there) | set(was))
        if there.get(name) != was.get(name)
    ]
    return ", ".join(changes) or "its files changed"


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 40 else text[:39] + "…"
