"""What a run tells while it runs: a live table in a terminal, plain lines elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from rich.console import Console

    from pipeline.plan import ScanPlan


class Reporter(Protocol):
    """Is told what happens."""

    def begin(self, plans: Sequence[ScanPlan], link: str) -> None:
        """Say that the run begins; `link` is the dashboard's address, if there is one."""

    def started(self, scan: str, name: str, reason: str) -> None:
        """Say that a stage or product starts."""

    def tile(self, scan: str, name: str, done: int, total: int) -> None:
        """Say that a tile of a stage is done."""

    def ended(self, scan: str, name: str, status: str, seconds: float) -> None:
        """Say that a stage or product is done or reused."""

    def failed(self, scan: str, message: str) -> None:
        """Say that a scan failed."""

    def finish(self) -> None:
        """Leave the terminal as it was."""


class Silent:
    """Tells nothing."""

    def begin(self, plans: Sequence[ScanPlan], link: str) -> None:
        """Say nothing."""

    def started(self, scan: str, name: str, reason: str) -> None:
        """Say nothing."""

    def tile(self, scan: str, name: str, done: int, total: int) -> None:
        """Say nothing."""

    def ended(self, scan: str, name: str, status: str, seconds: float) -> None:
        """Say nothing."""

    def failed(self, scan: str, message: str) -> None:
        """Say nothing."""

    def finish(self) -> None:
        """Say nothing."""


class PlainLines:
    """One line per event, for logs and pipes."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._tenths: dict[tuple[str, str], int] = {}

    def begin(self, plans: Sequence[ScanPlan], link: str) -> None:
        """Say how many scans there are and where the dashboard is."""
        blocks = sum(plan.block is not None for plan in plans)
        scans = len(plans) - blocks
        told = f"{scans} scan{'' if scans == 1 else 's'}"
        self._say(told + (f" and {blocks} block{'' if blocks == 1 else 's'}" if blocks else ""))
        if link:
            self._say(f"dashboard: {link}")

    def started(self, scan: str, name: str, reason: str) -> None:
        """Say that a stage or product starts, and why."""
        self._say(f"{scan}: {name} runs: {reason}")

    def tile(self, scan: str, name: str, done: int, total: int) -> None:
        """Say how far a stage is, at most ten times."""
        tenth = 10 * done // total
        if tenth != self._tenths.get((scan, name)):
            self._tenths[scan, name] = tenth
            self._say(f"{scan}: {name} tile {done} of {total}")

    def ended(self, scan: str, name: str, status: str, seconds: float) -> None:
        """Say that a stage or product is done or reused."""
        self._say(f"{scan}: {name} reused" if status == "reused" else f"{scan}: {name} done in {seconds:.1f} s")

    def failed(self, scan: str, message: str) -> None:
        """Say that a scan failed."""
        self._say(f"{scan}: failed: {message}")

    def finish(self) -> None:
        """Nothing to leave behind."""

    def _say(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


class LiveTable:
    """A line per scan with its bar and what it is at, updated in place."""

    def __init__(self, console: Console) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        self._console = console
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[now]}", markup=False),
            console=console,
        )
        self._rows: dict[str, Any] = {}
        self._running: dict[str, dict[str, str]] = {}
        self._reused: dict[str, list[str]] = {}

    def begin(self, plans: Sequence[ScanPlan], link: str) -> None:
        """Open a line per scan."""
        if link:
            self._console.print(f"dashboard: {link}", highlight=False)
        for plan in plans:
            total = len(plan.nodes)
            self._rows[plan.label] = self._progress.add_task(plan.label, total=total or 1, now="waits")
            self._running[plan.label], self._reused[plan.label] = {}, []
        self._progress.start()

    def started(self, scan: str, name: str, reason: str) -> None:
        """Show what the scan is at."""
        self._running[scan][name] = name
        self._show(scan)

    def tile(self, scan: str, name: str, done: int, total: int) -> None:
        """Show how far the stage is."""
        self._running[scan][name] = f"{name}, tile {done} of {total}"
        self._show(scan)

    def ended(self, scan: str, name: str, status: str, seconds: float) -> None:
        """Advance the scan's bar."""
        self._running[scan].pop(name, None)
        if status == "reused":
            self._reused[scan].append(name)
        self._progress.advance(self._rows[scan])
        self._show(scan)

    def failed(self, scan: str, message: str) -> None:
        """Show that the scan failed."""
        self._running[scan].clear()
        self._progress.update(self._rows[scan], now="failed")

    def finish(self) -> None:
        """Leave the lines as they are and say what was reused."""
        self._progress.stop()
        for scan, names in self._reused.items():
            if names:
                self._console.print(f"{scan}: {', '.join(names)} reused", markup=False, highlight=False)

    def _show(self, scan: str) -> None:
        now = "; ".join(self._running[scan].values())
        task = self._progress.tasks[self._rows[scan]]
        self._progress.update(self._rows[scan], now=now or ("" if task.finished else "waits"))


def reporter_for(console: Console) -> Reporter:
    """Live table in a terminal, plain lines elsewhere."""
    return LiveTable(console) if console.is_terminal else PlainLines(console)
