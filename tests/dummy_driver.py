"""A run of the dummy stages in a process of its own, to be killed: ``python dummy_driver.py CONFIG [SCHEDULER]``."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]


def main() -> int:
    """Run the config given on the command line."""
    from dummy_stages import PRODUCTS, STAGES
    from rich.console import Console

    from pipeline.plan import Selection
    from pipeline.progress import PlainLines
    from pipeline.project import Project

    scheduler = sys.argv[2] if len(sys.argv) > 2 else "local"
    project = Project.load(Path(sys.argv[1]), STAGES, PRODUCTS)
    results = project.run(Selection(), PlainLines(Console(width=200)), {"scheduler": scheduler, "tile": 1024})
    for _, row in results:
        print(row.scan.name, row.outcome, row.message)
    return int(any(row.outcome == "failed" for _, row in results))


if __name__ == "__main__":
    sys.exit(main())
