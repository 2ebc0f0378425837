"""XML out of texts that may hold anything: characters that XML 1.0 forbids become U+FFFD."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import Final

# [XML 1.0, production 2]; NUL, escape and halves of surrogate pairs are not among them
_FORBIDDEN: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def xml_bytes(root: ET.Element) -> bytes:
    """Return the document in UTF-8, its elements' texts and attributes made of characters that XML allows."""
    for element in root.iter():
        element.text = None if element.text is None else _FORBIDDEN.sub("\ufffd", element.text)
        for name, value in element.attrib.items():
            element.attrib[name] = _FORBIDDEN.sub("\ufffd", value)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))
