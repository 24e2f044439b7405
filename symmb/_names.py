"""Near misses: what a user may have meant by an unknown name."""

from collections.abc import Iterable
from difflib import get_close_matches


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """' Did you mean 'x'?' or a list of what is known, for the end of an error message."""
    known = list(known)
    close = get_close_matches(name, known, n=1)
    if close:
        return f" Did you mean {close[0]!r}?"
    shown = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "")
    return f" Known are: {shown}." if known else ""
