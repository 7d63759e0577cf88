"""Fuzzes the package's public calls: `python -m tests.fuzz --minutes 60`, or `--calls 20000 --kind hostile --jobs 2`.

Prints each finding with the command that makes the same call again, and a summary, also where it is interrupted. Exit
status 1 where there is one.
"""

import argparse
import signal
import sys

from tests.fuzz.bits import bits
from tests.fuzz.buses import bus_faults, can_frames
from tests.fuzz.calls import hostile, plausible
from tests.fuzz.files import yaml_files
from tests.fuzz.meshes import caches, models, repairs
from tests.fuzz.outputs import outputs
from tests.fuzz.recordings import recordings
from tests.fuzz.runner import Kind, Outcome, run

KINDS: dict[str, Kind] = {
    "plausible": plausible,
    "hostile": hostile,
    "bits": bits,
    "yaml_files": yaml_files,
    "recordings": recordings,
    "repairs": repairs,
    "models": models,
    "caches": caches,
    "can_frames": can_frames,
    "bus_faults": bus_faults,
    "outputs": outputs,
}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--kind", action="append", choices=sorted(KINDS), help="may be repeated; all without")
    parser.add_argument("--seed", type=int, default=0, help="of the first call; call i has the seed SEED + i")
    parser.add_argument("--calls", type=int, help="how many of each kind; 1000 where no time is given either")
    parser.add_argument("--minutes", type=float, help="after which no further call is begun")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    arguments = parser.parse_args()
    for interrupt in (signal.SIGINT, signal.SIGTERM):  # a shell's background jobs ignore the first
        signal.signal(interrupt, signal.default_int_handler)
    calls = 1000 if arguments.calls is None and arguments.minutes is None else arguments.calls
    summary = run(
        {name: KINDS[name] for name in arguments.kind or KINDS},
        seed=arguments.seed,
        calls=calls,
        minutes=arguments.minutes,
        jobs=arguments.jobs,
        report=_print,
    )
    print(summary)
    return 1 if summary.findings else 0


def _print(finding: Outcome) -> None:
    print(f"{finding.command}\n{finding.detail}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
