"""The small recording that comes with the package.

``python -m plumbline.experiments.reality.bench [FOLDER]``

A UR5 on a bench, 90 readings of its tip, and one thing wrong with it. The folder does not say what.
"""

import sys
from dataclasses import replace
from pathlib import Path

from plumbline.errors import PlumblineError
from plumbline.experiments.reality.cases import Plan, draw_case
from plumbline.experiments.reality.gap import scaled
from plumbline.experiments.reality.joint_effects import TransmissionRipple
from plumbline.experiments.reality.recorder import Case, simulate, write

FOLDER = Path(__file__).parents[1] / "recordings" / "bench-ur5"
SEED, NOISE, GAP = 2024, 8e-5, 3.0  # noise of one axis [m], gap over it


def bench_case() -> Case:
    """The case behind the recording."""
    plan = Plan(kind="none", rows=(90, 90), surgical=0.0, moving=0.0, forced=0.0, arms=("ur5",))
    case = draw_case(plan, "bench-ur5", SEED)
    ripple = TransmissionRipple(0.0, 2, once=(1.0, 0.6))
    sized = scaled(case.scene, ripple, GAP * NOISE, case.observation)
    if sized is None:
        raise PlumblineError(f"no ripple gives a gap of {GAP * NOISE} m: take another seed")
    return replace(
        case,
        kind="single",
        effects=(sized,),
        gap_to_noise=(GAP,),
        noise_std=NOISE,
        thermometer=120.0,
    )


def main(argv: list[str] | None = None) -> int:
    """Write the recording; returns the exit code."""
    args = sys.argv[1:] if argv is None else argv
    folder = Path(args[0]) if args else FOLDER
    recording, _ = simulate(bench_case())
    write(folder, recording)
    print(f"written: {folder}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
