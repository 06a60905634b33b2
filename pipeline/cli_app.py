"""What all commands share: the application, common options, and errors told to people.

Exit status: 0 all well, 1 some scans failed, 2 the config or command cannot be followed, 130 interrupted.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="woodpipe",
    help="From photographs of wood to rings, ring series and solid wood textures.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

ConfigPath = Annotated[Path, typer.Argument(metavar="CONFIG", help="The YAML file.")]
OptionalConfig = Annotated[Path, typer.Argument(metavar="[CONFIG]", help="The YAML file.")]
StageOption = Annotated[str | None, typer.Option("--stage", help="Run this stage again, and what its values change.")]
FromOption = Annotated[str | None, typer.Option("--from", help="Run this stage and all after it again.")]
UntilOption = Annotated[str | None, typer.Option("--until", help="Stop after this stage.")]
ForceOption = Annotated[bool, typer.Option("--force", help="Run every stage again.")]
ScanOption = Annotated[str | None, typer.Option("--scan", metavar="GLOB", help="Only scans with such a name.")]
DebugOption = Annotated[bool, typer.Option("--debug", help="Show tracebacks and what the workers say.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]

DEFAULT_CONFIG = Path("pipeline.yaml")


@contextmanager
def told_to_people(debug: bool = False) -> Iterator[None]:
    """Turn usage errors into a few lines and exit status 2, and Ctrl-C into 130."""
    from pipeline.problems import UsageError

    try:
        yield
    except UsageError as error:
        print(error, file=sys.stderr)
        if debug:
            raise
        raise typer.Exit(2) from None
    except KeyboardInterrupt:
        print("interrupted; what is done is kept", file=sys.stderr)
        raise typer.Exit(130) from None
    except OSError as error:
        if debug:
            raise
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        raise typer.Exit(2) from None
