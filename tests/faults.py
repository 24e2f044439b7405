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
