"""The error that ends a proof."""

NO_BOUND = "has no bound over the box"
"""What the message says about an operation of equations that cannot be shown to be smooth."""


class ProofError(RuntimeError):
    """An enclosure cannot be proved. The text states the reason."""


def not_smooth(operation: str) -> ProofError:
    """The error if no step is short enough to bound the equations. `operation` is the first one without a bound."""
    return ProofError(
        f"the equations cannot be shown to be smooth in any step, because '{operation}' {NO_BOUND}; its "
        "argument may come close to a singular point, or a short pulse may begin"
    )
