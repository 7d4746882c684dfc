"""Tables of the site that are made from the package when it is built."""

from bella.spectra import quirks


def quirk_table() -> str:
    """Table of the known quirks of instruments and products."""
    head = "| name | instrument | days | effect | what the readers do | source |\n|---|---|---|---|---|---|\n"
    rows = [
        f"| `{one.name}` | {' '.join([one.observatory, *one.receivers])} | {one.first} to {one.last or 'now'} "
        f"| {one.effect} | {one.handling} | {one.source} |"
        for one in quirks()
    ]
    return head + "\n".join(rows)


TABLES = {"quirks": quirk_table}


def with_tables(text: str) -> str:
    """Text of a page in which ``<!-- table: quirks -->`` and the like are replaced by their tables."""
    for name, made in TABLES.items():
        text = text.replace(f"<!-- table: {name} -->", made())
    return text
