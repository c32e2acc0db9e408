"""Tables as values: what stands for several rows or columns, and what is not drawn."""

from abhv_mc.topics.section import Cell, Fold, Section, Table


def table(*groups):
    return Table("t", ("Requirement", "Controller", "Ended early", "Room", "Why"), groups)


HEAD, DASH = Cell("altitude", rows=2, head=True), "\N{EM DASH}"
GROUP = (
    (HEAD, Cell("TLC", head=True), Cell("0"), Cell("1 %"), Cell("")),
    (Cell("LQR", head=True), Cell("0"), Cell("2 %"), Cell(DASH)),
)


def test_rows_and_columns_that_a_cell_stands_for_are_repeated():
    rows = table(GROUP, ((Cell("speed", head=True), Cell("none", columns=4)),)).plain_rows()
    assert rows == [
        ["altitude", "TLC", "0", "1 %", ""],
        ["altitude", "LQR", "0", "2 %", DASH],
        ["speed", *["none"] * 4],
    ]


def test_columns_that_are_empty_or_zero_throughout_are_not_drawn():
    wide = table(GROUP, ((Cell("speed", head=True), Cell("none", columns=4)),))
    (fold,) = Section("s", (Fold("f", (wide,)),)).without_idle().items
    (found,) = fold.items
    assert found.heads == ("Requirement", "Controller", "Room")
    assert found.plain_rows() == [["altitude", "TLC", "1 %"], ["altitude", "LQR", "2 %"], ["speed", "none", "none"]]


def test_one_number_keeps_its_column():
    lost = (*GROUP[1][:1], Cell("3"), *GROUP[1][2:])
    assert table((GROUP[0], lost)).without_idle().heads == ("Requirement", "Controller", "Ended early", "Room")
