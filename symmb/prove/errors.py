"""The end of a proof: what could not be shown."""


class ProofError(RuntimeError):
    """An enclosure cannot be proved; the text says what fails."""


def not_smooth(operation: str) -> ProofError:
    """An error: no step is short enough to bound the equations, of which the first operation has no bound."""
    return ProofError(
        f"the equations cannot be shown to be smooth in any step, because '{operation}' has no bound over the box, as "
        "where its argument comes close to a singular point, or where a short pulse begins"
    )
