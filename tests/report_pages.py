"""Reads report pages as a browser would, and what they carry."""

from __future__ import annotations

import base64
import json
from html.parser import HTMLParser
from pathlib import Path

import numpy as np

#: A name that would run as a script if it were written as HTML.
EVIL = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"


class _Page(HTMLParser):
    """Collects elements as a browser would see them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self.inside = tag

    def handle_data(self, data: str) -> None:
        if self.inside == "script":
            self.scripts.append(data)
            self.inside = ""


def read_page(path: Path) -> tuple[_Page, dict]:
    page = _Page(path.read_text(encoding="utf-8"))
    return page, json.loads(page.scripts[0])


def unpack(packed: dict[str, str]) -> np.ndarray:
    kinds = {"f32": "<f4", "i16": "<i2", "i8": "i1", "u8": "u1", "u16": "<u2", "u32": "<u4"}
    return np.frombuffer(base64.b64decode(packed["data"]), kinds[packed["type"]])
