"""Results as HTML, for notebooks."""

from collections.abc import Collection, Sequence

_PLAIN = 'class="tex2jax_ignore mathjax_ignore"'
"""HTML classes that stop notebooks from reading dollar signs in names as formulas."""
_SCROLLED = 'style="overflow-x: auto; max-width: 100%"'


def escape(text: str) -> str:
    """A text without marks of HTML."""
    from html import escape  # most sessions show no page

    return escape(text)


def page(*parts: str) -> str:
    """HTML with all parts, one below the other."""
    return f"<div {_SCROLLED}>{''.join(parts)}</div>"


def text(lines: str) -> str:
    """HTML of a text with all its line breaks and spaces."""
    style = "font-family: monospace; white-space: pre-wrap; margin: 0.4em 0"
    return f'<pre {_PLAIN} style="{style}">{escape(lines)}</pre>' if lines else ""


def table(rows: Sequence[Sequence[str]], left: Collection[int] = (0,)) -> str:
    """HTML of rows of cells. The first row is the head. Columns whose number is in ``left`` are aligned on the left.

    Examples
    --------
    >>> "<td" in table([["output", "lowest"], ["x < y", "-1.5"]]), "x &lt; y" in table([["a"], ["x < y"]])
    (True, True)
    """

    def row(cells: Sequence[str], tag: str) -> str:
        sides = ("left" if i in left else "right; white-space: nowrap" for i in range(len(cells)))
        return "".join(
            f'<{tag} style="padding: 0.1em 0.5em; text-align: {side}">{escape(cell)}</{tag}>'
            for cell, side in zip(cells, sides, strict=True)
        )

    head, *body = rows
    lines = "".join(f"<tr>{row(cells, 'td')}</tr>" for cells in body)
    return f"<table {_PLAIN}><thead><tr>{row(head, 'th')}</tr></thead><tbody>{lines}</tbody></table>"


def formula(latex: str) -> str:
    """HTML of a displayed formula, which notebooks typeset."""
    return f'<div class="tex2jax_process mathjax_process" {_SCROLLED}>$$ {escape(latex)} $$</div>'


def frame(document: str, title: str) -> str:
    """HTML of a frame with a separate document. The document cannot access the page around it."""
    style = "width: 100%; height: 480px; border: 1px solid #e3e7eb; background: white"
    inside = f'srcdoc="{escape(document)}" title="{escape(title)}"'
    return f'<iframe {inside} sandbox="allow-scripts" loading="lazy" style="{style}"></iframe>'


def picture(png: bytes, alt: str = "picture") -> str:
    """HTML of a picture, from the bytes of a PNG file."""
    from base64 import b64encode

    data = b64encode(png).decode()
    return f'<img alt="{escape(alt)}" style="max-width: 100%; width: 800px" src="data:image/png;base64,{data}">'
