"""Models of a campaign, some of them changed."""

from abhv_mc.topics.topic import Models


def changed(models, held):
    """The same campaign, with other models of these topics."""
    found = Models(models.results)
    found._held.update({topic.name: model for topic, model in held.items()})
    return found
