"""Names of what can be plugged in: lens models, receiver protocols, formats of detection models.

A name that stands in a message, a site file and two configurations as well as in the table of what there is goes wrong
at the first addition. So the table is asked: when a file or a message is read, and when a schema is written.
"""

from collections.abc import Iterable

from msgspec import Meta


def name_among(names: Iterable[str], description: str | None = None) -> Meta:
    """What the schema of a key that holds such a name says of it."""
    return Meta(description=description, extra_json_schema={"enum": sorted(names)})


def check_name(field: str, name: str, names: Iterable[str]) -> None:
    """For a struct's `__post_init__`. Raises ValueError, which settings.py and msgspec report with its place."""
    if name not in (known := sorted(names)):
        raise ValueError(f"field `{field}`: not one of {', '.join(known)}")
