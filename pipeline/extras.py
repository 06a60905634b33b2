"""Packages that not everyone needs: imported when asked for, and named with the command that installs them."""

from __future__ import annotations

import importlib
from typing import Any

from pipeline.problems import Problem, UsageError


def need(module: str, extra: str, purpose: str) -> Any:
    """Import a module of an optional extra.

    Parameters
    ----------
    module : str
        Its import name.
    extra : str
        The extra of woodpipe that brings it.
    purpose : str
        What it is needed for, as in "to read meshes".

    Raises
    ------
    UsageError
        When it is not installed or cannot be imported.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        missing = isinstance(error, ModuleNotFoundError)
        found = "is not installed" if missing else f"cannot be imported ({error})"
        what = f"`{module}` {found}; it is needed {purpose}. Install it with: pip install 'woodpipe[{extra}]'"
        raise UsageError("Something is missing", [Problem("", what)]) from error
