"""Pages of the site that are made by each build: what `python -m rhs help columns` prints, as tables."""

from itertools import groupby

from rhs.config.dictionary import lines


def on_files(files, config):
    """Called by MkDocs."""
    from mkdocs.structure.files import File

    files.append(File.generated(config, "columns.md", content=columns_page()))
    return files


def columns_page() -> str:
    """Every column, event and status with its meaning, a table for each section."""
    text = ["# Columns, events and statuses", "", "As `python -m rhs help columns` prints them."]
    for title, found in groupby(lines(), key=lambda line: line[0]):
        text += ["", f"## {title}", "", "| name | meaning |", "|---|---|"]
        text += [f"| `{name}` | {meaning.replace('|', chr(92) + '|')} |" for _, name, meaning in found]
    return "\n".join(text) + "\n"
