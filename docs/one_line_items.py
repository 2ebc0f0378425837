"""Parameters and errors of the package's docstrings, "name : text" on one line, in the form of the reference."""

from __future__ import annotations

import re
from typing import Any

import griffe

SECTION = re.compile(r"^(Parameters|Raises)\n-+\n((?:.+\n?)+)", re.MULTILINE)
# "name : text" and its further lines; what is indented below stays the text
ITEM = re.compile(r"^(\S[^:\n]*?) : (.+)$", re.MULTILINE)


def with_text_below(docstring: str) -> str:
    """Return a docstring whose items have their text on the line below the name."""
    return SECTION.sub(lambda section: ITEM.sub(r"\1\n    \2", section[0]), docstring)


class OneLineItems(griffe.Extension):
    """Rewrites each docstring before it is parsed; the types come from the annotations."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite the docstring of a module, class, function or attribute."""
        if obj.docstring is not None:
            obj.docstring.value = with_text_below(obj.docstring.value)
