"""Something to look at for every scan: a self-contained page each, and an index over the run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from pipeline.context import ProductContext, ScanRow

__all__ = ["VERSION", "write_index", "write_scan_report"]

#: Goes up when the same results give another page.
VERSION = 3


def write_scan_report(ds: xr.Dataset, path: Path, context: ProductContext) -> None:
    """Write the page of one scan.

    Parameters
    ----------
    ds
        Merged results of the stages that have run, lazily opened; sections whose variables are missing are left out.
    path
        The HTML file.
    context
        The scan's parameters, keys, times, figures and warnings.
    """
    from pipeline.report.scan_page import render_scan

    path.write_text(render_scan(ds, context), encoding="utf-8")


def write_index(rows: Sequence[ScanRow], path: Path, folder: Path | None = None) -> None:
    """Write the page over a run's scans.

    Parameters
    ----------
    rows
        One per scan.
    path
        The HTML file.
    folder
        Where the scans' product folders lie and the page will be read; the page's own folder when ``None``.
    """
    from pipeline.report.index_page import render_index

    path.write_text(render_index(rows, path.parent if folder is None else folder), encoding="utf-8")
