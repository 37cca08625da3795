"""Write the reproduction ledger from the running code: ``python docs/reproduction > docs/reproduction.md``."""

from collections import Counter
from importlib import import_module

from entry import Entry

PAPERS = {
    "ac2016": ("AC-2016", "Alaskari & Oraby 2016, ICAESAM'2016, doi 10.15242/IIE.E1216006"),
    "ac2017": ("AC-2017", "Alaskari & Oraby 2017, Kuwait J. Sci. (accepted June 2017)"),
    "clm2023": ("CLM-2023", "Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587"),
    "surf": ("SURF", "turning at constant roughness through constant force (the copy used names no authors)"),
    "lyap": ("LYAP", "adaptive cutting force control by Lyapunov's method (the copy used names no authors)"),
}
HEAD = """# Reproduction ledger

Every number that the five papers print and that fitmodels can compute, beside what the running code gives. The page is
made by `python docs/reproduction`; a test makes it again and compares. What is computed here is simulated or calculated
from printed laws: nothing on this page was measured by us.

Verdicts: **reproduced** to the digits that are printed, or as far as the line says; **corrected with proof**: the print
is wrong, and the line says why; **reconstructed**: the paper leaves a gap, and the line says what fills it; **not
computable**: and why.
"""


def main() -> None:
    """Print the page."""
    found = {module: import_module(module).entries() for module in PAPERS}
    print(HEAD)
    print("| paper | " + " | ".join(VERDICTS) + " |\n|---|" + "---|" * len(VERDICTS))
    for module, (name, _) in PAPERS.items():
        counts = Counter(entry.verdict for entry in found[module])
        print(f"| {name} | " + " | ".join(str(counts[verdict]) for verdict in VERDICTS) + " |")
    for module, (name, source) in PAPERS.items():
        print(f"\n## {name}\n\n{source}\n")
        print("| where | what | printed | ours | difference | verdict | why |\n|---|---|---|---|---|---|---|")
        for entry in found[module]:
            print(row(entry))


VERDICTS = ("reproduced", "corrected with proof", "reconstructed", "not computable")


def row(entry: Entry) -> str:
    """A line of the table."""
    cells = (
        entry.place,
        entry.quantity,
        f"{entry.printed} {entry.unit}".strip(),
        "" if entry.ours is None else f"{entry.ours:.6g} {entry.unit}".strip(),
        difference(entry),
        entry.verdict,
        entry.why,
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def difference(entry: Entry) -> str:
    """Ours less the printed, in per cent of it."""
    try:
        printed = float(entry.printed)
    except ValueError:
        return ""
    if entry.ours is None:
        return ""
    if printed == 0:
        return f"{entry.ours:+.2g}"
    percent = 100 * (entry.ours - printed) / abs(printed)
    return "0" if abs(percent) < 5e-5 else f"{percent:+.2g} %"


if __name__ == "__main__":
    main()
