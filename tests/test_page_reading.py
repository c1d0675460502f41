"""The page's reader of files, compared with the one of the package on the same files; it runs in node."""

import io
import json
import shutil
import subprocess
import zipfile
from datetime import UTC
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench import makers
from exports import FORMS, open_document, typed

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import open_recordings
from glapp.recording import Recording, joined
from page import build

ROOT = Path(__file__).parents[1]
PAPA = build.BUILT / "node_modules" / "papaparse" / "papaparse.min.js"
FORMATS = build.BUILT / "formats.js"
if shutil.which("node") is None or not FORMATS.is_file():
    pytest.skip("node and what the page has from npm are not there: make page", allow_module_level=True)


def rows(times: list[str], separator: str = ",", point: str = ".") -> list[str]:
    values = [(50 + 0.125 * (k % 7), 40.5 - 0.25 * (k % 5)) for k in range(len(times))]
    cells = ([t, "50", *(f"{v}".replace(".", point) for v in pair)] for t, pair in zip(times, values, strict=True))
    return [separator.join(row) for row in cells]


def archive(*names: str) -> bytes:
    """A zip archive of files with these names."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as file:
        for name in names:
            file.writestr(name, "t,SP,PV,OP\n")
    return packed.getvalue()


SECONDS = [str(k) for k in range(24)]
ISO = [f"2024-01-31 23:59:{k:02d}" for k in range(36, 60)] + ["2024-02-01 00:00:00"]
MODES = ["Auto", "Hand", ""]
READ: dict[str, str | bytes] = {
    "plain": "\n".join(["t,SP,PV,OP", *rows(SECONDS)]),
    "no end of line, and windows' own": "\r\n".join(["t,SP,PV,OP", *rows(SECONDS)]) + "\r\n",
    "decimal comma": "\n".join(["Zeit;Sollwert;Istwert;Stellgröße", *rows(SECONDS, ";", ",")]),
    "windows-1252": "\n".join(["Zeit;Sollwert;Istwert;Stellgröße", *rows(SECONDS, ";", ",")]).encode("cp1252"),
    "utf-16": "\n".join(["t\tSP\tPV\tOP", *rows(SECONDS, "\t")]).encode("utf-16"),
    "a mark of utf-8": "\n".join(["t,SP,PV,OP", *rows(SECONDS)]).encode("utf-8-sig"),
    "a quality beside each signal": "\n".join(
        [
            "t,F1.SP,Quality,F1.PV [bar],Quality,F1.OP,Quality",
            *(f"{k},50,Good,{49 + k % 3},{'Bad' if k == 5 else 'Good'},{40 + k % 4},Bad" for k in range(24)),
        ]
    ),
    "blocks of one loop": "\n".join(["t,FIC1/PIDA.SP,FIC1/DACA.PV,FIC1/PIDA.OP", *rows(SECONDS)]),
    "the mode of a module, and its valve": "\n".join(
        [
            "t,FIC1/PID1/SP.CV,FIC1/PID1/PV.CV,FIC1/PID1/OUT.CV,FIC1/MODE,FV1.POS",
            *(f"{r},AUTO,7" for r in rows(SECONDS)),
        ]
    ),
    "instruments of one loop": "\n".join(["t,10-FIC-1_SP,10-FT-1_PV,10-FCV-1_OUT", *rows(SECONDS)]),
    "a column of units beside tags of Ovation": "t,tag,value,units\n"
    + "".join(
        f"{k},F1{tag}.UNIT1@NET1,{k % 5},{unit}\n"
        for k in range(9)
        for tag, unit in (("SP", "bar"), ("PV", "bar"), ("OP", ""))
    ),
    "a loop recorded more seldom than another": "\n".join(
        [
            "Timestamp,F1.SP,F1.PV,F1.OP,MODE",
            *(r + ",AUTO" if k % 3 == 1 else f"{r[:19]},,,,AUTO" for k, r in enumerate(rows(ISO))),
        ]
    ),
    "ISO": "\n".join(["Timestamp,FIC101.SP,FIC101.PV,FIC101.OP", *rows(ISO)]),
    "ISO with fractions": "\n".join(["time,SP,PV,OP", *rows([f"2024-01-31T10:00:{k / 10:06.3f}" for k in range(24)])]),
    "ISO with zones": "\n".join(["time,SP,PV,OP", *rows([f"2024-01-31T10:00:{k:02d}+01:00" for k in range(24)])]),
    "day first by dots": "\n".join(["Datum;SP;PV;OP", *rows([f"01.02.2024 10:00:{k:02d}" for k in range(24)], ";")]),
    "day first by the data": "\n".join(["Date;SP;PV;OP", *rows([f"31/01/24 10:00:{k:02d}" for k in range(24)], ";")]),
    "month first, a.m. and p.m.": "\n".join(
        [
            "Date;SP;PV;OP",
            *rows(
                [f"1/31/2024 {11 + k // 12 or 12}:{5 * (k % 12):02d}:00 {'AM' if k < 12 else 'PM'}" for k in range(24)],
                ";",
            ),
        ]
    ),
    "a. m. and p. m., as in Spanish": "\n".join(
        [
            "Fecha;SP;PV;OP",
            *rows(
                [f"31/01/2024 {11 + k // 12 or 12}:{5 * (k % 12):02d}:00 {'ap'[k // 12]}. m." for k in range(24)],
                ";",
                ",",
            ),
        ]
    ),
    "a narrow space before PM": "\n".join(
        ["Date;SP;PV;OP", *rows([f"1/31/2024 10:00:{k:02d}\u202fPM" for k in range(24)], ";")]
    ),
    "names of months": "\n".join(["Date;SP;PV;OP", *rows([f"31-Jan-24 10:00:{k:02d}" for k in range(24)], ";")]),
    "epoch in ms": "\n".join(["ts,SP,PV,OP", *rows([str(1_700_000_000_000 + 500 * k) for k in range(24)])]),
    "epoch in s with fractions": "\n".join(
        ["ts,SP,PV,OP", *rows([f"{1_700_000_000.1 + 0.1 * k:.1f}" for k in range(24)])]
    ),
    "a spreadsheet's days": "\n".join(["Date,SP,PV,OP", *rows([f"{45_000 + k / 86_400:.9f}" for k in range(24)])]),
    "minutes by a unit": "\n".join(["time [min],SP,PV,OP", *rows([f"{k / 10}" for k in range(24)])]),
    "a title and a row of units": "\n".join(["Export of unit 3", "t,SP,PV [bar],OP", "s,bar,bar,%", *rows(SECONDS)]),
    "tags above signals that repeat": "\n".join(
        [",F1,F1,F1,T7", "t,SP,PV,OP,PV", "s,bar,bar,%,degC", *(f"{row},9" for row in rows(SECONDS))]
    ),
    "one tag above the signals": "\n".join(
        [",FIC101,,,", "t,SP,PV,OP,Remark", "s,bar,bar,%,", *(f"{row},a" for row in rows(SECONDS))]
    ),
    "a unit above the signals": "\n".join([",m3/h,m3/h,", "t,SP,PV,OP", *rows(SECONDS)]),
    "a title above the first column": "\n".join(["Export 3,,,", "t,SP,PV,OP", *rows(SECONDS)]),
    "a title above a name that repeats": "\n".join(
        ["Export of,unit 3,,,,", "t,SP,PV,OP,Remark,Remark", *(f"{row},a,b" for row in rows(SECONDS))]
    ),
    "the newest row first": "\n".join(["time,SP,PV,OP", *reversed(rows(ISO)), ",,,"]),
    "the newest row first, in seconds": "\n".join(["t,SP,PV,OP", *reversed(rows(SECONDS))]),
    "the newest row first, but for one": "\n".join(["t,SP,PV,OP", *reversed(rows(SECONDS)), "30,50,40,41"]),
    "tags, the newest row first": "\n".join(
        [
            "time,tag,value",
            *(f"{time},F1.{tag},{int(time[-1]) % 3}" for time in reversed(ISO) for tag in ("OP", "PV", "SP")),
        ]
    ),
    "SP and PV in units that are written in two ways": "\n".join(["t,SP [m³/h],PV [m3/h],OP", *rows(SECONDS)]),
    "bad values": "\n".join(
        ["t,SP,PV,OP", *rows(SECONDS[:20]), "20,50,Bad,40", "21,50,#N/A,40", "22,50,,40", "23,50,1e400,40"]
    ),
    "a mode": "\n".join(
        ["t,SP,PV,OP,MODE", *(f"{row},{'MAN' if k < 5 else 'AUTO'}" for k, row in enumerate(rows(SECONDS)))]
    ),
    "a mode that is called A/M": "\n".join(
        ["t,SP,PV,OP,A/M", *(f"{row},{'Handbetrieb' if k < 5 else 'A'}" for k, row in enumerate(rows(SECONDS)))]
    ),
    "qualities of OPC DA": "\n".join(
        ["t,SP,PV,OP,Quality", *(f"{row},{0 if k == 7 else 192}" for k, row in enumerate(rows(SECONDS)))]
    ),
    "qualities of OPC UA": "\n".join(
        ["t,SP,PV,OP,Quality", *(f"{row},{2**31 if k == 7 else 0}" for k, row in enumerate(rows(SECONDS)))]
    ),
    "qualities in words": "\n".join(
        ["t,SP,PV,OP,PV.Status", *(f"{row},{'Uncertain' if k == 7 else 'Good'}" for k, row in enumerate(rows(SECONDS)))]
    ),
    "values that say current": "\n".join(
        ["time|FIC101/PID1/SP.CV|FIC101/PID1/PV.CV|FIC101/PID1/OUT.CV", *rows(SECONDS, "|")]
    ),
    "outputs of a block": "\n".join(["t,SP_Out,PV_Out,CV_Out", *rows(SECONDS)]),
    "one value without its unit": "\n".join(
        ["t,SP,PV,OP", *(f"{k},50,{k % 3},{k % 4}{' %' * (k != 5)}" for k in range(24))]
    ),
    "Läge with numbers is the valve's position": "\n".join(
        ["Tid;Börvärde;Ärvärde;Utsignal;Läge", *(f"{r};{k % 5},5" for k, r in enumerate(rows(SECONDS, ";", ",")))]
    ),
    "Läge with words is the mode": "\n".join(
        [
            "Tid;Börvärde;Ärvärde;Utsignal;Läge;Ventilläge",
            *(f"{r};{MODES[k % 3]};7" for k, r in enumerate(rows(SECONDS, ";"))),
        ]
    ),
    "Läge with 0 and 1 is the mode": "\n".join(
        ["Tid,Börvärde,Ärvärde,Utsignal,Läge", *(f"{r},{k % 2}" for k, r in enumerate(rows(SECONDS)))]
    ),
    "a lake's names of columns": "event_time,signal_id,value_double\n"
    + "".join(f"{time},F1.{tag},{k % 5}\n" for k, time in enumerate(ISO) for tag in ("SP", "PV", "OP")),
    "Value beside vValue": "DateTime,TagName,Value,vValue,Quality\n"
    + "".join(f"{time},F1.{tag},{k % 5},'{k % 5}',Good\n" for k, time in enumerate(ISO) for tag in ("SP", "PV", "OP")),
    "a tag with modes": "Tid;tag;value\n"
    + "".join(
        f"{k};F1.{tag};{value}\n"
        for k in range(9)
        for tag, value in (("Börvärde", "50"), ("Ärvärde", f"{k % 3}"), ("Utsignal", "4,5"), ("Läge", MODES[k % 3]))
    ),
    "limits are no signals": "\n".join(["t,SP,PV,OP,PV_HI_LIM", *(f"{row},99" for row in rows(SECONDS))]),
    "names joined": "\n".join(["t,FIC101SP,FIC101PV,FIC101OP", *rows(SECONDS)]),
    "quoted cells": "\n".join(
        ['"t","SP","PV","OP"', *(",".join(f'"{c}"' for c in row.split(",")) for row in rows(SECONDS))]
    ),
    "an empty row at the end": "\n".join(["t,SP,PV,OP", *rows(SECONDS), ",,,", ""]),
    "no setpoint": "\n".join(["t,PV,OP", *(f"{k},{50 + k % 3},{40 + k % 4}" for k in range(24))]),
    "a position": "\n".join(["t,SP,PV,OP,Valve Position", *(f"{row},{k % 5}" for k, row in enumerate(rows(SECONDS)))]),
}
REFUSED: dict[str, str | bytes] = {
    "nothing": "",
    "SP in another unit than PV": "\n".join(["t,SP [bar],PV [kPa],OP", *rows(SECONDS)]),
    "a tag of SP in another unit than PV": "t,tag,value\n"
    + "".join(f"{k},F1.{tag},{k % 5}\n" for k in range(9) for tag in ("SP [bar]", "PV [kPa]")),
    "a column of units that differ": "t,tag,value,Einheit\n"
    + "".join(f"{k},F1.{tag},{k % 5},{unit}\n" for k in range(9) for tag, unit in (("SP", "bar"), ("PV", "kPa"))),
    "one column": "PV\n1\n2\n3\n",
    "signals of no loop": "\n".join(["t,A.SP,B.PV,C.OP", *rows(SECONDS)]),
    "two instruments that measure": "\n".join(["t,FIC1.SP,FT1.PV,FI1.PV", *rows(SECONDS)]),
    "a PDF": b"%PDF-1.4\n1 0 obj\n",
    "a picture": b"\xff\xd8\xff\xe0" + bytes(100),
    "a zip archive": archive("a.csv", "b.csv"),
    "an empty zip archive": archive(),
    "a Word document": archive("[Content_Types].xml", "word/document.xml"),
    "a login": "<html><title>Log\n in &amp; go</title><table><tr><td>User<td>?</table><input type='password'></html>",
    "a message": "\n Access  denied.\n",
    "a message in JSON": json.dumps({"Errors": None, "Message": "Authorization has been denied."}),
    "errors in JSON": json.dumps({"errors": [{"message": "no tag"}]}),
    "no header": "0,1,2,3\n1,1,2,3\n2,1,2,3\n",
    "a header alone": "t,SP,PV,OP\n",
    "a word": "\n".join(["t,SP,PV,OP", *rows(SECONDS[:20]), "20,50,full,40"]),
    "a ragged row": "\n".join(["t,SP,PV,OP", *rows(SECONDS[:20]), "20,50,40", "21,50,40,40"]),
    "a mode nobody knows": "\n".join(["t,SP,PV,OP,MODE", *(f"{row},FUZZY" for row in rows(SECONDS))]),
    "two that could be PV": "\n".join(["t,SP,PV,PV,OP", *(f"{k},1,2,3,4" for k in range(24))]),
    "one signal": "\n".join(["t,FIC101", *(f"{k},{k % 5}" for k in range(24))]),
    "one signal that is known": "\n".join(["t,FIC101.PV", *(f"{k},{k % 5}" for k in range(24))]),
    "SP and OP of a tag": "\n".join(["t,FIC101.SP,FIC101.OP", *(f"{k},50,{k % 5}" for k in range(24))]),
    "no PV": "\n".join(["t,SP,OP", *(f"{k},1,2" for k in range(24))]),
    "no time": "\n".join(["SP,PV,OP", *(f"{k},1,2" for k in range(24))]),
    "no such day": "\n".join(["Date;SP;PV;OP", *rows(["31.02.2024 10:00:00"] * 3, ";")]),
    "either order": "\n".join(["Date;SP;PV;OP", *rows([f"01/02/2024 10:00:{k:02d}" for k in range(24)], ";")]),
    "no number in PV": "\n".join(["t,SP,PV,OP", *(f"{k},1,Bad,2" for k in range(24))]),
    "two ways to write numbers": "\n".join(["t;SP;PV;OP", "0;1,5;2.5;3", "1;1,5;2.5;3"]),
    "one decimal point among commas": "\n".join(
        ["t;SP;PV;OP", *(f"{k};1,5;{k},5 bar;{k}{'.' if k == 12 else ','}5 %" for k in range(24))]
    ),
}
ANNOTATED = (
    "#datatype,string,long,dateTime:RFC3339,double,string,string\n,result,table,_time,_value,_field,_measurement\n"
)
POINTS = "".join(f"pid,loop=F1 pv={k}.5,sp=1,op=2 {1_763_100_000_000_000_000 + k * 10**8}\n" for k in range(9))
PAGE = "<html><body><table>{}</table></body></html>".format
CELLS = [f"<tr><td>{k}<td>1<td>{k % 3}.5<td>2" for k in range(9)]
HEADING = "<tr><th>t<th>SP<th>PV<th>OP"
RECORDS = [{"t": k, "SP": 1, "PV": k % 3, "OP": 2.5} for k in range(9)]
SERIES = {"name": "F1", "columns": ["time", "pv", "op"], "values": [[1, 2, 3]]}
NOT_JSON = "is not readable as JSON"
STRUCTURED: dict[str, str] = {
    "JSON with numbers that are none": json.dumps([{**one, "PV": float("nan")} for one in RECORDS[:2]] + RECORDS),
    "JSON with nanoseconds": json.dumps([{**one, "t": 1_763_100_000_000_000_001 + k} for k, one in enumerate(RECORDS)]),
    "JSON with a number that fills a float": json.dumps([{**one, "PV": one["PV"] + 1 / 3} for one in RECORDS]),
    "JSON, its lines apart": "\n".join(json.dumps(one) for one in RECORDS) + "\n\n",
    "JSON, packed in an answer": json.dumps({"result": {"rows": RECORDS}}, indent=1),
    "points of line protocol, a tenth of a second apart": POINTS,
    "annotated CSV with a line between its tables": "\n".join(
        ANNOTATED + "".join(f",,0,2025-11-14T06:00:{k:02d}Z,{k}.5,{field},F1\n" for k in range(9))
        for field in ("pv", "op")
    ),
    "a page with nothing closed": PAGE("\n".join([HEADING, *CELLS])),
    "a page with cells that span others": PAGE(
        f"<tr><th colspan=4>Trend &gt; 1 &#128;<br>of F1{HEADING}"
        + "".join(CELLS[:3])
        + "<tr><td>3<td rowspan='3'>1<td>7<td>2"
        "<tr><td>4<td>7<td>2<tr><td>5<td>8<td>2" + "".join(CELLS[6:])
    ),
    "a page with a table in a table": PAGE(f"<tr><td><table>{HEADING}{''.join(CELLS)}</table></td></tr>"),
    "a page with scripts, remarks and a quote": (
        '<!doctype html><!-- <table><tr> --><script>if (1 < 2) "<table>"</script><p title=5">'
        + PAGE(HEADING + "".join(CELLS))
    ),
    "a page with characters by number and by name": PAGE(
        "<tr><th>t<th>SP [&#128;]<th>PV [&#xb5;&deg;]<th>Stellgr&ouml&szlig;e [&bogus; &ampx]" + "".join(CELLS)
    ),
    "a page that is cut off": "<table>" + HEADING + "".join(CELLS) + "<tr><td>9<td>1<td>2.5<t",
    "TwinCAT, whose channels have rates of their own": "\n".join(
        ["Name\tPV\tName\tOP", "SampleTime[ms]\t100\tSampleTime[ms]\t200"]
        + [f"{100 * k}\t{k % 3}\t{200 * k if k < 8 else ''}\t{k % 5 if k < 8 else ''}" for k in range(16)]
    ),
}
DAMAGED: dict[str, str] = {
    "JSON that ends early": "[{",
    "JSON whose last record is cut off": json.dumps(RECORDS, indent=1)[:-60],
    "a line that is no JSON": json.dumps(RECORDS[0]) + "\n" + json.dumps(RECORDS[1])[:-4] + "\n",
    "JSON without a table": json.dumps({"answer": 42}),
    "JSON without rows": json.dumps({"columns": ["t", "SP", "PV", "OP"], "data": []}),
    "JSON with too many columns": json.dumps([{f"c{k}": k for k in range(20_000)}]),
    "series of different columns": json.dumps(
        {"results": [{"series": [SERIES, SERIES | {"columns": ["time", "pv", "sp"]}]}]}
    ),
    "a page without a table": "<html><body>none</body></html>",
    "a page with one column": PAGE("<tr><td>1<tr><td>2"),
    "a page with too wide a cell": PAGE("<tr><td colspan=20000>1<td>2"),
    "a page with too many rows": PAGE("<tr index=9000000><td>1<td>2"),
    "annotated CSV with a ragged row": ANNOTATED
    + ",,0,2025-11-14T06:00:00Z,1.5,pv,F1\n,,0,2025-11-14T06:00:01Z,1.5,pv\n",
    "annotated CSV without a row": ANNOTATED,
    "annotated CSV without times": "#datatype,string,double\n,result,pv\n,,1\n",
    "a line that is no point": POINTS + "pid,loop=F1 pv=\n",
    "JSON nested deeply": '{"data":' * 100_000 + "1" + "}" * 100_000,
    "units that differ": "\n".join(
        ["t,SP,PV,OP", *(f"{k},50 l/s,{k}{' m3/h' if k == 7 else ' l/s'},4%" for k in range(9))]
    ),
    "numbers of rows for times": "\n".join(["Nr,SP,PV,OP", *(f"{k},50,{k % 3},4" for k in range(9))]),
    "a tag whose values are all missing": "t,tag,value\n"
    + "".join(f"{k},F1.{s},\n" for k in range(9) for s in ("PV", "OP")),
    "tags without a signal": "t,tag,value\n" + "".join(f"{k},TI7,{k}\n" for k in range(9)),
}
UNUSED = ("plain", "ISO")
"""With a sample time beside their times."""
OPEN = {"a quote left open": 't,PV,OP,"a\nremark"\n0,1,2,ok\n1,1,2,"3" pipe\n2,1,2,"4"\n3,1,2,ok\n'}
"""The package reads the remark as it stands."""
MAKERS = {name: form.make() for name, form in makers.FORMS.items()}
ASKED = {name: export for name, export in MAKERS.items() if export.answer}
UNAIDED = [name for name in MAKERS if name not in ASKED]


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """Result of the page's reader for each text, and its place."""
    folder = tmp_path_factory.mktemp("page")
    (folder / "data.json").write_text(json.dumps(build.reader_data()), encoding="utf-8")
    scripts = json.dumps([str(path) for path in (PAPA, FORMATS, *(ROOT / "page" / f"{n}.js" for n in build.READER))])
    files: dict[str, Path] = {}
    answers: dict[str, dict[str, Any]] = {}
    for i, (name, text) in enumerate((READ | STRUCTURED | REFUSED | DAMAGED | OPEN).items()):
        files[name] = folder / f"{i}.csv"
        files[name].write_bytes(text if isinstance(text, bytes) else text.encode())
    files["OpenDocument"] = folder / "valve.ods"
    files["OpenDocument"].write_bytes(open_document("Trend", typed()))
    for name in UNUSED:
        files[f"{name}, with a sample time"] = files[name]
        answers[f"{name}, with a sample time"] = {"sample_time": 2}
    for name, (_, make) in FORMS.items():
        export = make()
        files[name] = folder / f"{name}{export.ending}"
        files[name].write_bytes(export.content)
    for name, made in MAKERS.items():
        files[name] = folder / f"{name}{made.ending}"
        files[name].write_bytes(made.content)
        if made.answer:
            files[f"{name}, answered"], answers[f"{name}, answered"] = files[name], made.answer
    asked = [(str(path), answers.get(name, {})) for name, path in files.items()]
    (folder / "asked.json").write_text(json.dumps(asked), encoding="utf-8")
    command = ["node", str(Path(__file__).parent / "page_reading.mjs"), scripts]
    command += [str(folder / "data.json"), str(folder / "asked.json")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    replies = [json.loads(line) for line in done.stdout.splitlines()]
    return {name: {"file": path, **one} for (name, path), one in zip(files.items(), replies, strict=True)}


@pytest.mark.slow
def test_a_fault_has_its_row(read: dict[str, dict[str, Any]]) -> None:
    assert read["a word"]["wrong"].startswith("row 22, column 'PV': 'full' is not a number")
    assert read["a ragged row"]["wrong"] == "row 22: has 3 cells where the header has 4: correct or delete the row"


@pytest.mark.slow
def test_what_follows_an_open_quote_is_not_lost_in_its_cell(read: dict[str, dict[str, Any]]) -> None:
    assert read["a quote left open"]["wrong"] == "row 4: has a quote that is not closed"


@pytest.mark.slow
def test_the_first_rows_are_shown_beside_the_choice_of_columns(read: dict[str, dict[str, Any]]) -> None:
    assert read["decimal comma"]["rows"] == [["0", "50", "50,0", "40,5"], ["1", "50", "50,125", "40,25"]]
    assert all(len(row) == len(one["rows"][0]) for one in read.values() if "rows" in one for row in one["rows"])


@pytest.mark.slow
def test_a_workbook_that_only_the_package_reads_is_called_that(read: dict[str, dict[str, Any]]) -> None:
    assert read["OpenDocument"]["wrong"] == "is an OpenDocument workbook: save it as .xlsx or CSV"


@pytest.mark.parametrize("name", [*READ, *STRUCTURED, *FORMS, *UNAIDED])
@pytest.mark.slow
def test_reads_the_same_numbers(read: dict[str, dict[str, Any]], name: str) -> None:
    found = read[name]
    settings = FORMS[name][1]().settings if name in FORMS else {}
    loops = [Loop(name="FIC101", **settings)] if settings else None
    compare(found, open_recordings(found["file"], loops))


@pytest.mark.parametrize("name", UNUSED)
@pytest.mark.slow
def test_says_the_same_of_a_sample_time_that_is_not_used(read: dict[str, dict[str, Any]], name: str) -> None:
    found = read[f"{name}, with a sample time"]
    compare(found, open_recordings(found["file"], defaults={"sample_time": 2}))
    assert [one["code"] for one in found["found"]] == ["setting_unused"]


@pytest.mark.parametrize("name", ASKED)
@pytest.mark.slow
def test_reads_the_same_numbers_after_the_same_answer(read: dict[str, dict[str, Any]], name: str) -> None:
    with pytest.raises(InputError) as answer:
        [one] = open_recordings(read[name]["file"])
        list(one.batches())
    assert answer.value.what in read[name]["wrong"]
    answered = read[f"{name}, answered"]
    compare(answered, open_recordings(answered["file"], defaults=ASKED[name].answer))


def compare(found: dict[str, Any], recordings: list[Recording]) -> None:
    """Compare the page's recording with the package's."""
    assert "wrong" not in found, found
    [recording] = recordings
    batch = joined(list(recording.batches()))
    for column in ("t", "sp", "pv", "op", "position", "flags"):
        ours, theirs = getattr(batch, column), found["columns"].get(column)
        assert (ours is None) == (theirs is None), column
        if ours is not None:
            np.testing.assert_array_equal(ours.astype(float), np.array(theirs, float), err_msg=column)
    labels = build.reader_data()["columns"]["labels"]
    assert {labels[role]: column for role, column in found["chosen"].items()} == recording.columns
    assert {labels[role]: unit for role, unit in found["units"].items()} == recording.units
    assert found["loop"] == recording.name
    findings = [(one["code"], one["severity"], one["evidence"]) for one in found["found"]]
    assert findings == [(one.code, one.severity, one.evidence) for one in recording.found]
    if recording.t0 is None:
        assert found["t0"] is None
    else:
        assert found["t0"] == pytest.approx(recording.t0.replace(tzinfo=recording.t0.tzinfo or UTC).timestamp() * 1000)


@pytest.mark.parametrize("name", REFUSED | DAMAGED)
@pytest.mark.slow
def test_refuses_the_same_files_in_the_same_words(read: dict[str, dict[str, Any]], name: str) -> None:
    with pytest.raises(InputError) as reply:
        [one] = open_recordings(read[name]["file"])
        list(one.batches())
    what, row = reply.value.what, reply.value.row
    if what.startswith(NOT_JSON):  # what is wrong with it is each parser's own to say
        what, row = NOT_JSON, None
    assert what in read[name]["wrong"]
    assert row is None or f"row {row}" in read[name]["wrong"]
