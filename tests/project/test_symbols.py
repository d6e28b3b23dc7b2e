"""Names: the table of symbols, docs/symbols.md, against the syntax trees of the modules that it names, and classes."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "docs" / "symbols.md"
REFERENCE = re.compile(r"\(\d+\)|(?:Remark|Property) \d+")
HEADER = ["paper", "code", "kind", "shape", "unit", "equation", "file"]


class Row(NamedTuple):
    """One line of the table, cell by cell."""

    paper: str
    code: str
    kind: str
    shape: str
    unit: str
    equation: str
    file: str

    def faults(self, source: str) -> list[str]:
        """What the source of `file` does not have of the row: names, of the kind that it says, and equations."""
        defined, cited = definitions(source), citations(source)
        names = re.findall(r"`([\w.]+)`", self.code)
        missing = [f"no {self.kind} {name}" for name in names if self.kind not in defined[name]]
        return missing + [
            f"{reference} is not cited" for reference in REFERENCE.findall(self.equation) if reference not in cited
        ]


def table() -> list[Row]:
    lines = [line for line in TABLE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    header, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    assert header == HEADER
    return [Row(*row) for row in rows]


def definitions(source: str) -> defaultdict[str, set[str]]:
    """The kinds of definition of each qualified name: class, function, method, property, field, attribute, argument or
    variable."""
    found: defaultdict[str, set[str]] = defaultdict(set)

    def visit(node: ast.AST, path: tuple[str, ...], in_class: bool) -> None:
        def note(name: str, kind: str) -> None:
            found[".".join((*path, name))].add(kind)

        for child in ast.iter_child_nodes(node):
            match child:
                case ast.ClassDef(name=name):
                    note(name, "class")
                    visit(child, (*path, name), True)
                    continue
                case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                    decorators = {ast.unparse(decorator).split(".")[-1] for decorator in child.decorator_list}
                    is_property = in_class and decorators & {"property", "cached_property"}
                    note(name, "property" if is_property else "method" if in_class else "function")
                    visit(child, (*path, name), False)
                    continue
                case ast.AnnAssign(target=ast.Name(id=name)) if in_class:
                    note(name, "field")
                case ast.Name(id=name, ctx=ast.Store()) if not in_class:
                    note(name, "variable")
                case ast.Attribute(value=ast.Name(id="self"), attr=name, ctx=ast.Store()):
                    found[".".join((*path[:-1], name))].add("attribute")
                case ast.arg(arg=name):
                    note(name, "argument")
            visit(child, path, in_class)

    visit(ast.parse(source), (), False)
    return found


def citations(source: str) -> set[str]:
    """Equations, remarks and properties of the paper that a module's strings and comments name; code is not text."""
    nodes, tokens = ast.walk(ast.parse(source)), tokenize.generate_tokens(io.StringIO(source).readline)
    strings = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    comments = [token.string for token in tokens if token.type == tokenize.COMMENT]
    text = re.sub(r"Remarks (\d+) and (\d+)", r"Remark \1, Remark \2", "\n".join(strings + comments))
    return set(REFERENCE.findall(text))


@pytest.mark.parametrize("row", table(), ids=lambda row: row.paper)
def test_each_symbol_is_defined_where_the_table_says(row: Row) -> None:
    assert re.findall(r"`[\w.]+`", row.code)
    assert row.faults((ROOT / row.file).read_text(encoding="utf-8")) == []


MODULE = '''
"""Module of a symbol that is only spoken of: spoken, (7)."""
from elsewhere import imported

CONSTANT = 1  # spoken, (8)

class Record:
    """A record; spoken."""

    entry: float
    spoken_of = "spoken"

    @property
    def value(self): return self.spoken

    def method(self, given): self.kept = (9); return spoken(given, self.spoken)

def function():
    inner = "spoken" + spoken
    for step in []: pass
'''


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        ("CONSTANT", "variable"), ("Record", "class"), ("Record.entry", "field"), ("Record.value", "property"),
        ("Record.method", "method"), ("Record.method.given", "argument"), ("Record.kept", "attribute"),
        ("function", "function"), ("function.inner", "variable"), ("function.step", "variable"),
    ],
)  # fmt: skip
def test_a_definition_is_found_as_its_own_kind_only(code: str, kind: str) -> None:
    row = Row("", f"`{code}`", kind, "", "", "(7), (8)", "")
    assert row.faults(MODULE) == []
    assert row._replace(kind="class" if kind == "field" else "field").faults(MODULE)


def test_a_name_that_is_only_used_or_spoken_of_is_a_fault() -> None:
    kinds = ("class", "function", "method", "property", "field", "attribute", "argument", "variable")
    names = ("spoken", "Record.spoken", "Record.method.spoken", "function.spoken", "imported", "entry", "inner")
    for kind in kinds:
        row = Row("", " ".join(f"`{name}`" for name in names), kind, "", "", "(9)", "")
        assert row.faults(MODULE) == [*(f"no {kind} {name}" for name in names), "(9) is not cited"]


def test_a_class_has_a_name_of_its_own() -> None:
    """One word means one thing. The independent simulator has the words of what it checks, and shares no code with
    it."""
    rooms = ("app", "controllers", "drivers", "environments", "kernels", "parameters")
    files = [file for room in rooms for file in (ROOT / room).rglob("*.py") if not file.stem.startswith("independent_")]
    found: defaultdict[str, list[str]] = defaultdict(list)
    for file in files:
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(str(file.relative_to(ROOT)))
    assert {name: places for name, places in found.items() if len(places) > 1} == {}
