"""Examples of every command, shown below its ``--help``; the tests see that each still parses."""

from plumbline.experiments.console.tables import table

EXAMPLES: dict[str, list[str]] = table("plumbline.experiments.commands", "examples.toml")
FIRST = ("diagnose", "import", "export")  # whose examples stand below the help of all
BLIND = ("withheld make", "withheld run", "withheld score")  # a blind test, in this order


def epilog(*commands: str) -> str:
    """What stands below a help: the first example of several commands, or all of one."""
    lines = [EXAMPLES[c][:1] if len(commands) > 1 else EXAMPLES[c] for c in commands]
    return "\n\n".join(["[bold]Examples[/bold]", *(line for group in lines for line in group)])
