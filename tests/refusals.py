"""What is refused, and in which words."""

from plumbline.errors import PlumblineError
from plumbline.experiments.commands.app import run


def refused(capsys, *arguments):
    """The one line on standard error of a command that is refused."""
    assert run([str(a) for a in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("plumbline: ")
    assert err.endswith("\n")
    assert err.count("\n") == 1
    return err


def is_refused(call, *given, match=""):
    """Whether a call is refused, with these words."""
    words = None
    try:
        call(*given)
    except PlumblineError as error:
        words = str(error)
    assert words is None or match in words
    return words is not None
