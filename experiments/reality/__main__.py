"""Write withheld cases: `python -m experiments.reality OUT TRUTH --count N --kind single`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from experiments.reality.cases import KINDS, OBSERVATIONS, Plan, make_cases


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    p = argparse.ArgumentParser(prog="python -m experiments.reality", description=__doc__)
    p.add_argument("out", type=Path, help="folder for the recordings")
    p.add_argument("truth", type=Path, help="folder for the truth, outside of OUT")
    p.add_argument("--count", type=int, default=8)
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("--first", type=int, default=1, help="number of the first case")
    p.add_argument("--kind", choices=KINDS, default="single")
    p.add_argument("--observation", choices=OBSERVATIONS, default="tip_position")
    p.add_argument("--gap", type=float, nargs=2, default=(1.0, 4.0), metavar=("LOW", "HIGH"))
    p.add_argument("--rows", type=int, nargs=2, default=(60, 140), metavar=("LOW", "HIGH"))
    p.add_argument("--gross", type=float, default=0.0, help="largest share of gross errors")
    p.add_argument("--surgical", type=float, default=0.25, help="chance of a surgical space")
    p.add_argument("--moving", type=float, default=0.2, help="chance that the arm moves")
    p.add_argument("--effects", nargs="+", default=(), help="draw from these effects only")
    p.add_argument("--arms", nargs="+", default=(), help="draw from these arms only")
    p.add_argument("--unknown-noise", action="store_true", help="do not state noise_std")
    return p


def main(argv: list[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    args = parser().parse_args(argv)
    plan = Plan(
        kind=args.kind,
        gap=tuple(args.gap),
        rows=tuple(args.rows),
        observation=args.observation,
        known_noise=not args.unknown_noise,
        gross=args.gross,
        surgical=args.surgical,
        moving=args.moving,
        effects=tuple(args.effects),
        arms=tuple(args.arms),
    )
    try:
        names = make_cases(
            args.out, args.truth, count=args.count, seed=args.seed, plan=plan, first=args.first
        )
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{len(names)} cases in {args.out}, their truth in {args.truth}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
