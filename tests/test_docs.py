"""The examples in the documentation run, and what it points to is there."""

import importlib
import re
from pathlib import Path

import pytest

from qboot.study.store import publishing

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted(path.name for path in DOCS.glob("*.md"))


@pytest.mark.parametrize("page", [page for page in PAGES if "```python" in (DOCS / page).read_text()])
def test_examples_run(page):
    """The blocks of a page follow each other, as a reader would type them."""
    names = {}
    for block in re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), flags=re.S):
        exec(compile(block, page, "exec"), names)


def test_what_the_map_of_the_paper_names_is_there():
    for name in re.findall(r"`(qboot(?:\.\w+)+)`", (DOCS / "paper.md").read_text()):
        parts = name.split(".")
        for length in range(len(parts), 0, -1):
            try:
                found = importlib.import_module(".".join(parts[:length]))
            except ImportError:
                continue
            break
        for part in parts[length:]:
            assert hasattr(found, part), name
            found = getattr(found, part)


def test_links_between_pages_hold():
    for page in PAGES:
        for link in re.findall(r"\]\(([\w/.-]+)\)", (DOCS / page).read_text()):
            assert (DOCS / link).exists(), f"{page}: {link}"


def test_published_files_are_what_their_checksums_say():
    assert publishing.changed_files(DOCS / "data" / "standard") == []
