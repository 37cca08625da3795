"""Laboratory files of known truth, and a table of what became of each.

    python tests/laboratory_files.py                          reads every file and prints the table
    python tests/laboratory_files.py --write FOLDER [NAME]    writes the files whose name contains NAME into a folder
    python tests/laboratory_files.py --only NAME              the table of these alone, with the whole message

Set LABORATORY_SALT to any text for other numbers in every file.
"""  # fmt: skip

import sys
from argparse import ArgumentParser
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parent))

from laboratory_books import CASES as BOOKS
from laboratory_habits import CASES as HABITS
from laboratory_texts import CASES as TEXTS
from laboratory_truth import judge

CASES = {case.name: case for case in (*TEXTS, *HABITS, *BOOKS)}


def main():
    """Print the table, or write the files."""
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--write", nargs="+", metavar="FOLDER")
    parser.add_argument("--only", default="", metavar="NAME")
    args = parser.parse_args()
    if args.write:
        wanted = args.write[1] if len(args.write) > 1 else ""
        for number, case in enumerate(CASES.values()):
            if wanted in case.name:
                place = case.write(Path(args.write[0]) / f"{number:03d}")
                print(f"{place}   {case.name}: {' or '.join(case.expected)}   {case.options}")
        return 0
    faults = 0
    with TemporaryDirectory() as folder:
        for number, case in enumerate(case for case in CASES.values() if args.only in case.name):
            verdict = judge(case, Path(folder) / str(number))
            faults += bool(verdict.fault)
            message = verdict.message if args.only else verdict.message[:90]
            head = f"{'FAIL' if verdict.fault else 'ok  '}  {verdict.outcome:8}{verdict.deviation:9.3g}"
            print(f"{head}  {case.name}   | {message}")
            if verdict.fault:
                print(f"        {verdict.fault if args.only else verdict.fault[:160]}")
    print(f"{len(CASES)} files, {faults} not as expected")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
