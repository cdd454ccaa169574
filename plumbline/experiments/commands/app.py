"""The command line: ``plumbline COMMAND ...``, or ``python -m plumbline COMMAND ...``.

A command ends with 0, or with 2 and one line on standard error that says what is wrong and how to
mend it; an interrupt ends it with 130, a reader that has gone away with 1. What a command needs is
imported when it runs.
"""

import os
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Annotated

import typer

from plumbline.errors import PlumblineError
from plumbline.experiments.commands import methods
from plumbline.experiments.commands.apply import apply, export
from plumbline.experiments.commands.check import check
from plumbline.experiments.commands.dhfit import dhfit
from plumbline.experiments.commands.diagnose import diagnose
from plumbline.experiments.commands.examples import FIRST, epilog
from plumbline.experiments.commands.import_ import import_, new
from plumbline.experiments.commands.next import next_
from plumbline.experiments.commands.sources import fetch, list_
from plumbline.experiments.commands.sweep import sweep
from plumbline.experiments.commands.withheld import app as withheld
from plumbline.experiments.console.outputs import COMMAND
from plumbline.experiments.console.streams import Output, guard
from plumbline.kinematics.files import reason

INTERRUPTED = 130  # exit code of a shell: 128 and the number of SIGINT
UNREAD = 1  # exit code where the reader of standard output has gone
USAGE: type[Exception] = typer.BadParameter.mro()[1]

app = typer.Typer(
    name="plumbline",
    help="Where the gap between a robot and its model lies, what causes it, how far it shrinks.",
    epilog=epilog(*FIRST),
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def _say_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"plumbline {version('plumbline-robotics')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _without_command(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="Say it and end."),
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        print(context.get_help())


COMMANDS: dict[str, Callable[..., None]] = {
    "diagnose": diagnose,
    "apply": apply,
    "export": export,
    "check": check,
    "import": import_,
    "new": new,
    "fetch": fetch,
    "list": list_,
    "next": next_,
    "reproduce": methods.reproduce,
    "register": methods.register,
    "dhfit": dhfit,
    "handeye": methods.handeye,
    "scan": methods.scan,
    "budget": methods.budget,
    "sweep": sweep,
    "codegen": methods.codegen,
}
for _name, _command in COMMANDS.items():
    app.command(_name, epilog=epilog(_name))(_command)
app.add_typer(withheld, name="withheld")


def run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code."""
    COMMAND.set(shlex.join(["plumbline", *arguments]))
    try:
        code = app(args=list(arguments), prog_name="plumbline", standalone_mode=False)
    except Exception as error:
        said = _said(error)
        if said is None:
            raise
        return _refuse(said, 2)
    except KeyboardInterrupt:
        code = INTERRUPTED
    return _refuse("interrupted", INTERRUPTED) if code == INTERRUPTED else int(code or 0)


def main() -> None:
    """Run the command line of this process."""
    if os.environ.get("COLUMNS") == "0":  # a terminal that does not know how wide it is
        del os.environ["COLUMNS"]
    output = guard()
    code = run(sys.argv[1:])
    if output is not None:
        output.flush()
        code = code or _heard(output)
    sys.exit(code)


def _heard(output: Output) -> int:
    """The exit code of a command that did all it should: whether its words were taken, too."""
    if output.failure is None:
        return 0
    if isinstance(output.failure, BrokenPipeError):  # the reader has gone, as `head` does
        return UNREAD
    return _refuse(f"standard output: cannot be written ({reason(output.failure)})", 2)


def _said(error: Exception) -> str | None:
    """What to say of an error that is the user's or the data's; nothing of a defect of ours."""
    if isinstance(error, USAGE):
        said = str(getattr(error, "format_message", error.__str__)()).rstrip(".")
        asked = getattr(getattr(error, "ctx", None), "command_path", "plumbline")
        return f"{said}; try '{asked} --help'"
    return str(error) if isinstance(error, PlumblineError) else None


def _refuse(why: str, code: int) -> int:
    line = " ".join(why.split())
    if sys.stderr is not None:
        with suppress(OSError):  # nobody is left to tell
            sys.stderr.write(f"plumbline: {''.join(c if c.isprintable() else '?' for c in line)}\n")
    return code


if __name__ == "__main__":
    main()
