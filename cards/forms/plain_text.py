"""Names and sentences put into Markdown so that they stay names and sentences."""

import re

# Markdown's own letters; an underscore inside a word is none of them
MARKS = re.compile(r"([\\`*\[\]|~#{}$]|(?<![^\W_])_|_(?![^\W_]))")
ENTITY = re.compile(r"&(?=[#\w])")
TAG = re.compile(r"<(?!\d)")  # <0.001 is no tag
LEAD = re.compile(r"^(?:(\d+)(?=[.)](?:\s|$))|(?=[-+](?:[\s-]|$)|=+$))")
UNSEEN = re.compile(r"[\x00-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")  # control letters, and those that turn a line


def one_line(value: object) -> str:
    r"""Text on one line, without letters that cannot be seen.

    >>> one_line("a\n\n b\x1b")
    'a b�'
    """
    return UNSEEN.sub("\N{REPLACEMENT CHARACTER}", " ".join(str(value).split()))


def text(value: object) -> str:
    r"""Text that Markdown and HTML leave alone.

    >>> print(text("<b> a_1 [x](y) p <0.001"))
    &lt;b&gt; a_1 \[x\](y) p <0.001
    """
    safe = ENTITY.sub("&amp;", one_line(value))
    safe = TAG.sub("&lt;", MARKS.sub(r"\\\1", safe)).replace(">", "&gt;")
    return LEAD.sub(lambda found: f"{found[1] or ''}\\", safe, count=1)


def code(value: object) -> str:
    """A code span, its fence longer than any run of backticks inside.

    >>> print(code("a`b"))
    ``a`b``
    """
    inside = one_line(value)
    fence = "`" * (1 + max((len(run) for run in re.findall("`+", inside)), default=0))
    pad = " " if inside[:1] in ("`", "") or inside[-1:] == "`" else ""
    return f"{fence}{pad}{inside}{pad}{fence}"


def python_text(value: str) -> str:
    """A Python string that cannot end the fence that it stands in."""
    return repr(value).replace("`", "\\x60")
