"""The sections of the report: the scripts that regenerate the thesis' tables and figures, and their options."""

import dataclasses
from pathlib import Path

EXAMPLES = Path(__file__).parent


@dataclasses.dataclass(frozen=True)
class Section:
    """One script of the examples, and what it regenerates.

    Attributes:
        script: its path in `examples/`.
        covers: the tables, figures and sections of the thesis that it regenerates; empty for further studies.
        quick: its options for a few trials, as typed in a shell.
        full: likewise for all trials.
        alone: whether it must run alone, because it measures real time.
    """

    script: str
    covers: tuple[str, ...] = ()
    quick: str = ""
    full: str = ""
    alone: bool = False

    @property
    def name(self) -> str:
        """The script's name without suffix, which is the section's anchor and folder."""
        return Path(self.script).stem

    @property
    def path(self) -> Path:
        """Path of the script."""
        return EXAMPLES / self.script


SECTIONS = (
    Section(
        "thesis/table_3_1.py",
        covers=("table 3.1", "figures 3.12 to 3.19"),
        quick="--trials 8 --seed 0",
        full="--trials 100 --seed 0",
    ),
    Section(
        "thesis/figure_3_24.py",
        covers=("figure 3.24",),
        quick="--objects soda_can --places 1 --seed 0",
        full="--seed 0",
    ),
    Section(
        "depth_tracking_study.py",
        covers=("section 3.3.2.3 from a depth camera's pixels",),
        quick="--objects soda_can --grasps 1 --first-seed 0",
        full="--grasps 20 --first-seed 0",
    ),
    Section(
        "reconstructed_objects.py",
        covers=("section 3.3.2.1: an object that is reconstructed from depth images",),
        quick="--objects tea_box --trials 1 --first-seed 0",
        full="--trials 10 --first-seed 0",
    ),
    Section(
        "thesis/figures_3_25_and_3_26.py",
        covers=("figures 3.25 and 3.26",),
        quick="--trials 40 --seed 0",
        full="--trials 200 --seed 0",
    ),
    Section("thesis/search_progress.py", covers=("figure 4.5", "figure 4.19"), quick="--seed 0", full="--seed 0"),
    Section("thesis/figures_4_7_and_4_11.py", covers=("figure 4.7", "figure 4.11"), quick="--seed 0", full="--seed 0"),
    Section(
        "thesis/section_4_3_1.py",
        covers=("figures 4.8 to 4.10", "figures 4.12 and 4.13", "figure 4.20"),
        quick="--trials 4 --thesis-trials 1 0 --likelihood-trials 1 0 --seed 0",
        full="--trials 100 --thesis-trials 40 2 --likelihood-trials 40 2 --seed 0",
    ),
    Section(
        "thesis/section_4_3_1_bound.py", quick="--trials 4 --seed 0 --only correction", full="--trials 100 --seed 0"
    ),
    Section(
        "hand_over_and_place.py",
        covers=("figures 4.17 and 4.18",),
        quick="--seeds 1 --first-seed 0",
        full="--seeds 100 --first-seed 0",
    ),
    Section("pencil_on_table.py", quick="--trials 5 --first-seed 0", full="--trials 100 --first-seed 0"),
    Section("thesis/table_5_1.py", covers=("table 5.1", "figures 5.3 to 5.5")),
    Section("thesis/table_5_2.py", covers=("table 5.2",), quick="--trials 1 --seed 0", full="--trials 20 --seed 0"),
    Section(
        "thesis/table_5_3.py",
        covers=("table 5.3", "figure 5.12"),
        quick="--trials 3 --seed 0",
        full="--trials 100 --seed 0",
    ),
    Section("thesis/figure_5_11.py", covers=("figure 5.11",)),
    Section("thesis/figure_5_13.py", covers=("figure 5.13",)),
    Section("thesis/figure_5_14.py", covers=("figure 5.14",), quick="--seed 0", full="--seed 0"),
    Section(
        "thesis/chapter_5_inexact.py",
        quick="--trials 2 --hands 3 --search-trials 0 --seed 0",
        full="--trials 20 --hands 40 --search-trials 3 --seed 0",
    ),
    Section("thesis/rubber_pads.py", quick="--trials 1 --seed 0", full="--trials 10 --seed 0"),
    Section("table_6_1.py", covers=("table 6.1",), quick="--trials 8 --seed 0", full="--trials 100 --seed 0"),
    Section("thesis/figure_6_1.py", covers=("figure 6.1",), quick="--grasps 1 --seed 0", full="--grasps 10 --seed 0"),
    Section("thesis/figure_6_2.py", covers=("figure 6.2",), quick="--seed 0", full="--seed 0"),
    Section("thesis/figure_6_3.py", covers=("figure 6.3",), quick="--seed 0", full="--seed 0"),
    Section("thesis/figure_6_4.py", covers=("figure 6.4",), quick="--grasps 2", full="--grasps 100"),
    Section("thesis/figure_6_4_in_physics.py", quick="--grasps 1 --first-seed 0", full="--grasps 30 --first-seed 0"),
    Section("thesis/section_6_2_1.py", quick="--grasps 3 --first-seed 0", full="--grasps 30 --first-seed 0"),
    Section("calibration.py", quick="--trials 30 --first-seed 0", full="--trials 1000 --first-seed 0"),
    Section("patch_calibration.py", quick="--trials 24 --first-seed 0", full="--trials 1000 --first-seed 0"),
    Section("calibration_study.py", quick="--trials 1 --grasps 6 --seed 0", full="--trials 40 --seed 0"),
    Section("declared_errors.py", quick="--grasps 1 --errors 0 5 --first-seed 0", full="--grasps 40 --first-seed 0"),
    Section("world_not_as_told.py", quick="--trials 10 --first-seed 0", full="--trials 500 --first-seed 0"),
    Section("held_still.py", quick="--trials 24 --first-seed 0", full="--trials 2004 --first-seed 0"),
    Section("unknown_objects.py", quick="--trials 20 --known 6 --seed 0", full="--trials 300 --seed 0"),
    Section("in_hand_motions.py", quick="--motions 4 --steps 50 --first-seed 0", full="--motions 200 --first-seed 0"),
    Section(
        "recorded_motions.py", quick="--objects tea_box --seconds 2 --first-seed 0", full="--seconds 10 --first-seed 0"
    ),
    Section(
        "belief_study.py",
        quick="--objects tea_box --placements 1 --first-seed 0",
        full="--placements 10 --first-seed 0",
    ),
    Section("belief_faults.py", quick="--trials 1 --first-seed 0", full="--trials 100 --first-seed 0"),
    Section("slip_in_station.py", quick="--seconds 0.3"),
    Section("identification_study.py", quick="--trials 10 --seed 0", full="--trials 400 --seed 0"),
    Section("grasp_study.py", quick="--objects mug --seeds 1 --first-seed 0", full="--seeds 10 --first-seed 0"),
    Section("can_latency.py", quick="--duration 2", alone=True),
    Section("cost_growth.py", quick="--trials 1 --seed 0", full="--trials 50 --seed 0"),
)
# Figures that need the thesis' hardware, or show a single example of what a table measures.
NOT_REPRODUCED = {
    "figure 3.2": "a sketch of the regions that algorithm 3.1 searches; the search keeps them, in table 3.1",
    "figures 3.3 to 3.6": "single runs of Gradient Descent and Levenberg-Marquardt; table 3.1 has 100 of each",
    "figures 3.9 to 3.11": "single runs with normals; table 3.1 has 100 of each, and section 4.3.1 shows poses",
    "figures 4.1 and 4.2": "the formula of the weights, eq. 4.9, plotted, and a sketch of the roulette wheel",
    "figure 4.3": "times on the thesis' machine; how time grows with the particles here is in cost_growth",
    "figure 4.4": "the formula of the noise that shrinks, eq. 4.12, plotted",
    "figures 3.20 to 3.23": "photographs and single runs of the real arm, hand and camera",
    "figures 4.14 to 4.16": "runs of the real hand and camera",
    "figures 5.8 to 5.10": "photographs and single runs of the real Barrett hand",
}
