"""Correction of vision by touch, in simulated grasps of several objects with several seeds.

python examples/grasp_study.py --objects bust mug --seeds 3
python examples/grasp_study.py --perfect --seeds 5
python examples/grasp_study.py --scenario barrett_like --objects soda_can --seeds 20
"""

import argparse
import time

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from tactopose_drake.cli import DemoResult, GraspFailedError, run_demo
from tactopose_drake.estimation import direction_names
from tactopose_drake.station import load_scenario

OBJECTS = ("bust", "mug", "spray_bottle", "tea_box", "wine_glass")


def study(
    scenario_name: str, objects: list[str], first_seed: int, seeds: int, perfect: bool
) -> tuple[dict[tuple[str, int], DemoResult], list[str]]:
    """Runs each object with each seed; returns the results, and the reasons of failures."""
    results: dict[tuple[str, int], DemoResult] = {}
    failures: list[str] = []
    for name in objects:
        scenario = load_scenario(scenario_name)
        scenario = scenario.without_errors() if perfect else scenario
        scenario.object = name
        model = scenario.object_model()
        for seed in track(range(first_seed, first_seed + seeds), description=name):
            scenario.seed = seed
            try:
                results[name, seed] = run_demo(scenario, model=model)
            except GraspFailedError as error:
                failures.append(str(error))
    return results, failures


def corrected(result: DemoResult) -> bool:
    """Whether both errors decreased in the directions that the touch determines."""
    before, after = result.vision, result.touch
    return (
        after.determined_translation < before.determined_translation
        and after.determined_rotation < before.determined_rotation
    )


def main() -> None:
    """Prints a line for each grasp, and the summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="shadow_like")
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS))
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--perfect", action="store_true", help="a hand that errs in nothing")
    arguments = parser.parse_args()
    console, started = Console(), time.perf_counter()
    results, failures = study(
        arguments.scenario, arguments.objects, arguments.first_seed, arguments.seeds, arguments.perfect
    )
    if not results:
        raise SystemExit("; ".join(failures))

    table = Table(title="Errors where the touch determines the pose: vision, then touch")
    for heading in ("object", "seed", "mm", "deg", "MDTS, mm", "MATN, deg", "not determined"):
        table.add_column(heading)
    for (name, seed), result in results.items():
        before, after = result.vision, result.touch
        table.add_row(
            name,
            str(seed),
            f"{1e3 * before.determined_translation:.1f} {1e3 * after.determined_translation:.1f}",
            f"{np.degrees(before.determined_rotation):.1f} {np.degrees(after.determined_rotation):.1f}",
            f"{1e3 * after.MDTS:.2f}",
            f"{np.degrees(after.MATN):.1f}",
            "; ".join(direction_names(result.estimate.best)),
        )
    console.print(table)
    points = [f.position_error for r in results.values() for f in r.fingers if f.position_error is not None]
    points += [p.centroid_error for r in results.values() for p in r.pads if p.centroid_error is not None]
    touches = [result.touch for result in results.values()]
    console.print(
        f"{len(results)} grasps in {time.perf_counter() - started:.0f} s, {len(failures)} failed to hold.\n"
        f"Vision: at least {1e3 * min(r.vision.translation for r in results.values()):.1f} mm and "
        f"{np.degrees(min(r.vision.rotation for r in results.values())):.1f} deg off.\n"
        f"Contact points or centroids: median error {1e3 * np.median(points):.2f} mm of {len(points)}.\n"
        f"Mean distance to the surface: at most {1e3 * max(t.MDTS for t in touches):.2f} mm; "
        f"mean angle to the normal: at most {np.degrees(max(t.MATN for t in touches)):.1f} deg, "
        f"median {np.degrees(np.median([t.MATN for t in touches])):.1f} deg.\n"
        f"Both errors fell in {np.mean([corrected(r) for r in results.values()]):.0%}; their median there is "
        f"{1e3 * np.median([t.determined_translation for t in touches]):.1f} mm and "
        f"{np.degrees(np.median([t.determined_rotation for t in touches])):.1f} deg."
    )
    for failure in failures:
        console.print(failure)


if __name__ == "__main__":
    main()
