"""A file gets to its place whole or not at all, and follows no link that somebody laid there."""

import pytest

from abhv_mc.io.atomic_write import atomic_write


def test_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a/b.txt"
    with atomic_write(path, durable=True) as temporary:
        temporary.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    with pytest.raises(TypeError), atomic_write(path) as temporary:
        temporary.write_text(3)
    assert path.read_text() == "new" and list(path.parent.iterdir()) == [path]
