"""Exports of historians: PI, PHD, IP.21, AVEVA Historian, Canary, Seeq, GE, Exaquantum, Kepware."""

from __future__ import annotations

import io
from typing import Any

import openpyxl

from .record import (
    BAD,
    MODE,
    OP,
    PV,
    SP,
    TAG,
    Export,
    N,
    across,
    american,
    as_json,
    by_tag,
    column,
    epoch,
    form,
    lines,
    moments,
    number,
    serials,
    stamps,
    text,
)

PI_TIMES = "%d-%b-%y %H:%M:%S"


def workbook(*sheets: tuple[str, list[list[Any]]], **expected: Any) -> Export:
    """An Excel workbook."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets:
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    out = io.BytesIO()
    book.save(out)
    return Export(".xlsx", out.getvalue(), **expected)


@form("AVEVA PI DataLink", "PI DataLink User Guide, Sampled Data: one function a tag, an empty column between")
def pi_datalink_tag_above() -> Export:
    times = stamps(PI_TIMES)
    rows = [[f"{TAG}.PV", "", "", f"{TAG}.SP", "", "", f"{TAG}.OP", ""]]
    rows += [["Time", "Value", "", "Time", "Value", "", "Time", "Value"]]
    for k in range(N):
        rows.append([times[k], number(PV[k]), "", times[k], number(SP[k]), "", times[k], number(OP[k])])
    return text(lines(rows))


@form(
    "AVEVA PI DataLink",
    "PI DataLink User Guide, Sampled Data of several items with their attributes above; System digital states",
)
def pi_datalink_attributes() -> Export:
    bad = {11: "[-11059] No Good Data For Calculation", 12: "I/O Timeout"}
    head = [
        ["Server", "PISRV01", "", ""],
        ["Start time", "14-Nov-25 06:00:00", "", ""],
        ["End time", "14-Nov-25 06:07:50", "", ""],
        ["Interval", "10s", "", ""],
        ["", "", "", ""],
        ["Data item", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"],
        ["descriptor", "Reflux flow", "Reflux flow setpoint", "Reflux flow output"],
        ["engunits", "m3/h", "m3/h", "%"],
    ]
    return text(lines(head + across(stamps(PI_TIMES), column(PV, bad=bad), column(SP), column(OP))), bad=BAD)


@form("AVEVA PI Vision", "PI Vision, Export data to a file: Data Source, Time, Value, Units")
def pi_vision() -> Export:
    units = {"PV": "m3/h", "SP": "m3/h", "OP": "%"}
    times = american()
    rows = [["Data Source", "Time", "Value", "Units"]]
    for name, k, _, value in by_tag(times):
        rows.append([f"\\\\PISRV01\\{TAG}.{name}", times[k], number(value), units[name]])
    return text(lines(rows))


@form("AVEVA PI Web API", "PI Web API Reference, StreamSet GetRecorded: Items of Items with Timestamp, Value, Good")
def pi_web_api() -> Export:
    units = {"PV": "m3/h", "SP": "m3/h", "OP": "%"}
    times = stamps("%Y-%m-%dT%H:%M:%SZ")
    streams = []
    for name, values in (("PV", PV), ("SP", SP), ("OP", OP)):
        items = []
        for k in range(N):
            bad = name == "PV" and k in BAD
            value = {"Name": "Bad Input", "Value": 255, "IsSystem": True} if bad else float(values[k])
            items.append(
                {
                    "Timestamp": times[k],
                    "Value": value,
                    "UnitsAbbreviation": units[name],
                    "Good": not bad,
                    "Questionable": False,
                    "Substituted": False,
                    "Annotated": False,
                }
            )
        streams.append(
            {
                "WebId": f"F1DP{name}",
                "Name": f"{TAG}.{name}",
                "Path": f"\\\\PISRV01\\{TAG}.{name}",
                "Links": {"Source": f"https://pisrv01/piwebapi/points/F1DP{name}"},
                "Items": items,
                "UnitsAbbreviation": units[name],
            }
        )
    return as_json({"Links": {}, "Items": streams}, bad=BAD)


@form("AVEVA PI Server", "PI Server Reference, piconfig: @table piarc, @ostr tag,time,value; no line of names")
def pi_piconfig() -> Export:
    times = stamps("%d-%b-%Y %H:%M:%S")
    return text("".join(f"{TAG}.{name},{time},{value:.2f}\n" for name, _, time, value in by_tag(times)), ending=".txt")


@form(
    "Honeywell Uniformance PHD",
    "Process History Database User Guide, Excel add-in: tag, description and units above the values",
)
def phd_excel() -> Export:
    head = [
        ["Uniformance PHD Data", "", "", ""],
        ["Start Time", "11/14/2025 06:00:00", "End Time", "11/14/2025 06:07:50"],
        ["Tagname", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"],
        ["Description", "REFLUX TO C-21", "REFLUX TO C-21", "REFLUX TO C-21"],
        ["Units", "M3/H", "M3/H", "%"],
    ]
    return text(lines(head + across(stamps("%m/%d/%Y %H:%M:%S"), column(PV), column(SP), column(OP))))


@form(
    "Honeywell Uniformance PHD",
    "Process History Database User Guide, get data: Value and Confidence (0 to 100) of each tag",
)
def phd_confidence() -> Export:
    head = ["Timestamp"]
    for name in ("PV", "SP", "OP"):
        head += [f"{TAG}.{name} Value", f"{TAG}.{name} Confidence"]
    sure = ["0" if k in BAD else "100" for k in range(N)]
    rows = across(stamps("%m/%d/%Y %H:%M:%S"), column(PV), sure, column(SP), ["100"] * N, column(OP), ["100"] * N)
    return text(lines([head, *rows]), bad=BAD)


@form("AspenTech IP.21", "IP.21 SQLplus: NAME, IP_TREND_VALUE, IP_TREND_TIME, IP_TREND_QLEVEL of IP_AnalogDef")
def ip21_sqlplus() -> Export:
    times = [time.upper() + ".0" for time in stamps("%d-%b-%y %H:%M:%S")]
    rows = [["NAME", "IP_TREND_VALUE", "IP_TREND_TIME", "IP_TREND_QLEVEL"]]
    for name, k, time, value in by_tag(times):
        bad = name == "PV" and k in BAD
        rows.append([f"{TAG}.{name}", number(value), time, "Bad" if bad else "Good"])
    return text(lines(rows), bad=BAD)


@form(
    "AspenTech Process Data Add-in",
    "Process Data Add-in, Trend/Aggregate Data: names above, times as unformatted numbers of days",
)
def aspen_excel_addin() -> Export:
    rows: list[list[Any]] = [
        ["Name", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"],
        ["Description", "Reflux flow", "Reflux flow", "Reflux flow"],
        ["Eng Units", "m3/h", "m3/h", "%"],
    ]
    rows += across(serials(), PV.tolist(), SP.tolist(), OP.tolist())
    return workbook(("Sheet1", rows))


@form(
    "AVEVA Historian",
    "AVEVA Historian Retrieval Guide, History table: DateTime, TagName, Value, vValue, Quality, OPCQuality and others",
)
def aveva_history_table() -> Export:
    times = stamps("%Y-%m-%d %H:%M:%S.0000000")
    rows = [["DateTime", "TagName", "Value", "vValue", "Quality", "QualityDetail", "OPCQuality"]]
    for k in range(N):
        for name, values in (("PV", PV), ("SP", SP), ("OP", OP)):
            bad = name == "PV" and k in BAD
            quality = ["1", "249", "0"] if bad else ["0", "192", "192"]
            value = "NULL" if bad else number(values[k])
            rows.append([times[k], f"{TAG}.{name}", value, value, *quality])
    return text(lines(rows), bad=BAD)


@form("AVEVA Historian Client", "AVEVA Historian Client User Guide, Trend: save data to a file, tab separated")
def aveva_client_trend() -> Export:
    head = ["Date/Time", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"]
    return text(lines([head, *across(american(), column(PV), column(SP), column(OP))], "\t"), "utf-16", ".txt")


@form("AVEVA Historian REST", "AVEVA Historian, REST API, ProcessValues: FQN, DateTime, OpcQuality, Value, Text")
def aveva_rest() -> Export:
    times = stamps("%Y-%m-%dT%H:%M:%SZ")
    value = []
    for name, k, _, x in by_tag(times):
        bad = name == "PV" and k in BAD
        quality = 0 if bad else 192
        value.append(
            {"FQN": f"Site.{TAG}.{name}", "DateTime": times[k], "OpcQuality": quality, "Value": x, "Text": None}
        )
    return as_json({"odata.metadata": "https://online/apis/$metadata#ProcessValues", "value": value}, bad=BAD)


@form("Canary Axiom", "Canary documentation, Axiom: export of a trend, Value and Quality of each tag")
def canary_axiom() -> Export:
    head = ["Timestamp"]
    for name in ("PV", "SP", "OP"):
        head += [f"ROOT.Unit2.{TAG}.{name} Value", f"ROOT.Unit2.{TAG}.{name} Quality"]
    good = ["Bad - No Data" if k in BAD else "Good" for k in range(N)]
    rows = across(
        american(), column(PV, bad={11: "", 12: ""}), good, column(SP), ["Good"] * N, column(OP), ["Good"] * N
    )
    return text(lines([head, *rows]), bad=BAD)


@form("Canary", "Canary Read API, getTagData2: data of each tag with t, v and q")
def canary_read_api() -> Export:
    times = stamps("%Y-%m-%dT%H:%M:%S.0000000Z")
    data = {
        f"ROOT.Unit2.{TAG}.{name}": [
            {"t": times[k], "v": float(values[k]), "q": 0 if name == "PV" and k in BAD else 192} for k in range(N)
        ]
        for name, values in (("PV", PV), ("SP", SP), ("OP", OP))
    }
    return as_json({"statusCode": "Good", "errors": [], "data": data, "continuation": None}, bad=BAD)


@form("Seeq", "Seeq Knowledge Base, Export to Excel and CSV: Date-Time and a column a signal with its unit")
def seeq_csv() -> Export:
    head = ["Date-Time", f"{TAG}.PV (m³/h)", f"{TAG}.SP (m³/h)", f"{TAG}.OP (%)"]
    return text(lines([head, *across(stamps("%Y-%m-%dT%H:%M:%S+00:00"), column(PV), column(SP), column(OP))]))


@form("Seeq", "Seeq Knowledge Base, Export to Excel: an Information sheet, then a sheet of samples")
def seeq_workbook() -> Export:
    about: list[list[Any]] = [
        ["Worksheet", "Reflux"],
        ["Time range start", "2025-11-14T06:00:00Z"],
        ["Time range end", "2025-11-14T06:07:50Z"],
        ["Exported by", "engineer"],
    ]
    rows: list[list[Any]] = [["Date-Time", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"], ["", "m³/h", "m³/h", "%"]]
    rows += across(moments(), PV.tolist(), SP.tolist(), OP.tolist())
    return workbook(("Information", about), ("Samples", rows))


@form(
    "GE Proficy Historian",
    "Proficy Historian, CSV File Format: [Data], then Tagname,TimeStamp,Value,DataQuality; * begins a comment",
)
def ge_historian() -> Export:
    times = stamps("%m/%d/%Y %H:%M:%S")
    body = []
    for name, k, time, value in by_tag(times):
        bad = name == "PV" and k in BAD
        body.append([f"TIGER.{TAG}_{name}.F_CV", time, number(value), "Bad" if bad else "Good"])
    head = "* Export of the last shift\r\n[Data]\r\n"
    return text(head + lines([["Tagname", "TimeStamp", "Value", "DataQuality"], *body]), bad=BAD)


@form(
    "Yokogawa Exaquantum",
    "Exaquantum Explorer User's Manual, Excel add-in: item path above Timestamp, Value and Quality",
)
def exaquantum() -> Export:
    times = stamps("%d/%m/%Y %H:%M:%S")
    rows: list[list[str]] = [["", "", ""] * 3, ["Timestamp", "Value", "Quality"] * 3]
    for i, name in enumerate(("PV", "SP", "OP")):
        rows[0][3 * i] = f"Root.Plant.Unit2.{TAG}.{name}.Value"
    for k in range(N):
        good = "Bad" if k in BAD else "Good"
        rows.append([times[k], number(PV[k]), good, times[k], number(SP[k]), "Good", times[k], number(OP[k]), "Good"])
    return text(lines(rows), bad=BAD)


@form("Kepware DataLogger", "DataLogger Help, Narrow Table Format: _NAME, _NUMERICID, _VALUE, _TIMESTAMP, _QUALITY")
def kepware_narrow() -> Export:
    times = stamps("%Y-%m-%d %H:%M:%S.000")
    rows = [["_NAME", "_NUMERICID", "_VALUE", "_TIMESTAMP", "_QUALITY"]]
    for name, k, time, value in by_tag(times):
        bad = name == "PV" and k in BAD
        rows.append([f"Channel1.Device1.{TAG}.{name}", "0", number(value), time, "0" if bad else "192"])
    return text(lines(rows), bad=BAD)


@form(
    "Kepware DataLogger",
    "DataLogger Help, Wide Table Format: NAME_NUMERICID, NAME_VALUE, NAME_TIMESTAMP, NAME_QUALITY of each item",
)
def kepware_wide() -> Export:
    times = stamps("%Y-%m-%d %H:%M:%S.000")
    head: list[str] = []
    for name in ("PV", "SP", "OP"):
        head += [f"{TAG}_{name}_{part}" for part in ("NUMERICID", "VALUE", "TIMESTAMP", "QUALITY")]
    rows = []
    for k in range(N):
        row: list[str] = []
        for name, values in (("PV", PV), ("SP", SP), ("OP", OP)):
            row += ["0", number(values[k]), times[k], "0" if name == "PV" and k in BAD else "192"]
        rows.append(row)
    return text(lines([head, *rows]), bad=BAD)


@form("Inductive Automation Ignition", "Ignition User Manual, system.dataset.toCSV: #NAMES, #TYPES, #ROWS")
def ignition_dataset() -> Export:
    head = f'"#NAMES"\n"t_stamp","{TAG}/PV","{TAG}/SP","{TAG}/OP"\n"#TYPES"\n"date","D","D","D"\n"#ROWS","{N}"\n'
    body = across(stamps("%Y-%m-%d %H:%M:%S"), column(PV), column(SP), column(OP))
    return text(head + "".join(",".join(f'"{cell}"' for cell in row) + "\n" for row in body))


@form(
    "Inductive Automation Ignition",
    "Ignition User Manual, Power Table: export to CSV with the date as the locale has it",
)
def ignition_table() -> Export:
    times = []
    for m in moments():
        times.append(f"{m:%b} {m.day}, {m.year} {m.hour % 12 or 12}:{m:%M:%S} {'AM' if m.hour < 12 else 'PM'}")
    head = ["t_stamp", f"{TAG}/PV", f"{TAG}/SP", f"{TAG}/OP", f"{TAG}/Mode"]
    rows = across(times, column(PV), column(SP), column(OP), MODE)
    return text(lines([head, *rows]), manual=(30, 31, 32, 33))


@form(
    "Inductive Automation Ignition", "Ignition User Manual, Tag History binding, Tall: path, value, quality, timestamp"
)
def ignition_tall() -> Export:
    times = epoch(1000)
    rows: list[list[Any]] = [["path", "value", "quality", "timestamp"]]
    for name, k, _, value in by_tag([""] * N):
        bad = name == "PV" and k in BAD
        rows.append([f"[default]Unit2/{TAG}/{name}", number(value), "512" if bad else "192", times[k]])
    return text(lines(rows), bad=BAD)
