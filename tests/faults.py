"""Calls that are refused."""

import pytest

import symmb as mb


def refused(match, call, /, *arguments, error=mb.DeclarationError, **options):
    """A call ends by an error whose message matches."""
    with pytest.raises(error, match=match):
        call(*arguments, **options)
