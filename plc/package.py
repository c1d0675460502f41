"""Packages of the library for the makers' tools: `python3 plc/package.py dist/plc`, the same bytes each time.

One reading of the sources, one writer for each target; the text for each package is in `packages/`.
"""

from __future__ import annotations

import html
import json
import re
import shutil
import sys
import uuid
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

HERE = Path(__file__).resolve().parent
BUILDS = ("LREAL", "REAL")
ELEMENTARY = ("BOOL", "INT", "DINT", "LREAL", "REAL")
TOKEN = re.compile(r"\(\*.*?\*\)|:=|<=|>=|<>|\d+\.\d+(?:E[+-]?\d+)?|\d+|\w+|\S", re.DOTALL)


@dataclass(frozen=True)
class Var:
    """A declaration: its type as it is written, and its comment in one line."""

    name: str
    type: str
    initial: str = ""
    comment: str = ""

    @property
    def array(self) -> tuple[str, str, str] | None:
        """First index, last index and type of the elements."""
        found = re.fullmatch(r"ARRAY\[(-?\d+)\.\.(-?\d+)\] OF (\w+)", self.type)
        return (found[1], found[2], found[3]) if found else None


@dataclass(frozen=True)
class Unit:
    """Content of a source file; `kind` is the word it begins with."""

    name: str
    kind: str
    comment: str
    returns: str
    blocks: tuple[tuple[str, tuple[Var, ...]], ...]
    body: str

    def vars(self, *words: str) -> list[Var]:
        """Declarations, of these kinds of VAR where any are given."""
        return [var for word, block in self.blocks if not words or word in words for var in block]

    @property
    def uses(self) -> set[str]:
        """Names of the units that it needs."""
        declared = " ".join(f"{self.returns} {' '.join(var.type for var in self.vars())}".split())
        plain = re.sub(r"\(\*.*?\*\)", " ", self.body, flags=re.DOTALL)
        return set(re.findall(r"\bGlapp\w+", f"{declared} {plain}")) - {self.name}


def read(text: str) -> Unit:
    """One source file of the subset that `plc/check` holds it to."""
    opening = re.match(
        r"\s*(?:\(\*(.*?)\*\))?\s*(TYPE|FUNCTION_BLOCK|FUNCTION|PROGRAM)\s+(\w+)(?: ?:\s(\w+))?", text, re.DOTALL
    )
    if not opening:
        raise ValueError(f"no unit begins with {text[:60]!r}")
    comment, kind, name, returns = (part or "" for part in opening.groups())
    rest = text[opening.end() :].rsplit(f"END_{kind}", 1)[0]
    if kind == "TYPE":
        fields = rest.rsplit("END_STRUCT", 1)[0]
        return Unit(name, kind, one_line(comment), "", (("STRUCT", declarations(fields)),), "")
    blocks = []
    while found := re.match(r"\s*(VAR(?:_\w+)?(?: RETAIN| CONSTANT)?)\s*\n(.*?)END_VAR", rest, re.DOTALL):
        blocks.append((found[1], declarations(found[2])))
        rest = rest[found.end() :]
    return Unit(name, kind, one_line(comment), returns, tuple(blocks), rest.strip("\n"))


def declarations(text: str) -> tuple[Var, ...]:
    """Declarations with the comments behind them."""
    one = re.compile(r"(\w+) : ([^;]+?)(?: := ([^;]+))?;[ \t]*(?:\(\*(.*?)\*\))?", re.DOTALL)
    return tuple(
        Var(name, type, initial or "", one_line(comment)) for name, type, initial, comment in one.findall(text)
    )


def one_line(text: str) -> str:
    """A comment without its breaks."""
    return " ".join(text.split())


def library(build: str) -> list[Unit]:
    """The library in one build, each unit before the units that use it."""
    files = {path.name: path for path in sorted(HERE.glob("*.st"))}
    if build == "REAL":
        files |= {path.name: path for path in sorted((HERE / "real").glob("*.st"))}
    # Comments that concern both builds stay.
    typed = re.compile(r"\(\*.*?\*\)|\b\w*LREAL\b", re.DOTALL)

    def built(found: re.Match[str]) -> str:
        return found[0] if found[0].startswith("(*") else found[0].replace("LREAL", build)

    left = [read(typed.sub(built, files[name].read_text())) for name in sorted(files)]
    ordered: list[Unit] = []
    for kind in ("TYPE", "FUNCTION", "FUNCTION_BLOCK", "PROGRAM"):
        here = [unit for unit in left if unit.kind == kind]
        while here:
            done = {unit.name for unit in ordered}
            ready = [unit for unit in here if unit.uses <= done]
            if not ready:
                raise ValueError(f"{here[0].name} needs {sorted(here[0].uses - done)}")
            ordered.append(ready[0])
            here.remove(ready[0])
    return ordered


def version() -> str:
    """The version of the workspace."""
    found = re.search(r'^version = "(.+)"', (HERE.parent / "Cargo.toml").read_text(), re.MULTILINE)
    if not found:
        raise ValueError("Cargo.toml has no version")
    return found[1]


# --- Structured Text -----------------------------------------------------------------------------------------------


def declared(unit: Unit) -> str:
    """Declaration as text."""
    lines = [f"(* {unit.comment} *)"] if unit.comment else []
    if unit.kind == "TYPE":
        return "\n".join([*lines, f"TYPE {unit.name} :", "STRUCT", *lines_of(unit.vars()), "END_STRUCT;", "END_TYPE"])
    lines.append(f"{unit.kind} {unit.name}" + (f" : {unit.returns}" if unit.returns else ""))
    for word, block in unit.blocks:
        lines += [word, *lines_of(list(block)), "END_VAR"]
    return "\n".join(lines)


def lines_of(declarations: list[Var]) -> list[str]:
    """One line for each declaration."""
    lines = []
    for var in declarations:
        initial = f" := {var.initial}" if var.initial else ""
        comment = f" (* {var.comment} *)" if var.comment else ""
        lines.append(f"    {var.name} : {var.type}{initial};{comment}")
    return lines


def whole(unit: Unit) -> str:
    """A unit as text."""
    return declared(unit) if unit.kind == "TYPE" else f"{declared(unit)}\n{unit.body}\nEND_{unit.kind}"


def structured_text(units: list[Unit], build: str) -> Iterator[tuple[str, str]]:
    """All units in one file."""
    head = f"(* glapp {version()}, {build}: backlash in control loops. Apache-2.0. *)\n"
    text = head + "".join(f"\n{whole(unit)}\n" for unit in units)
    yield f"Glapp_{build}.st", text
    yield f"GlappProject_{build}.st", f"{text}\n{CONFIGURATION}"


# Parts that make a project of the library, for OpenPLC and Beremiz: first run, demonstration and example in a task of
# 0.1 s.
CONFIGURATION = """CONFIGURATION GlappConfiguration
  RESOURCE GlappResource ON PLC
    TASK GlappTask(INTERVAL := T#100ms, PRIORITY := 0);
    PROGRAM GlappRun1 WITH GlappTask : GlappSelfTest;
    PROGRAM GlappRun2 WITH GlappTask : GlappDemo;
    PROGRAM GlappRun3 WITH GlappTask : GlappLoop;
  END_RESOURCE
END_CONFIGURATION
"""


# --- PLCopen XML ---------------------------------------------------------------------------------------------------


def plcopen(units: list[Unit], build: str) -> Iterator[tuple[str, str]]:
    """PLCopen XML TC6 2.01."""
    types = [
        f"<dataType name={quoteattr(unit.name)}><baseType><struct>{xml_vars(unit.vars())}</struct></baseType>"
        f"{documentation(unit.comment)}</dataType>"
        for unit in units
        if unit.kind == "TYPE"
    ]
    pous = [xml_pou(unit) for unit in units if unit.kind != "TYPE"]
    scaling = "".join(f'<{kind}><scaling x="1" y="1"/></{kind}>' for kind in ("fbd", "ld", "sfc"))
    # The date is part of the form; it never changes, so that the bytes do not.
    yield (
        f"Glapp_{build}.xml",
        '<?xml version="1.0" encoding="utf-8"?>\n'
        '<project xmlns="http://www.plcopen.org/xml/tc6_0201">\n'
        f'<fileHeader companyName="glapp" productName="glapp" productVersion="{version()}" '
        'creationDateTime="2000-01-01T00:00:00"/>\n'
        f'<contentHeader name="glapp {build}"><coordinateInfo>{scaling}</coordinateInfo></contentHeader>\n'
        "<types>\n<dataTypes>\n" + "\n".join(types) + "\n</dataTypes>\n"
        "<pous>\n" + "\n".join(pous) + "\n</pous>\n</types>\n"
        "<instances><configurations/></instances>\n</project>\n",
    )


def xhtml(text: str) -> str:
    """Text where the form has formatted text."""
    return f'<xhtml xmlns="http://www.w3.org/1999/xhtml">{escape(text)}</xhtml>'


def documentation(comment: str) -> str:
    """A comment, where there is one."""
    return f"<documentation>{xhtml(comment)}</documentation>" if comment else ""


def xml_type(name: str) -> str:
    """A type by its name."""
    return f"<{name}/>" if name in ELEMENTARY else f"<derived name={quoteattr(name)}/>"


def xml_vars(declarations: list[Var]) -> str:
    """Declarations."""
    parts = []
    for var in declarations:
        kind = xml_type(var.type)
        if var.array:
            low, high, element = var.array
            kind = f'<array><dimension lower="{low}" upper="{high}"/><baseType>{xml_type(element)}</baseType></array>'
        initial = f"<initialValue><simpleValue value={quoteattr(var.initial)}/></initialValue>" if var.initial else ""
        parts.append(f'<variable name="{var.name}"><type>{kind}</type>{initial}{documentation(var.comment)}</variable>')
    return "\n" + "\n".join(parts) + "\n" if parts else ""


def xml_pou(unit: Unit) -> str:
    """A function, a function block or a program."""
    kind = {"FUNCTION": "function", "FUNCTION_BLOCK": "functionBlock", "PROGRAM": "program"}[unit.kind]
    parts = [f"<returnType>{xml_type(unit.returns)}</returnType>"] if unit.returns else []
    for word, block in unit.blocks:
        base, _, extra = word.partition(" ")
        tag = {"VAR_INPUT": "inputVars", "VAR_OUTPUT": "outputVars", "VAR": "localVars"}[base]
        attribute = f' {extra.lower()}="true"' if extra else ""
        parts.append(f"<{tag}{attribute}>{xml_vars(list(block))}</{tag}>")
    return (
        f'<pou name="{unit.name}" pouType="{kind}">\n<interface>\n' + "\n".join(parts) + "\n</interface>\n"
        f"<body><ST>{xhtml(unit.body)}</ST></body>\n{documentation(unit.comment)}\n</pou>"
    )


# --- TwinCAT -------------------------------------------------------------------------------------------------------


def twincat(units: list[Unit], build: str) -> Iterator[tuple[str, str]]:
    """One file for each unit, with an identity that stays."""
    for unit in units:
        guid = uuid.uuid5(uuid.NAMESPACE_URL, f"glapp/{unit.name}")
        kind, ending = ("DUT", "TcDUT") if unit.kind == "TYPE" else ("POU", "TcPOU")
        # The tool itself writes no semicolon there.
        declaration = declared(unit).replace("\nEND_STRUCT;", "\nEND_STRUCT")
        special = "" if unit.kind == "TYPE" else ' SpecialFunc="None"'
        code = (
            ""
            if unit.kind == "TYPE"
            else f"\n    <Implementation>\n      <ST><![CDATA[{unit.body}]]></ST>\n    </Implementation>"
        )
        yield (
            f"{build}/{unit.name}.{ending}",
            '<?xml version="1.0" encoding="utf-8"?>\n<TcPlcObject Version="1.1.0.1" ProductVersion="3.1.4024.0">\n'
            f'  <{kind} Name="{unit.name}" Id="{{{guid}}}"{special}>\n'
            f"    <Declaration><![CDATA[{declaration}\n]]></Declaration>{code}\n  </{kind}>\n</TcPlcObject>\n",
        )


# --- Siemens -------------------------------------------------------------------------------------------------------


def siemens(units: list[Unit], build: str) -> Iterator[tuple[str, str]]:
    """One external source: variables with #, names of units in quotes, pins of functions by name."""
    functions = {unit.name: [var.name for var in unit.vars("VAR_INPUT")] for unit in units if unit.kind == "FUNCTION"}
    texts = [f"// glapp {version()}, {build}: backlash in control loops. Apache-2.0.\n"]
    for unit in units:
        note = f"// {unit.comment}\n" if unit.comment else ""
        if unit.kind == "TYPE":
            fields = "\n".join(scl_lines(unit.vars()))
            texts.append(f'{note}TYPE "{unit.name}"\nVERSION : 0.1\n    STRUCT\n{fields}\n    END_STRUCT;\nEND_TYPE\n')
            continue
        # TIA has no programs: a program is a block that OB1 calls.
        kind = "FUNCTION_BLOCK" if unit.kind == "PROGRAM" else unit.kind
        returns = f" : {unit.returns}" if unit.returns else ""
        lines = [f'{kind} "{unit.name}"{returns}', "{ S7_Optimized_Access := 'TRUE' }", "VERSION : 0.1"]
        for word, block in unit.blocks:
            lines += ["VAR_TEMP" if word == "VAR" and kind == "FUNCTION" else word, *scl_lines(list(block)), "END_VAR"]
        lines += ["BEGIN", scl_body(unit, functions), f"END_{kind}\n"]
        texts.append(note + "\n".join(lines))
    yield f"Glapp_{build}.scl", "\n".join(texts)


def scl_lines(declarations: list[Var]) -> list[str]:
    """One line for each declaration."""
    lines = []
    for var in declarations:
        kind = re.sub(r"\bGlapp\w+", r'"\g<0>"', var.type)
        initial = f" := {var.initial}" if var.initial else ""
        comment = f"   // {var.comment}" if var.comment else ""
        lines.append(f"    {var.name} : {kind}{initial};{comment}")
    return lines


def scl_body(unit: Unit, functions: dict[str, list[str]]) -> str:
    """Statements."""
    own = {var.name for var in unit.vars()} | {unit.name}
    found = list(TOKEN.finditer(unit.body))
    out, end = [], 0
    pins: list[list[str]] = []  # of the functions whose parentheses are open; an empty list for other parentheses
    for at, match in enumerate(found):
        word = match[0]
        before, after = (found[i][0] if 0 <= i < len(found) else "" for i in (at - 1, at + 1))
        out.append(unit.body[end : match.start()])
        end = match.end()
        if word == ")":
            pins.pop()
        if pins and pins[-1] and before in ("(", ","):
            out.append(f"{pins[-1].pop(0)} := ")
        if word in functions and after == "(":
            word = f'"{word}"'
        elif word in own and before != "." and not (pins and after == ":="):
            word = f"#{word}"
        elif word == "(":
            pins.append(list(functions.get(before, [])))
        out.append(word)
    return "".join(out) + unit.body[end:]


# --- AC 800M -------------------------------------------------------------------------------------------------------

Node = tuple  # ("note", text) | ("do", tokens) | ("if", [(tokens, nodes)], nodes) | ("for" or "while", tokens, nodes)


def statements(tokens: list[str], ends: tuple[str, ...] = ()) -> list[Node]:
    """Take statements off the front of tokens until one of `ends`."""

    def upto(word: str) -> list[str]:
        at = tokens.index(word)
        taken = tokens[:at]
        del tokens[: at + 1]
        return taken

    nodes: list[Node] = []
    while tokens and tokens[0] not in ends:
        first = tokens[0]
        if first.startswith("(*"):
            nodes.append(("note", tokens.pop(0)))
        elif first == "IF":
            branches, otherwise = [], []
            while tokens[0] in ("IF", "ELSIF"):
                tokens.pop(0)
                branches.append((upto("THEN"), statements(tokens, ("ELSIF", "ELSE", "END_IF"))))
            if tokens[0] == "ELSE":
                tokens.pop(0)
                otherwise = statements(tokens, ("END_IF",))
            upto(";")
            nodes.append(("if", branches, otherwise))
        elif first in ("FOR", "WHILE"):
            tokens.pop(0)
            nodes.append((first.lower(), upto("DO"), statements(tokens, (f"END_{first}",))))
            upto(";")
        else:
            nodes.append(("do", upto(";")))
    return nodes


def joined(tokens: list[str]) -> str:
    """Tokens as a line of text."""
    text = " ".join(tokens)
    text = (
        re.sub(r" ?([.\[\]]) ?", r"\1", text)
        .replace("]", "] ")
        .replace("( ", "(")
        .replace(" )", ")")
        .replace(" ,", ",")
    )
    text = re.sub(r"\b(?!AND\b|OR\b|XOR\b|NOT\b|MOD\b|IF\b|ELSIF\b|WHILE\b)([A-Za-z_]\w*) \(", r"\1(", text)
    text = re.sub(r"(?<=[(=<>+*/-] )- (?=[\w(])|(?<=\()- (?=[\w(])|(?<=, )- (?=[\w(])", "-", text)
    return re.sub(r" +", " ", text).strip()


def text_of(nodes: list[Node], depth: int = 1) -> list[str]:
    """Statements as lines."""
    pad, lines = "    " * depth, []
    for node in nodes:
        if node[0] == "note":
            lines.append(pad + one_line(node[1]))
        elif node[0] == "do":
            lines.append(f"{pad}{joined(node[1])};")
        elif node[0] == "if":
            for word, (condition, body) in zip(["IF", *["ELSIF"] * len(node[1])], node[1], strict=False):
                lines += [f"{pad}{word} {joined(condition)} THEN", *text_of(body, depth + 1)]
            if node[2]:
                lines += [f"{pad}ELSE", *text_of(node[2], depth + 1)]
            lines.append(f"{pad}END_IF;")
        else:
            word = node[0].upper()
            lines += [f"{pad}{word} {joined(node[1])} DO", *text_of(node[2], depth + 1), f"{pad}END_{word};"]
    return lines


class WithoutArrays:
    """A body without arrays and functions of our own: both become blocks, called before the statement."""

    def __init__(self, unit: Unit, functions: dict[str, Unit]) -> None:
        self.functions = functions
        self.arrays = {var.name: var for var in unit.vars() if var.array}
        self.added: dict[str, Var] = {}
        self.cells: set[tuple[str, str, str]] = set()
        own = {var.name for var in unit.vars()} | {unit.name}
        self.body = "\n".join(text_of(self.nodes(statements(TOKEN.findall(unit.body)))))
        if clash := own & set(self.added):
            raise ValueError(f"{unit.name} has {sorted(clash)} already")
        kept = []
        for word, block in unit.blocks:
            block = tuple(replace(var, type=cells_name(self.cell(var))) if var.array else var for var in block)
            kept.append((word, block))
        if self.added:
            kept.append(("VAR", tuple(self.added[name] for name in sorted(self.added))))
        kind = "FUNCTION_BLOCK" if unit.kind == "FUNCTION" else unit.kind
        if unit.kind == "FUNCTION":
            kept.insert(1, ("VAR_OUTPUT", (Var("Result", unit.returns),)))
            self.body = re.sub(rf"\b{unit.name}\b", "Result", self.body)
        self.unit = replace(unit, kind=kind, returns="", blocks=tuple(kept), body=self.body)

    def cell(self, var: Var) -> tuple[str, str, str]:
        """The array of a variable, whose block is needed then."""
        if not var.array:
            raise ValueError(f"{var.name} is no array")
        self.cells.add(var.array)
        return var.array

    def nodes(self, nodes: list[Node]) -> list[Node]:
        """Statements."""
        out: list[Node] = []
        for node in nodes:
            if node[0] == "note":
                out.append(node)
            elif node[0] == "do":
                out += self.simple(node[1])
            elif node[0] == "if":
                out += self.branches(node[1], node[2])
            else:
                before, header = self.hoisted(node[1])
                again = before if node[0] == "while" else []
                out += [*before, (node[0], header, [*self.nodes(node[2]), *again])]
        return out

    def branches(self, branches: list, otherwise: list[Node]) -> list[Node]:
        """Conditions with calls as nested branches: a call happens only where the conditions before it are not met."""
        before, condition = self.hoisted(branches[0][0])
        ways, rest = [(condition, self.nodes(branches[0][1]))], branches[1:]
        while rest:
            further, condition = self.hoisted(rest[0][0])
            if further:
                return [*before, ("if", ways, self.branches(rest, otherwise))]
            ways.append((condition, self.nodes(rest[0][1])))
            rest = rest[1:]
        return [*before, ("if", ways, self.nodes(otherwise))]

    def simple(self, tokens: list[str]) -> list[Node]:
        """An assignment or a call."""
        if tokens[0] in self.arrays and tokens[1] == "[":
            close = matching(tokens, 1)
            before, index = self.hoisted(tokens[2:close])
            further, value = self.hoisted(tokens[close + 2 :])
            call = [tokens[0], "(", "Index", ":=", *index, ",", "Write", ":=", "TRUE", ",", "Value", ":=", *value, ")"]
            return [*before, *further, ("do", call)]
        before, tokens = self.hoisted(tokens)
        return [*before, ("do", tokens)]

    def hoisted(self, tokens: list[str]) -> tuple[list[Node], list[str]]:
        """The calls that an expression needs first, innermost first, and the expression with their results."""
        before: list[Node] = []
        sites: dict[str, int] = {}

        def expression(tokens: list[str]) -> list[str]:
            out: list[str] = []
            at = 0
            while at < len(tokens):
                word = tokens[at]
                if word in self.functions and tokens[at + 1] == "(":
                    close = matching(tokens, at + 1)
                    given = [expression(part) for part in parts(tokens[at + 2 : close])]
                    short, function = f"Call{word.removeprefix('Glapp')}", self.functions[word]
                    pins = [var.name for var in function.vars("VAR_INPUT")]
                    out += site(short, word, "Result", function.returns, list(zip(pins, given, strict=True)))
                    at = close
                elif word in self.arrays and at + 1 < len(tokens) and tokens[at + 1] == "[":
                    close = matching(tokens, at + 1)
                    index = expression(tokens[at + 2 : close])
                    kind = self.cell(self.arrays[word])
                    out += site(word, None, "Cell", kind[2], [("Index", index), ("Write", ["FALSE"])])
                    at = close
                else:
                    out.append(word)
                at += 1
            return out

        def site(
            instance: str, block: str | None, result: str, kind: str, given: list[tuple[str, list[str]]]
        ) -> list[str]:
            if block:
                self.added[instance] = Var(instance, block)
            sites[instance] = sites.get(instance, 0) + 1
            name = f"{instance}{sites[instance]}"
            self.added[name] = Var(name, kind)
            call = [instance, "("]
            for pin, value in given:
                call += [pin, ":=", *value, ","]
            before.append(("do", [*call[:-1], ")"]))
            before.append(("do", [name, ":=", instance, ".", result]))
            return [name]

        rest = expression(tokens)
        return before, rest


def matching(tokens: list[str], at: int) -> int:
    """Index of the bracket that closes the one at `at`."""
    depth = 0
    for place in range(at, len(tokens)):
        depth += (tokens[place] in "([") - (tokens[place] in ")]")
        if depth == 0:
            return place
    raise ValueError(f"an open bracket in {' '.join(tokens)}")


def parts(tokens: list[str]) -> list[list[str]]:
    """Arguments, split at their commas."""
    out: list[list[str]] = [[]]
    depth = 0
    for word in tokens:
        depth += (word in "([") - (word in ")]")
        if word == "," and depth == 0:
            out.append([])
        else:
            out[-1].append(word)
    return out


def cells_name(array: tuple[str, str, str]) -> str:
    """The block that replaces an array."""
    low, high, element = array
    return f"GlappCells{low}To{high}{'' if element.endswith('REAL') else element.title()}"


def cells(array: tuple[str, str, str]) -> Unit:
    """Stores what an array would hold, one variable for each element."""
    low, high, element = int(array[0]), int(array[1]), array[2]
    lines = []
    for word, does in (("Write", "X{0} := Value"), ("", "Cell := X{0}")):
        ladder = [
            f"{'IF' if i == low else 'ELSIF'} Index = {i} THEN\n    {does.format(i)};" for i in range(low, high + 1)
        ]
        text = "\n".join([*ladder, "END_IF;"])
        lines.append(f"IF {word} THEN\n{indent(text)}\nEND_IF;" if word else text)
    inputs = (Var("Index", "INT"), Var("Write", "BOOL"), Var("Value", element))
    store = tuple(Var(f"X{i}", element) for i in range(low, high + 1))
    return Unit(
        cells_name(array),
        "FUNCTION_BLOCK",
        f"An array with the indices {low} to {high}: takes Value where Write is TRUE, and gives the stored one.",
        "",
        (("VAR_INPUT", inputs), ("VAR_OUTPUT", (Var("Cell", element),)), ("VAR", store)),
        indent("\n".join(lines)),
    )


def indent(text: str) -> str:
    """Four places further in."""
    return "\n".join(f"    {line}" for line in text.split("\n"))


def without_arrays(units: list[Unit]) -> list[Unit]:
    """The library without arrays and functions."""
    functions = {unit.name: unit for unit in units if unit.kind == "FUNCTION"}
    out: list[Unit] = []
    wanted: set[tuple[str, str, str]] = set()
    for unit in units:
        if unit.kind == "TYPE":
            out.append(unit)
            continue
        lowered = WithoutArrays(unit, functions)
        for array in sorted(lowered.cells - wanted):
            out.append(cells(array))
        wanted |= lowered.cells
        out.append(lowered.unit)
    return out


class InOnePiece:
    """A block with the blocks inside written out where they are called: one unit in place of many.

    Stores of arrays stay blocks.
    """

    def __init__(self, unit: Unit, units: dict[str, Unit]) -> None:
        self.units = units
        declared = [(word, var) for word, block in unit.blocks for var in block]
        self.inner = {var.name: self.made(var) for _, var in declared if self.made(var)}
        blocks: list[tuple[str, tuple[Var, ...]]] = []
        for word, block in unit.blocks:
            own = tuple(var for var in block if var.name not in self.inner)
            if own:
                blocks.append((word, own))
            for var in block:
                for kind, inner in self.inner[var.name].blocks if var.name in self.inner else ():
                    word_of = (
                        "VAR CONSTANT" if kind == "VAR CONSTANT" else "VAR RETAIN" if "RETAIN" in word + kind else "VAR"
                    )
                    named = tuple(replace(one, name=var.name + one.name) for one in inner)
                    blocks.append((word_of, named))
        names = [var.name.upper() for _, block in blocks for var in block]
        if len(names) != len(set(names)):
            raise ValueError(f"{unit.name}: {sorted(name for name in names if names.count(name) > 1)} twice")
        body = "\n".join(text_of(self.nodes(statements(TOKEN.findall(unit.body)))))
        self.unit = replace(unit, blocks=tuple(blocks), body=body)

    def made(self, var: Var) -> Unit | None:
        """The block that a variable is, in one piece."""
        unit = self.units.get(var.type)
        if unit is None or unit.kind == "TYPE" or unit.name.startswith("GlappCells"):
            return None
        return InOnePiece(unit, self.units).unit

    def nodes(self, nodes: list[Node]) -> list[Node]:
        """Statements."""
        out: list[Node] = []
        for node in nodes:
            if node[0] == "note":
                out.append(node)
            elif node[0] == "do" and node[1][0] in self.inner and node[1][1] == "(":
                out += self.called(node[1])
            elif node[0] == "do":
                out.append(("do", self.renamed(node[1])))
            elif node[0] == "if":
                ways = [(self.renamed(condition), self.nodes(body)) for condition, body in node[1]]
                out.append(("if", ways, self.nodes(node[2])))
            else:
                out.append((node[0], self.renamed(node[1]), self.nodes(node[2])))
        return out

    def called(self, tokens: list[str]) -> list[Node]:
        """Inputs that are given to the block, then its statements."""
        name, inner = tokens[0], self.inner[tokens[0]]
        given = [part for part in parts(tokens[2 : matching(tokens, 1)]) if part]
        out: list[Node] = [("do", [name + part[0], ":=", *self.renamed(part[2:])]) for part in given]
        own = {var.name for var in inner.vars()}
        return out + [prefixed(node, name, own) for node in statements(TOKEN.findall(inner.body)) if node[0] != "note"]

    def renamed(self, tokens: list[str]) -> list[str]:
        """An output of a block inside is a variable of this one."""
        out: list[str] = []
        at = 0
        while at < len(tokens):
            last = at + 1 == len(tokens)
            if tokens[at] in self.inner and not last and tokens[at + 1] == "." and (at == 0 or tokens[at - 1] != "."):
                out.append(tokens[at] + tokens[at + 2])
                at += 3
            else:
                out.append(tokens[at])
                at += 1
        return out


def prefixed(node: Node, prefix: str, own: set[str]) -> Node:
    """A statement with the variables of its block renamed."""

    def named(tokens: list[str]) -> list[str]:
        pins = [at + 1 < len(tokens) and tokens[at + 1] == ":=" and at > 1 for at in range(len(tokens))]
        member = [at > 0 and tokens[at - 1] == "." for at in range(len(tokens))]
        return [
            prefix + word if word in own and not member[at] and not pins[at] else word for at, word in enumerate(tokens)
        ]

    if node[0] == "note":
        return node
    if node[0] == "do":
        return ("do", named(node[1]))
    if node[0] == "if":
        ways = [(named(condition), [prefixed(one, prefix, own) for one in body]) for condition, body in node[1]]
        return ("if", ways, [prefixed(one, prefix, own) for one in node[2]])
    return (node[0], named(node[1]), [prefixed(one, prefix, own) for one in node[2]])


LONGEST = 32  # characters of a name in Control Builder


def shortened(unit: Unit) -> Unit:
    """No name is longer than Control Builder takes: the end of a longer one is its number."""
    long = [var.name for var in unit.vars() if len(var.name) > LONGEST]
    short = {name: f"{name[: LONGEST - 4]}{number:04}" for number, name in enumerate(long, 1)}
    if set(short.values()) & {var.name for var in unit.vars()}:
        raise ValueError(f"{unit.name}: a shortened name is taken")
    blocks = tuple(
        (word, tuple(replace(var, name=short.get(var.name, var.name)) for var in block)) for word, block in unit.blocks
    )
    body = re.sub(r"(?<!\.)\b\w+\b", lambda found: short.get(found[0], found[0]), unit.body)
    return replace(unit, blocks=blocks, body=body)


def in_one_piece(pages: list[Unit], name: str, *users: str) -> list[Unit]:
    """A block in one piece, after the types and stores that it needs, and units that use it."""
    by_name = {unit.name: unit for unit in pages}
    whole = shortened(InOnePiece(by_name[name], by_name).unit)
    by_name[name] = whole
    wanted = {name, *users}
    left = [by_name[one] for one in wanted]
    while left:
        for used in left.pop().uses - wanted:
            wanted.add(used)
            left.append(by_name[used])
    return [by_name[unit.name] for unit in pages if unit.name in wanted]


def retained(units: list[Unit]) -> set[str]:
    """Blocks and structures that are declared as retained somewhere, with their parts."""
    by_name = {unit.name: unit for unit in units}
    found: set[str] = set()
    left = [var.type for unit in units for var in unit.vars("VAR RETAIN")]
    while left:
        name = left.pop()
        if name in by_name and name not in found:
            found.add(name)
            left += [var.type for var in by_name[name].vars()]
    return found


PIECES = {
    "detector": ("the width of the gap next to any controller: 10 pages and the example", "GlappDetector", "GlappLoop"),
    "compensation": ("compensation by a width that is typed in: 4 pages", "GlappCompensation"),
}


def ac800m(units: list[Unit], build: str) -> Iterator[tuple[str, str]]:
    """A page for each unit, to be pasted table by table, in REAL only; what many want is there in few pages too."""
    if build != "REAL":
        return
    pages = without_arrays(units)
    links = []
    for folder, (meaning, name, *users) in PIECES.items():
        yield from pasted(folder, in_one_piece(pages, name, *users), meaning)
        links.append([f'<a href="{folder}/index.html">{folder}</a>', meaning])
    yield from pasted("all", pages, "every block, each on its page")
    links.append(['<a href="all/index.html">all</a>', f"every block, each on its page: {len(pages)} pages"])
    yield (
        "index.html",
        framed("glapp for AC 800M", f"<h1>glapp {version()} for AC 800M</h1>" + table(["", "what"], links)),
    )


def pasted(folder: str, pages: list[Unit], meaning: str) -> Iterator[tuple[str, str]]:
    """A folder of pages in the order in which to make them."""
    kept = retained(pages)
    names = {unit.name: unit for unit in pages}
    rows = []
    for number, unit in enumerate(pages, 1):
        name = f"{number:02}_{unit.name}.html"
        kind = {"TYPE": "data type", "PROGRAM": "program"}.get(unit.kind, "function block type")
        rows.append([str(number), f'<a href="{name}">{unit.name}</a>', kind, html.escape(unit.comment)])
        yield f"{folder}/{name}", page(unit, kind, unit.name in kept, names)
    body = f"<p><a href='../index.html'>back</a></p><h1>{html.escape(meaning)}</h1>"
    body += "<p>In this order: what is used comes before what uses it.</p>"
    yield f"{folder}/index.html", framed(meaning, body + table(["", "page", "make it as", "what it is"], rows))


def framed(title: str, body: str) -> str:
    """A page that needs nothing from outside."""
    style = (
        "body{font:14px/1.45 sans-serif;max-width:70em;margin:2em auto;padding:0 1em}"
        "table{border-collapse:collapse}td,th{border:1px solid #bbb;padding:2px 8px;text-align:left;vertical-align:top}"
        "th{background:#eee}pre{background:#f6f6f6;border:1px solid #bbb;padding:1em;overflow:auto}"
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{title}</title><style>{style}</style></head>\n"
        f"<body>\n{body}\n</body></html>\n"
    )


def table(head: list[str], rows: list[list[str]]) -> str:
    """A table that can be copied row by row."""
    cells = "".join(f"<th>{name}</th>" for name in head)
    lines = ["<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows]
    return f"<table>\n<tr>{cells}</tr>\n" + "\n".join(lines) + "\n</table>\n"


def page(unit: Unit, kind: str, keeps: bool, names: dict[str, Unit]) -> str:
    """One unit: its tables in the order of the editor's tabs, its code, and how it is wired."""

    def plain(var: Var) -> str:
        return var.type.lower() if var.type in ELEMENTARY else var.type

    def attributes(word: str) -> str:
        if word == "VAR CONSTANT":
            return "constant"
        return "retain" if keeps or word == "VAR RETAIN" else ""

    parts = [f"<p><a href='index.html'>all pages</a></p><h1>{unit.name}</h1><p>Make a {kind} of this name.</p>"]
    if unit.comment:
        parts.append(f"<p>{html.escape(unit.comment)}</p>")
    head = ["Name", "Data Type", "Attributes", "Initial Value", "Description"]
    if unit.kind == "TYPE":
        rows = [[var.name, plain(var), attributes(""), var.initial, html.escape(var.comment)] for var in unit.vars()]
        parts += ["<h2>Components</h2>", table(head, rows)]
        return framed(unit.name, "\n".join(parts))
    pins = [(word, var) for word, block in unit.blocks if word in ("VAR_INPUT", "VAR_OUTPUT") for var in block]
    ways = {"VAR_INPUT": "in", "VAR_OUTPUT": "out"}
    if pins and unit.kind != "PROGRAM":
        rows = [
            [var.name, plain(var), attributes(word), ways[word], var.initial, html.escape(var.comment)]
            for word, var in pins
        ]
        parts += ["<h2>Parameters</h2>", table([*head[:3], "Direction", *head[3:]], rows)]
    inner = [(word, var) for word, block in unit.blocks if word not in ways or unit.kind == "PROGRAM" for var in block]
    made = {name for name, other in names.items() if other.kind != "TYPE"}
    rows = [
        [var.name, plain(var), attributes(word), var.initial, html.escape(var.comment)]
        for word, var in inner
        if var.type not in made
    ]
    if rows:
        parts += ["<h2>Variables</h2>", table(head, rows)]
    rows = [[var.name, var.type, html.escape(var.comment)] for _, var in inner if var.type in made]
    if rows:
        parts += ["<h2>Function Blocks</h2>", table(["Name", "Function Block Type", "Description"], rows)]
    parts += ["<h2>Code</h2>", f"<pre>{html.escape(unit.body)}</pre>"]
    if pins and unit.kind != "PROGRAM":
        given = [var for word, var in pins if word == "VAR_INPUT"]
        short = unit.name.removeprefix("Glapp")
        call = f"{short}1({', '.join(f'{var.name} := {var.name}' for var in given)});"
        parts += [
            "<h2>Wiring</h2>",
            f"<p>An instance {short}1 in the tab Function Blocks, and in the code of the program, with variables of "
            "the same names; a pin that is left out keeps its initial value:</p>",
            f"<pre>{html.escape(call)}</pre>",
        ]
    return framed(unit.name, "\n".join(parts))


TARGETS = {
    "st": structured_text,
    "plcopen": plcopen,
    "twincat": twincat,
    "siemens": siemens,
    "ac800m": ac800m,
}


MAKERS = {
    "codesys": ("plcopen",),
    "twincat": ("plcopen", "twincat"),
    "tia-portal": ("siemens",),
    "ac800m": ("ac800m",),
    "openplc-beremiz": ("st",),
}


def tags(units: list[Unit]) -> str:
    """Tags of the example that a screen and a historian read and write: one line for each pin of GlappLoop."""
    loop = next(unit for unit in units if unit.name == "GlappLoop")
    rows = ["tag,type,access,begins with,meaning"]
    for word, access in (("VAR_INPUT", "write"), ("VAR_OUTPUT", "read")):
        for var in loop.vars(word):
            rows.append(f'GlappLoop.{var.name},{var.type},{access},{var.initial},"{var.comment}"')
    return "\n".join(rows) + "\n"


def pins(unit: Unit) -> str:
    """Inputs and outputs of a block as a table in Markdown."""
    rows = ["| pin | | type | begins with | |", "|---|---|---|---|---|"]
    for word, way in (("VAR_INPUT", "in"), ("VAR_OUTPUT", "out")):
        rows += [f"| {var.name} | {way} | {var.type} | {var.initial} | {var.comment} |" for var in unit.vars(word)]
    return "\n".join(rows)


# Settings that have another name here than in the core, or one in each block.
NAMED = {
    "low": "Low; of a compensation OpLow",
    "high": "High; of a compensation OpHigh",
    "limit": "MaxWidth, MaxSize",
    "period": "PushPeriod",
    "wait": "WaitTime",
    "delay": "DelayScans",
    "longest": "Longest, LongestDelay",
    "tf": "Tf, OpTf",
}


def members(unit: Unit) -> str:
    """Description of a structure, and its members as a table in Markdown."""
    rows = [unit.comment, "", "| member | type | begins with | |", "|---|---|---|---|"]
    rows += [f"| {var.name} | {var.type} | {var.initial} | {var.comment} |" for var in unit.vars()]
    return "\n".join(rows)


def errors() -> str:
    """Numbers of ErrorID as a table in Markdown, from the core's catalogue."""
    numbers = json.loads((HERE.parent / "vectors/catalogue.json").read_text(encoding="utf-8"))["parameters"]
    settings = {0: "all are within bounds"}
    for name, number in numbers.items():
        row = re.fullmatch(r"(\w+) of row (\d)", name)
        pin = {"at": "Level"}.get(row[1], row[1].title()) + f" of Row{row[2]}" if row else NAMED.get(name)
        settings[number] = pin or "".join(part.title() for part in name.split("_"))
    rows = [f"| {number} | {settings[number]} |" for number in sorted(settings)]
    return "\n".join(["| ErrorID | setting |", "|---|---|", *rows])


def reference() -> str:
    """`blocks.md` with the pins of each block and the members of each structure, as the sources declare them."""
    units = {unit.name: unit for unit in library("LREAL")}
    head, *sections = re.split(r"^(?=###? )", (HERE / "blocks.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    filled = []
    for section in sections:
        name = section.split("\n", 1)[0].lstrip("# ")
        for place, table_of in (("{pins}", pins), ("{members}", members)):
            if place in section:
                section = section.replace(place, table_of(units[name]))
        filled.append(section)
    return (head + "".join(filled)).replace("{errors}", errors())


# Pages of the documentation that each package has, and their names there.
PAGES = {"plc.md": "plc.md", "plc-blocks.md": "blocks.md", "compensation.md": "compensation.md"}


def offline(text: str) -> str:
    """A page with links to the pages of the package and to pictures; of other links the words alone."""

    def link(found: re.Match[str]) -> str:
        page = PAGES.get(found[2].split("#")[0])
        return f"[{found[1]}]({page})" if page else found[1]

    return re.sub(r"(?<!!)\[([^\]]+)\]\(([^)]+)\)", link, text)


def archive(path: Path, folders: list[Path], out: Path) -> None:
    """The files of some folders and what belongs to every package, the same bytes each time."""
    files = [file for folder in folders for file in sorted(folder.rglob("*")) if file.is_file()]
    files += [out / name for name in ("README.md", "LICENSE", *PAGES.values())]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for file in files:
            one = zipfile.ZipInfo(file.relative_to(out).as_posix(), (1980, 1, 1, 0, 0, 0))
            one.compress_type = zipfile.ZIP_DEFLATED
            one.external_attr = 0o644 << 16
            packed.writestr(one, file.read_bytes())


def main(out: Path) -> None:
    """Writes all packages again."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    shutil.copyfile(HERE / "packages" / "README.md", out / "README.md")
    shutil.copyfile(HERE.parent / "LICENSE", out / "LICENSE")
    for page, name in PAGES.items():
        source = HERE.parent / "docs" / page
        text = reference() if name == "blocks.md" else source.read_text(encoding="utf-8")
        (out / name).write_bytes(offline(text.replace("../plc/example/", "example/")).encode())
    libraries = {build: library(build) for build in BUILDS}
    for target, writer in TARGETS.items():
        for build, units in libraries.items():
            for name, text in writer(units, build):
                path = out / target / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(text.encode())
        shutil.copyfile(HERE / "packages" / f"{target}.md", out / target / "README.md")
    shutil.copytree(HERE / "example", out / "example")
    (out / "example" / "tags.csv").write_bytes(tags(libraries["LREAL"]).encode())
    for maker, targets in MAKERS.items():
        folders = [out / target for target in targets]
        archive(out / f"glapp-{version()}-{maker}.zip", [*folders, out / "example"], out)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "dist/plc"))
