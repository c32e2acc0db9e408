"""Write and execute docs/example.ipynb: `python docs/make_example.py` (needs the extra `notebook`; a minute or two)."""

from pathlib import Path

import nbformat
from nbclient import NotebookClient

PLACE = Path(__file__).with_name("example.ipynb")

# (kind, source) of each cell
CELLS = (
    (
        "markdown",
        """# A campaign from a notebook

The command line and this package do the same: a campaign file says what is flown, its folder holds every flight, and
the report is made from the folder. Here the tables come as pandas, and the figures are those of the report.""",
    ),
    (
        "code",
        """%matplotlib inline
import abhv_mc

campaign = abhv_mc.Campaign.read("../campaigns/s_manoeuvre.yaml")
print(campaign)
print(campaign.question)
campaign.draw_samples(4)""",
    ),
    (
        "markdown",
        """## Fly
Two hundred flights of each controller instead of a thousand. Run the cell again and nothing flies: the folder has
them.""",
    ),
    (
        "code",
        """results = campaign.run(output="../reports/example", runs=200)
results""",
    ),
    ("code", """for sentence in results.answer:\n    print("-", sentence)"""),
    (
        "markdown",
        """## Tables
`flights` has one row a flight and controller: its outcome, dispersions and metrics, SI except angles in degrees.""",
    ),
    (
        "code",
        """errors = ["angle_of_attack_error_rms_deg", "sideslip_rms_deg", "bank_error_rms_deg"]
results.flights.groupby("controller", sort=False)[errors].median()""",
    ),
    ("code", """results.quantiles.loc["speed_error_max_mps"].round(3)"""),
    ("code", """results.verdicts[["status", "failures", "runs", "lower_bound", "flights_needed"]]"""),
    (
        "markdown",
        """## Figures
The same as in the report, by name.""",
    ),
    ("code", """print(*results.figure_names)\nresults.figure("error_against_usage", dpi=80)"""),
    (
        "markdown",
        """Or any figure of one's own. The two dispersions that move the altitude most:""",
    ),
    (
        "code",
        """tlc = results.flights.query("controller == 'tlc'")
axes = tlc.plot.scatter(
    "atmosphere.density", "altitude_error_max_m", c="aero.lift", cmap="viridis", s=8, figsize=(5, 3)
)""",
    ),
    (
        "markdown",
        """## Questions
SQL over the folder's Parquet, one flight again at full rate (the same bits), and other dispersions without flying.""",
    ),
    (
        "code",
        '''results.query("""
    select controller, flight, altitude_error_max_m, "atmosphere.density", "aero.lift"
    from flights order by altitude_error_max_m desc limit 3
""")''',
    ),
    (
        "code",
        """worst = int(tlc.loc[tlc.altitude_error_max_m.idxmax()].flight)
history = results.replay(worst)
axes = history.plot("time", "altitude_m", figsize=(5, 2.5), title=f"flight {worst}")""",
    ),
    (
        "code",
        """narrower = results.whatif({"aero.drag.half_width": "10 %"})
print(narrower.attrs)
narrower.loc["speed_error_max_mps"].round(3)""",
    ),
)


def make_notebook() -> nbformat.NotebookNode:
    """The notebook without outputs."""
    makers = {"markdown": nbformat.v4.new_markdown_cell, "code": nbformat.v4.new_code_cell}
    cells = [makers[kind](source, id=f"cell-{i}") for i, (kind, source) in enumerate(CELLS)]
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return nbformat.v4.new_notebook(cells=cells, metadata={"kernelspec": kernel})


def main() -> None:
    """Execute and write it, without what only tells when and by whom it was executed."""
    notebook = make_notebook()
    NotebookClient(notebook, timeout=900, resources={"metadata": {"path": str(PLACE.parent)}}).execute()
    for cell in notebook.cells:
        cell.metadata = {}
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]  # progress
    nbformat.write(notebook, PLACE)


if __name__ == "__main__":
    main()
