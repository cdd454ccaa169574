"""Examples of every command, shown below its ``--help``; the tests see that each still parses."""

from collections.abc import Mapping

EXAMPLES: Mapping[str, tuple[str, ...]] = {
    "diagnose": (
        "plumbline diagnose my-run --report my-run.html",
        "plumbline diagnose my-run --json - --without transmission_ripple",
        "plumbline diagnose my-run --rehearse 60 --report my-run.html",
        "plumbline diagnose monday --also friday --model found.toml",
    ),
    "apply": ("plumbline apply found.toml friday",),
    "export": ("plumbline export found.toml --urdf corrected.urdf",),
    "check": ("plumbline check my-run", "plumbline check my-run --json check.json --quiet"),
    "import": (
        "plumbline import log.csv --to my-run --robot ur5 --unit deg,mm --map q#=J# --map x=X",
        "plumbline import arm.csv tracker.csv --to my-run --robot arm.urdf --gap 0.005",
        "plumbline import run.db3 --to my-run --robot ur10 --yes",
    ),
    "new": (
        "plumbline new my-run --robot ur5",
        "plumbline new my-run --kind joint_torque --robot arm.urdf",
    ),
    "fetch": ("plumbline fetch ur5-grid", "plumbline fetch panda-1 --to recordings"),
    "list": ("plumbline list", "plumbline list --effects"),
    "next": (
        "plumbline next my-run --count 8",
        "plumbline next my-run --within limits --csv rows.csv",
    ),
    "reproduce": ("plumbline reproduce registration --report registration.html",),
    "register": (
        "plumbline register my-phantom --report my-phantom.html",
        "plumbline register ct.mrk.json robot.fcsv --tfm ct-to-robot.tfm",
    ),
    "dhfit": ("plumbline dhfit my-run --urdf fitted.urdf --report links.html",),
    "handeye": ("plumbline handeye my-boards --json handeye.json --report handeye.html",),
    "scan": ("plumbline scan my-block --beam handeye.json",),
    "budget": ("plumbline budget chain.toml --report chain.html",),
    "sweep": ("plumbline sweep sweep.toml --jobs 2 --csv sweep.csv",),
    "codegen": ("plumbline codegen controller --trocar -40,0,0 --trocar 40,0,0",),
    "withheld make": ("plumbline withheld make cases --truth truth --kind single --count 50",),
    "withheld seal": ("plumbline withheld seal cases --truth truth",),
    "withheld run": ("plumbline withheld run cases --out verdicts --jobs 2",),
    "withheld score": (
        "plumbline withheld score verdicts --truth truth",
        "plumbline withheld score verdicts --truth truth --json score.json --report score.html",
    ),
    "withheld bench": ("plumbline withheld bench sets --count 100 --only single --table out.md",),
}
FIRST = ("diagnose", "import", "export")  # whose examples stand below the help of all
BLIND = ("withheld make", "withheld run", "withheld score")  # a blind test, in this order


def epilog(*commands: str) -> str:
    """What stands below a help: the first example of several commands, or all of one."""
    lines = [EXAMPLES[c][:1] if len(commands) > 1 else EXAMPLES[c] for c in commands]
    return "\n\n".join(["[bold]Examples[/bold]", *(line for group in lines for line in group)])
