"""The templates of pages, and how they write numbers and names."""

import jinja2

from qboot.study.analysis.words import as_number

PAGES = jinja2.Environment(
    loader=jinja2.PackageLoader("qboot.study.report"), autoescape=True, trim_blocks=True, lstrip_blocks=True
)


def as_duration(seconds: float) -> str:
    """A wall time for people."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 6_000:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3_600:.1f} h"


def as_title(name: str) -> str:
    """The name of a task for people."""
    words = name.replace("_", " ").replace("-", " ")
    return words[:1].upper() + words[1:]


def as_section(text: str) -> str:
    """A number of a section such as V-B3, which must not be broken."""
    return text.replace("-", "\N{NON-BREAKING HYPHEN}")


PAGES.filters |= {"number": as_number, "duration": as_duration, "title_of": as_title, "section": as_section}
