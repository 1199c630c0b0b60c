"""Every page of instructions is followed as it is written, in a fresh environment.

A page becomes one shell script: ``bash`` blocks run as they are, ``python`` blocks are fed to
Python, and a block under a line like **`folder/file.py`** is written to that file. A ``text`` block
shows lines of what the command before it printed, in order; … stands for anything. A ``toml`` or
``yaml`` block without a file is an excerpt of a file in docs/examples.
"""

from __future__ import annotations

import importlib
import os
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from environments import Environment

from gdg.components import KINDS

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = ("write-a-component", "ship-a-package", "add-your-hand")
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FILE_MARKER = re.compile(r"^\*\*`([^`]+)`\*\*\n\n\Z", re.MULTILINE)
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
END = "END_OF_BLOCK"


@dataclass(frozen=True)
class Block:
    """One fenced block of a page.

    Attributes:
        line: line of the page where it begins.
        language: what stands behind its fence.
        text: its content.
        file: the file that it is written to, or "".
    """

    line: int
    language: str
    text: str
    file: str

    @property
    def script(self) -> str:
        """The shell commands that do what the block says; "" for one that only shows."""
        here = f"<<'{END}'\n{self.text}{END}\n"
        if self.file:
            return f'mkdir -p "$(dirname "{self.file}")"\ncat > "{self.file}" {here}'
        return {"bash": self.text, "python": f"python - {here}"}.get(self.language, "")


def blocks_of(page: str) -> Iterator[Block]:
    for match in BLOCK.finditer(page):
        marker = FILE_MARKER.search(page[: match.start()])
        line = page[: match.start()].count("\n") + 1
        yield Block(line, match[1], match[2], marker[1] if marker else "")


def follow(blocks: list[Block], folder: Path, environment: Environment) -> dict[int, str]:
    """Runs all blocks in one shell; gives what each printed, by its line.

    Fails with the output of the block at which the shell stopped.
    """
    logs = folder / "logs"
    logs.mkdir()
    parts = ["set -euo pipefail"]
    for block in blocks:
        if block.script:
            parts += [f"exec >{logs / str(block.line)} 2>&1", block.script]
    work = folder / "work"
    work.mkdir()
    (work / "gdg").symlink_to(folder / "clone")
    script = folder / "page.sh"
    script.write_text("\n".join(parts))
    variables = {**os.environ, **environment.variables, "COLUMNS": "200"}
    code = subprocess.run(["bash", str(script)], cwd=work, env=variables, check=False).returncode
    printed = {int(log.name): log.read_text() for log in logs.iterdir()}
    if code:
        last = max(printed)
        raise AssertionError(f"the block in line {last} failed with {code}:\n{printed[last]}")
    return printed


def missing_line(expected: str, printed: str) -> str:
    """The first expected line that what was printed does not have, or ""."""
    rest = [" ".join(line.split()) for line in printed.splitlines()]
    for line in filter(None, (" ".join(line.split()) for line in expected.splitlines())):
        pattern = ".*".join(re.escape(part.strip()) for part in line.split("…"))
        found = next((i for i, other in enumerate(rest) if re.search(pattern, other)), None)
        if found is None:
            return line
        rest = rest[found + 1 :]
    return ""


@pytest.fixture(scope="module")
def environment(
    wheel: Path, no_network: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> Environment:
    """A fresh environment with gdg, in which the pages are followed one after the other."""
    made = Environment.create(tmp_path_factory.mktemp("docs") / "venv", no_network)
    made.run("pip", "install", "--quiet", str(wheel), cwd=wheel.parent)
    return made


@pytest.mark.timeout(600)
@pytest.mark.parametrize("page", PAGES)
def test_the_page_works_as_it_is_written(
    page: str, environment: Environment, copy: Path, tmp_path: Path
):
    blocks = list(blocks_of((DOCS / f"{page}.md").read_text(encoding="utf-8")))
    (tmp_path / "clone").symlink_to(copy)
    printed = follow(blocks, tmp_path, environment)
    before = ""
    for block in blocks:
        if block.language == "text":
            missing = missing_line(block.text, before)
            assert not missing, f"line {block.line}: '{missing}' is not in:\n{before}"
        else:
            before = printed.get(block.line, before)


@pytest.mark.parametrize("page", PAGES)
def test_excerpts_are_those_of_the_examples(page: str):
    sources = [
        path.read_text(encoding="utf-8")
        for pattern in ("*.toml", "*.yaml")
        for path in (DOCS / "examples").rglob(pattern)
    ]
    for block in blocks_of((DOCS / f"{page}.md").read_text(encoding="utf-8")):
        if block.language in ("toml", "yaml") and not block.file:
            shown = "\n".join(line for line in block.text.splitlines() if line)
            found = any(shown in _bare(source) for source in sources)
            assert found, f"line {block.line} is in no file of docs/examples"


def _bare(source: str) -> str:
    lines = source.splitlines()
    return "\n".join(line for line in lines if line and not line.startswith("#"))


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere_and_the_readme_leads_here(page: str):
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    for target in LINK.findall(text):
        assert target.startswith("http") or (DOCS / target).exists(), target
    assert f"docs/{page}.md" in (DOCS.parent / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("kind", KINDS)
def test_the_table_of_kinds_names_each_class_and_what_it_leaves_abstract(kind: str):
    page = (DOCS / "write-a-component.md").read_text(encoding="utf-8")
    (row,) = [line for line in page.splitlines() if line.startswith(f"| `{kind}` |")]
    module, _, name = KINDS[kind].partition(":")
    assert f"`{module}.{name}`" in row
    for method in getattr(importlib.import_module(module), name).__abstractmethods__:
        assert f"`{method}`" in row


# -- the runner itself -------------------------------------------------------------------------


PAGE = """\
**`a/b.txt`**

```toml
x = "$HOME"
```

```bash
cat a/b.txt && cd a
```

```text
x = …E"
```

```python
from pathlib import Path
print(Path.cwd().name)
```
"""


def test_files_are_written_and_one_shell_goes_through_the_page(
    environment: Environment, tmp_path: Path
):
    blocks = list(blocks_of(PAGE))
    assert [(b.line, b.language, b.file) for b in blocks] == [
        (3, "toml", "a/b.txt"), (7, "bash", ""), (11, "text", ""), (15, "python", ""),
    ]  # fmt: skip
    assert follow(blocks, tmp_path, environment) == {3: "", 7: 'x = "$HOME"\n', 15: "a\n"}


def test_the_block_that_fails_is_named_with_what_it_printed(
    environment: Environment, tmp_path: Path
):
    page = "```bash\ntrue\n```\n```bash\necho said; false\necho never\n```\n"
    with pytest.raises(AssertionError, match=r"the block in line 4 failed with 1:\nsaid\n$"):
        follow(list(blocks_of(page)), tmp_path, environment)


@pytest.mark.parametrize(
    ("expected", "missing"),
    [
        ("one  two\nthree", ""),
        ("three\none", "one"),
        ("o…o", ""),
        ("one … three", "one … three"),
        ("tw\n\n", ""),
    ],
)
def test_expected_lines_must_be_printed_in_order(expected: str, missing: str):
    assert missing_line(expected, "one two\nmore\nthree\n") == missing
