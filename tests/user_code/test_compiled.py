"""What is kept of a compiled law is held against what was written."""

import numba

from abhv_mc.user_code import compiled
from abhv_mc.user_code.source import UserSource

LAW = """
from abhv_mc.extend import Command, controller
@controller
def law(measured, reference):
    return Command(0.0, 0.0, 0.0, 0.0)
"""


def test_a_flipped_bit_of_a_compiled_law_is_not_executed(tmp_path, monkeypatch):
    """It flew another law, or killed the process."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiled, "laws_folder", lambda: tmp_path / "laws")
    (tmp_path / "laws").mkdir()
    source = UserSource(LAW, str(tmp_path / "law.py"))

    def compile_it():
        compiled.compile_law.__wrapped__(source, (), 8)
        (kept,) = tmp_path.rglob("law_*.nbc")
        return kept, kept.read_bytes()

    kept, content = compile_it()
    assert compile_it() == (kept, content), "found in the cache"
    damaged = content[:-2000] + bytes([content[-2000] ^ 1]) + content[-1999:]
    kept.write_bytes(damaged)
    assert compile_it()[1] != damaged
