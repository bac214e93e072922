"""How wrong an estimate's extrapolation is.

Probes scenes and renders them, one after the other. Prints of each what was foreseen and what it
took, and how far off their sums are: `python -m studies.estimates --suite standard --every 20`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from cornerscenes.estimate import Cost, probe
from cornerscenes.storage import storage_at
from cornerscenes.tasks import Setting, choose_variant, render_one, tasks_of
from studies.runs import SCRIPTS


def main() -> int:
    """Probe, render, compare."""
    parser = argparse.ArgumentParser(prog="studies.estimates", description=__doc__)
    parser.add_argument("--recipes", type=Path, default=SCRIPTS.parent / "scenes")
    parser.add_argument("--suite", default="quick")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="every N-th scene only")
    parser.add_argument("--variant", help="Mitsuba variant to use instead of the fastest")
    arguments = parser.parse_args()
    pairs: list[tuple[Cost, Cost]] = []
    with tempfile.TemporaryDirectory() as folder:
        setting = Setting(folder, choose_variant(arguments.variant), threads=1)
        storage_at(folder).make()
        for task in tasks_of(arguments.suite, arguments.recipes)[:: arguments.every]:
            foreseen = probe(task, setting)
            rendered = render_one(task, setting)
            pairs.append((foreseen, Cost(rendered.seconds, rendered.bytes)))
            print(f"{task.name}: {compared(pairs[-1:])}", flush=True)
    print(f"{len(pairs)} scenes: {compared(pairs)}")
    return 0


def compared(pairs: list[tuple[Cost, Cost]]) -> str:
    """Return what was foreseen and what it took, summed over scenes."""
    seconds, took_s = (sum(pair[k].seconds for pair in pairs) for k in (0, 1))
    size, was = (sum(pair[k].bytes for pair in pairs) / 1e6 for k in (0, 1))
    return (
        f"{seconds:.1f} s foreseen, {took_s:.1f} s taken ({seconds / took_s - 1:+.0%}); "
        f"{size:.2f} MB foreseen, {was:.2f} MB written ({size / was - 1:+.0%})"
    )


if __name__ == "__main__":
    sys.exit(main())
