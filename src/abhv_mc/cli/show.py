"""``abhv-mc show``: what a report says of one topic."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import Json, folder_argument
from abhv_mc.cli.printing import print_section_table, say, show


def command(
    topic: Annotated[str, typer.Argument(metavar="TOPIC", help="A topic of the report, such as margins.")],
    folder: Annotated[Path, folder_argument("Folder of a campaign.")],
    json: Json = None,
) -> None:
    """Print what the report says of a topic: its sentences and tables, or its numbers with --json."""
    from abhv_mc.folder.flown_campaign import read_flown
    from abhv_mc.topics.plain import plain
    from abhv_mc.topics.registry import find_topic
    from abhv_mc.topics.topic import Models

    asked = find_topic(topic)
    models = Models(read_flown(folder))
    model = models[asked]
    models.results.refuse_changes()

    def in_words() -> None:
        for sentence in models.sentences(asked):
            say(sentence)
        section = models.section(asked)
        if section is None:
            say(f"nothing on {topic} in this campaign")
        tables = section.tables() if section else ()
        for table in tables:
            print_section_table(table)
        for item in section.items if section and not tables else ():  # its words then stand in no table
            words = getattr(item, "sentences", (getattr(item, "text", ""),))
            say("\n".join(words))

    show(plain(model), json, in_words)
