"""Measures of the package's structure, compared with another revision: files, lines, circles, names, complexity.

    python benchmarks/structure.py [--base REVISION]

Code lines are those that are neither blank nor part of a docstring. Circles count every relative import between
modules of the package, also within functions and under TYPE_CHECKING. Complexity is McCabe's: decisions plus one.
"""

import argparse
import ast
import io
import subprocess
import tarfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUTSIDE = ("tests", "docs", "benchmarks", "notebooks", "build")
DECISIONS = (ast.If, ast.IfExp, ast.For, ast.While, ast.ExceptHandler, ast.comprehension, ast.Assert, ast.match_case)
LONG_FILE, LONG_FUNCTION, LONG_CIRCLE = 400, 60, 2

Function = ast.FunctionDef | ast.AsyncFunctionDef


def sources(revision=None):
    """Source text by path, of the working tree or of a revision."""
    if revision is None:
        paths = [path for pattern in ("*.py", "*.pyi") for path in ROOT.glob(pattern)]
        paths += [path for part in ROOT.iterdir() if is_package(part.name) for path in part.rglob("*.py*")]
        texts = {path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in paths if path.suffix != ".pyc"}
    else:
        packed = subprocess.run(["git", "archive", revision], cwd=ROOT, capture_output=True, check=True).stdout
        with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
            members = [m for m in archive.getmembers() if m.name.endswith((".py", ".pyi"))]
            texts = {m.name: archive.extractfile(m).read().decode() for m in members}
    return {name: text for name, text in texts.items() if is_package(name.split("/")[0])}


def is_package(name):
    """Whether a file or folder at the root belongs to the package."""
    return name not in OUTSIDE and not name.startswith(".")


def docstring_lines(nodes):
    """Numbers of the lines that docstrings fill."""
    lines = set()
    for node in nodes:
        if isinstance(node, (ast.Module, ast.ClassDef, Function)) and ast.get_docstring(node, clean=False) is not None:
            lines.update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return lines


def code_lines(text, nodes):
    """Lines that are neither blank nor part of a docstring."""
    skipped = docstring_lines(nodes)
    return sum(1 for number, line in enumerate(text.splitlines(), 1) if line.strip() and number not in skipped)


def functions(nodes) -> Iterator[tuple[str, int, int]]:
    """Name, length without docstring and complexity of each function."""
    for node in nodes:
        if isinstance(node, Function):
            lines = node.end_lineno - node.lineno + 1
            if ast.get_docstring(node, clean=False) is not None:
                lines -= node.body[0].end_lineno - node.body[0].lineno + 1
            yield node.name, lines, complexity(node)


def complexity(function):
    """McCabe's complexity; inner functions count on their own."""
    found, nodes = 1, list(ast.iter_child_nodes(function))
    while nodes:
        node = nodes.pop()
        if isinstance(node, Function):
            continue
        found += isinstance(node, DECISIONS)
        found += len(node.values) - 1 if isinstance(node, ast.BoolOp) else 0
        nodes.extend(ast.iter_child_nodes(node))
    return found


def imported(name, nodes, modules):
    """Modules of the package that a module imports anywhere."""
    package = name.split("/")[:-1]
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1] + (node.module.split(".") if node.module else [])
            for alias in node.names:
                whole = "/".join([*base, alias.name])
                target = whole if whole in modules else "/".join(base)
                if modules.get(target) not in (None, name):
                    yield modules[target]


def circles(nodes):
    """Strongly connected components of more than one module, largest first (Tarjan), by the nodes of each module."""
    modules = {name.removesuffix(".py").removesuffix("/__init__"): name for name in nodes}
    graph = {name: set(imported(name, found, modules)) for name, found in nodes.items()}
    index, low, stack, found = {}, {}, [], []

    def visit(node):
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph[node]:
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            at = stack.index(node)
            if len(stack) - at > 1:
                found.append(sorted(stack[at:]))
            del stack[at:]

    for node in graph:
        if node not in index:
            visit(node)
    return sorted(found, key=len, reverse=True)


def public_names(texts):
    """Names in ``__all__`` of the packages; of the root those that are no package and of no package's."""
    packages = {name.split("/")[0] for name in texts if "/" in name}
    found = []
    for package in (*sorted(packages), ""):
        path = f"{package}/__init__.py".lstrip("/")
        for candidate in (path + "i", path):
            names = declared(texts.get(candidate, ""))
            if names:
                known = {*packages, *(one.rpartition(".")[2] for one in found if not package)}
                found += [f"{package}.{name}".lstrip(".") for name in names if name not in known and name[0] != "_"]
                break
    return found


def declared(text):
    """The list that ``__all__`` is."""
    for node in ast.parse(text).body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if any(getattr(target, "id", "") == "__all__" for target in targets) and isinstance(node.value, ast.List):
            return ast.literal_eval(node.value)
    return []


def quantile(values, share):
    """Quantile of whole numbers: the smallest that ``share`` of them do not exceed."""
    values = sorted(values)
    return values[min(len(values) - 1, int(share * len(values)))]


def measures(texts):
    """All measures by name."""
    trees = {name: ast.parse(text) for name, text in texts.items() if name.endswith(".py")}
    nodes = {name: list(ast.walk(tree)) for name, tree in trees.items()}
    lengths = {name: len(texts[name].splitlines()) for name in trees}
    each = [(f"{name}:{f}", lines, worth) for name, found in nodes.items() for f, lines, worth in functions(found)]
    worth = [item[2] for item in each]
    rings = circles(nodes)
    same = [
        name for name, tree in trees.items()
        if any(isinstance(node, Function) and node.name == Path(name).stem for node in tree.body)
    ]  # fmt: skip
    return {
        "Python files": len(trees),
        "code lines": sum(code_lines(texts[name], found) for name, found in nodes.items()),
        "lines of the longest file": max(lengths.values()),
        f"files above {LONG_FILE} lines": sum(length > LONG_FILE for length in lengths.values()),
        "median file, lines": quantile(lengths.values(), 0.5),
        "functions": len(each),
        f"functions above {LONG_FUNCTION} lines": sum(lines > LONG_FUNCTION for _, lines, _ in each),
        "lines of the longest function": max(lines for _, lines, _ in each),
        "complexity, mean": round(sum(worth) / len(worth), 2),
        "complexity, 90 % at most": quantile(worth, 0.9),
        "complexity, largest": max(worth),
        "files in the longest import circle": max(map(len, rings), default=1),
        f"import circles above {LONG_CIRCLE} files": sum(len(ring) > LONG_CIRCLE for ring in rings),
        "public names": len(public_names(texts)),
        "modules named like a function in them": len(same),
    }, [*(f"circle: {', '.join(ring)}" for ring in rings if len(ring) > LONG_CIRCLE),
        *(f"{lines} lines: {name}" for name, lines, _ in each if lines > LONG_FUNCTION),
        *(f"{length} lines: {name}" for name, length in lengths.items() if length > LONG_FILE),
        *(f"named like its function: {name}" for name in same)]  # fmt: skip


def main():
    """Print the measures of the tree, and of ``--base`` in a second column."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--base", metavar="REVISION", help="revision to compare with")
    args = parser.parse_args()
    now, remarks = measures(sources())
    base = measures(sources(args.base))[0] if args.base else {}
    print(f"{'':44}{'now':>10}" + (f"{args.base[:10]:>12}" if base else ""))
    for name, value in now.items():
        print(f"{name:44}{value:>10}" + (f"{base[name]:>12}" if base else ""))
    print(*remarks, sep="\n")


if __name__ == "__main__":
    main()
