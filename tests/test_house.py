"""The house's own measures: sizes, names, documentation, versions, and nothing of one particular machine."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
import tomllib
import types
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from pathlib import Path

import pytest

import insgnss
from insgnss.version import __version__

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "insgnss").rglob("*.py"))
NAMES_THAT_SAY_NOTHING = {"utils", "util", "helpers", "helper", "common", "misc", "tools", "base", "core"}
TOP_LEVEL_FOLDERS = {".ci", ".github", "data", "docs", "insgnss", "models", "notebooks", "tests"}
HEAVY_OPTIONAL_LIBRARIES = {"dask", "distributed", "matplotlib", "plotly", "scipy", "xarray"} | {
    *("lz4", "mcap", "mcap_ros2", "novatel_edie", "pyulog", "zstandard"),
}
MAX_FILE_LINES = 400
MAX_BODY_LINES = 60
MAX_KERNEL_ARGUMENTS = 8
MAX_TOP_LEVEL = 30
# absolute paths of somebody's machine, unfinished work
ABSOLUTE_PATH = re.compile(r"(?<![\w.~$}/:-])(/(home|root|Users|work|mnt|media)/\w|[A-Z]:\\\\?Users)")
UNFINISHED = re.compile(r"\b(TO" r"DO|FIX" r"ME|XX" r"X)\b")
# phrases that plain English of the field does not use
WORN_PHRASES = re.compile(
    r"(?<!here )\b(is|are) no (?!longer\b)[a-z]|\b(is|are|was|were|be) told\b|\bcannot be told\b|\btold apart\b|"
    r"\bworth telling\b|\bstays? alike\b|\bin the mean\b(?! (direction|variance))|\bnobody\b|\bwhoever\b|"
    r"\bwhat (is left of|became of)\b|\bmakes? of (it|them)\b|\bcomes? on top\b|\bthe little that\b|\bas it must\b|"
    r"\bknows? of\b|\btells? of\b|\bnothing tells\b|\bthere is none of\b|\bsuch a one\b|\bhalf of the time\b|"
    r"\blets? expect\b|\bspeaks? (for|against)\b|\band its kin\b|"
    r"\b(starts?|begins?|learnt|found|looked for|set|written|resolved|searched|computed) anew\b",
    re.IGNORECASE,
)

Function = ast.FunctionDef | ast.AsyncFunctionDef


@cache
def tree_of(path: Path) -> ast.Module:
    """Return a file's syntax: most tests here look at every file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    """Return every node of a file's syntax."""
    return list(ast.walk(tree_of(path)))


@cache
def tracked_files() -> list[Path]:
    """Return the files of the project: what git tracks or would track, or every file outside of a git checkout."""
    listing = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listing.returncode != 0:
        pytest.skip("not a git checkout: the files of the project are not known")
    return [ROOT / name for name in listing.stdout.split("\0") if name and (ROOT / name).is_file()]


def text_lines(suffixes: set[str]) -> Iterator[tuple[str, str]]:
    """Yield place ("file:line") and text of each line in the project's files with these suffixes."""
    for path in tracked_files():
        if path.suffix in suffixes and path != Path(__file__):
            name = path.relative_to(ROOT)
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
                yield f"{name}:{number}", line


def functions() -> Iterator[tuple[str, Function, bool]]:
    """Yield place, node, and whether it is public (no underscore in it or in what it stands in; not nested)."""
    for path in SOURCES:
        yield from functions_of(path)


@cache
def functions_of(path: Path) -> list[tuple[str, Function, bool]]:
    """Return the same for the functions of one file."""
    name, found = path.relative_to(ROOT), _walk(tree_of(path), public=True)
    return [(f"{name}:{node.lineno} {node.name}", node, public) for node, public in found]


def _walk(parent: ast.AST, public: bool) -> Iterator[tuple[Function, bool]]:
    for node in ast.iter_child_nodes(parent):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node, public and not node.name.startswith("_")
            yield from _walk(node, public=False)
        elif isinstance(node, ast.ClassDef):
            yield from _walk(node, public and not node.name.startswith("_"))
        else:
            yield from _walk(node, public)


def body_lines(node: Function) -> int:
    """Return the number of lines from the first statement after the docstring to the last."""
    body = node.body[1:] if ast.get_docstring(node) is not None else node.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def has_decorator(node: Function, name: str) -> bool:
    """Return whether a decorator of the function carries ``name``, as ``name``, ``x.name`` or ``name(...)``."""
    return any(name in ast.unparse(decorator).split("(")[0].split(".") for decorator in node.decorator_list)


def test_no_file_is_longer_than_the_limit() -> None:
    sizes = {path.relative_to(ROOT): len(path.read_text(encoding="utf-8").splitlines()) for path in SOURCES}

    assert {path: size for path, size in sizes.items() if size > MAX_FILE_LINES} == {}


def test_no_function_body_is_longer_than_the_limit() -> None:
    assert [
        f"{place}: {body_lines(node)} lines"
        for place, node, _ in functions()
        if body_lines(node) > MAX_BODY_LINES
    ] == []


def test_no_module_or_folder_has_a_name_that_says_nothing() -> None:
    parts = {part for path in SOURCES for part in path.relative_to(ROOT).with_suffix("").parts}

    assert parts & NAMES_THAT_SAY_NOTHING == set()


def test_every_module_and_public_class_has_a_docstring() -> None:
    without = []
    for path in SOURCES:
        tree = tree_of(path)
        nodes = [tree, *(n for n in tree.body if isinstance(n, ast.ClassDef) and not n.name.startswith("_"))]
        without += [
            f"{path.relative_to(ROOT)} {getattr(n, 'name', '')}" for n in nodes if not ast.get_docstring(n)
        ]

    assert without == []


def test_every_public_function_has_a_docstring() -> None:
    assert [
        place
        for place, node, public in functions()
        if public and not ast.get_docstring(node) and not has_decorator(node, "overload")
    ] == []


def test_every_function_is_annotated() -> None:
    bare = []
    for place, node, _ in functions():
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        arguments += [a for a in (node.args.vararg, node.args.kwarg) if a]
        missing = [a.arg for a in arguments if a.annotation is None and a.arg not in ("self", "cls")]
        if missing or node.returns is None:
            bare.append(f"{place}: {', '.join(missing) or 'return value'}")

    assert bare == []


def test_every_test_function_asserts_something() -> None:
    silent = []
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                if any(isinstance(inner, ast.Assert) for inner in ast.walk(node)):
                    continue
                if not re.search(
                    r"\bassert|pytest\.(raises|warns|fail)|\bcheck_|\bbenchmark\(", ast.unparse(node)
                ):
                    silent.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.name}")

    assert silent == []


def test_one_module_knows_numba_s_inner_parts_and_one_decorator_compiles() -> None:
    inner = re.compile(
        r"^from (numba|llvmlite)|\bnumba\.(core|n?jit|vectorize|guvectorize|cfunc|experimental)|^@n?jit",
        re.MULTILINE,
    )
    users = {
        str(path.relative_to(ROOT)) for path in SOURCES if inner.search(path.read_text(encoding="utf-8"))
    }
    decorators = {
        ast.unparse(decorator)
        for _, node, _ in functions()
        for decorator in node.decorator_list
        if has_decorator(node, "kernel")
    }

    assert users == {"insgnss/kernels/numba_parts.py"}
    assert decorators == {"kernel", "kernel(inline=True)", "kernel(apart=True)"}


def test_no_name_of_a_package_hides_its_module() -> None:
    """``import insgnss.log.flight`` must give the module, whatever the package itself names."""
    hidden = []
    for path in (p for p in SOURCES if p.parent != ROOT / "insgnss" / "cli" and p.stem != "__main__"):
        parts = path.relative_to(ROOT).with_suffix("").parts
        package, name = importlib.import_module(".".join(parts[:-1])), parts[-1]
        found = getattr(package, name, None)
        if name != "__init__" and found is not None and not isinstance(found, types.ModuleType):
            hidden.append(".".join(parts))

    assert hidden == []


def test_imports_stand_at_the_top_of_a_file() -> None:
    late = []
    # a command imports what it needs when it is called: the others start without it; ``_on_demand`` says the same
    for path in (p for p in SOURCES if p.parent.name != "cli" and not p.stem.endswith("_on_demand")):
        for place, node, _ in functions_of(path):
            for inner in ast.walk(node):
                names = [a.name for a in inner.names] if isinstance(inner, ast.Import) else []
                names += [inner.module or ""] if isinstance(inner, ast.ImportFrom) else []
                late += [f"{place}: {n}" for n in names if n.split(".")[0] not in HEAVY_OPTIONAL_LIBRARIES]

    assert late == []


def test_no_assert_checks_input_and_only_the_command_line_exits() -> None:
    found = []
    for path in SOURCES:
        for node in nodes_of(path):
            is_call = isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute)
            exits = is_call and ast.unparse(node.func) in ("sys.exit", "exit", "quit", "os._exit")
            narrows = isinstance(node, ast.Assert) and ast.unparse(node.test).endswith(" is not None")
            if (isinstance(node, ast.Assert) and not narrows) or (exits and "cli" not in path.parts):
                found.append(f"{path.relative_to(ROOT)}:{node.lineno}")

    assert found == []


def test_no_global_random_numbers() -> None:
    unseeded = r"np\.random\.(?!Generator|default_rng|SeedSequence|BitGenerator|PCG64)\w+"
    legacy = re.compile(rf"{unseeded}|default_rng\(\)")

    assert [place for place, line in text_lines({".py"}) if legacy.search(line)] == []


def test_no_line_names_a_path_of_one_machine() -> None:
    kinds = {".py", ".md", ".toml", ".yml", ".cfg", ".txt", ".ipynb", ""}

    assert [place for place, line in text_lines(kinds) if ABSOLUTE_PATH.search(line)] == []


def test_nothing_is_left_unfinished() -> None:
    assert [place for place, line in text_lines({".py", ".md", ".toml"}) if UNFINISHED.search(line)] == []


def test_no_worn_phrase_comes_back() -> None:
    pages = re.compile(r"(insgnss|notebooks)/.*\.py:|docs/.*\.md:|(README|CONTRIBUTING|COLUMNS)\.md:")

    assert [
        f"{place} {found.group()}"
        for place, line in text_lines({".py", ".md"})
        if pages.match(place) and (found := WORN_PHRASES.search(line))
    ] == []


def test_top_level_has_no_other_folder() -> None:
    folders = {path.relative_to(ROOT).parts[0] for path in tracked_files() if path.parent != ROOT}

    assert folders <= TOP_LEVEL_FOLDERS


def test_no_generated_file_is_tracked() -> None:
    generated = re.compile(r"(__pycache__|\.egg-info|\.py[co]$|\.nb[ic]$|\.parquet$|^out/|^build/|^dist/)")

    assert [p for p in (str(f.relative_to(ROOT)) for f in tracked_files()) if generated.search(p)] == []


def test_version_is_the_same_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")

    assert project["tool"]["hatch"]["version"]["path"] == "insgnss/version.py"
    assert insgnss.__version__ == __version__
    assert re.search(r"^## (\S+)", changes, re.MULTILINE).group(1) == __version__
    try:
        installed = metadata.version("insgnss")
    except metadata.PackageNotFoundError:
        pytest.skip("the package is not installed: its metadata cannot be compared")
    assert installed == __version__


def test_every_imported_library_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    # the pictures' library is optional, and one room alone may load it: see the contracts; so is that of campaigns
    optional = project["optional-dependencies"]
    named = sum(
        (optional[extra] for extra in ("campaign", "mcap", "novatel", "ulog")),
        project["dependencies"],
    )
    declared = {re.split(r"[<>=!~ ]", name)[0] for name in named}
    imported = set()
    for path in SOURCES:
        for node in nodes_of(path):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                imported.add(node.module.split(".")[0])

    part_of = {"mcap_ros2": "mcap-ros2-support", "novatel_edie": "novatel-edie", "pydantic_core": "pydantic"}
    assert {part_of.get(n, n) for n in imported} - set(sys.stdlib_module_names) - {"insgnss"} <= declared


def test_no_number_stands_for_a_state() -> None:
    """Where a state stands is a name of ``inertial/error_state.py`` or of the layout: P[PSI, PSI], never P[6, 6].

    Nor a sum with a number, P[3 + k, 3 + k]: of a point solution's unknowns the clocks begin at CLOCKS.
    """
    matrices = {"P", "A", "B", "prior", "correction", "h"}
    found = []
    for path in SOURCES:
        if path.relative_to(ROOT / "insgnss").parts[0] not in ("inertial", "filter", "aiding", "gnss"):
            continue
        for node in nodes_of(path):
            if isinstance(node, ast.Subscript) and matrix_name(node.value) in matrices:
                parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
                places = [part.lower if isinstance(part, ast.Slice) else part for part in parts]
                first = [part.left if isinstance(part, ast.BinOp) else part for part in places]
                numbers = [part.value for part in first if isinstance(part, ast.Constant)]
                if any(isinstance(number, int) and number > 2 for number in numbers):
                    found.append(f"{path.name}:{node.lineno}")

    assert found == []


def test_no_kernel_has_more_than_eight_arguments() -> None:
    kernels = [
        (place, len([*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]))
        for place, node, _ in functions()
        if has_decorator(node, "kernel")
    ]

    assert len(kernels) > 300
    assert [f"{place}: {count} arguments" for place, count in kernels if count > MAX_KERNEL_ARGUMENTS] == []


def test_every_record_says_its_fields() -> None:
    """A record that is ``Any`` hides a field that is not there: a class of ``kernels.records`` says what there is."""
    hidden = re.compile(r"^\w+: TypeAlias = Any\b", re.MULTILINE)

    assert [p.name for p in SOURCES if hidden.search(p.read_text(encoding="utf-8"))] == []


def matrix_name(node: ast.expr) -> str | None:
    """Return the name of what is indexed, as the last part of an attribute too."""
    return node.id if isinstance(node, ast.Name) else getattr(node, "attr", None)


def test_a_class_name_has_one_meaning() -> None:
    places: dict[str, list[str]] = {}
    for path in SOURCES:
        for node in nodes_of(path):
            if isinstance(node, ast.ClassDef):
                place = f"{path.relative_to(ROOT)}:{node.lineno}"
                places.setdefault(node.name.lstrip("_"), []).append(place)

    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_no_number_stands_twice_under_one_name() -> None:
    places: dict[tuple[str, float], list[str]] = {}
    for path in SOURCES:
        for name, number in numbers_of(tree_of(path)):
            places.setdefault((name.lstrip("_"), number), []).append(str(path.relative_to(ROOT)))

    assert len(places) > 500
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def numbers_of(tree: ast.Module) -> Iterator[tuple[str, float]]:
    """Yield name and value of each number that stands written out at the top level of a module."""
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(target.elts, node.value.elts, strict=False))
            for name, value in pairs:
                number = number_of(value)
                if isinstance(name, ast.Name) and number is not None:
                    yield name.id, number


def number_of(value: ast.expr) -> float | None:
    """Return what an expression of literal numbers is, None for any other."""
    literal = (ast.Constant, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop)
    if not all(isinstance(node, literal) for node in ast.walk(value)):
        return None
    number = eval(ast.unparse(value), {"__builtins__": {}})
    return float(number) if type(number) in (int, float) else None


def test_the_package_has_at_most_thirty_rooms_and_files() -> None:
    top = [
        path
        for path in (ROOT / "insgnss").iterdir()
        if path.suffix == ".py" or (path / "__init__.py").exists()
    ]

    assert len(top) <= MAX_TOP_LEVEL


def test_nothing_of_the_package_is_imported_by_string() -> None:
    """An import in a string hides an arrow between rooms; the table of former names is there to be imported so."""
    inside = re.compile(r"^insgnss(\.|$)")
    hidden = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in SOURCES
        for node in nodes_of(path)
        if isinstance(node, ast.Call)
        and ast.unparse(node.func).split(".")[-1] in ("import_module", "__import__")
        if not (
            node.args and isinstance(node.args[0], ast.Constant) and not inside.match(str(node.args[0].value))
        )
    ]

    # each takes a name from outside: former names, a module of campaign cases, the address of a kernel, a reader
    taken_from_outside = {"former_names", "tasks", "numba_parts", "sidereon_on_demand"}
    assert [place for place in hidden if Path(place.split(":")[0]).stem not in taken_from_outside] == []
