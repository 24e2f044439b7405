"""Calls that are refused or warn, and what is told of them."""

from contextlib import contextmanager

import pytest

import symmb as mb


def refused(match, call, /, *arguments, error=mb.DeclarationError, **options):
    """The message of the error that ends a call. It matches, unless that is None."""
    with pytest.raises(error, match=match) as caught:
        call(*arguments, **options)
    return str(caught.value)


@contextmanager
def told_in_a_line(match, error=mb.DeclarationError):
    """What is run within ends by an error whose message matches, and is one line."""
    with pytest.raises(error, match=match) as caught:
        yield
    assert "\n" not in str(caught.value)


def warned(match, call, /, *arguments, **options):
    """What a call returns that warns: the text of a warning matches."""
    with pytest.warns(mb.SymmbWarning, match=match):
        return call(*arguments, **options)


def printed(capsys, *arguments):
    """What a command prints that succeeds."""
    from symmb.show.cli.main import main

    assert main(arguments) == 0
    return capsys.readouterr().out


def refused_command(capsys, *arguments):
    """What a command tells that is refused: its status is 2, and it prints neither a result nor a traceback."""
    from symmb.show.cli.main import main

    try:
        status = main(arguments)
    except SystemExit as stop:  # argparse leaves on its own
        status = stop.code
    told = capsys.readouterr()
    assert status == 2 and not told.out and "Traceback" not in told.err
    return told.err
