"""Exports of control systems and loggers: DeltaV, Experion, 800xA, WinCC, CENTUM, Ovation, Citect and others."""

from __future__ import annotations

from typing import Any

from .historians import workbook
from .record import (
    BAD,
    MANUAL,
    MODE,
    OP,
    PV,
    SP,
    TAG,
    Export,
    K,
    N,
    across,
    american,
    by_tag,
    column,
    form,
    lines,
    moments,
    number,
    stamps,
    text,
)


@form(
    "Emerson DeltaV",
    "DeltaV Books Online, DeltaV Reporter, DvCHInterpolated: columns Value;Timestamp;Parameter Status a tag",
)
def deltav_reporter() -> Export:
    rows: list[list[Any]] = [["", "", "", ""] * 3, ["Value", "Timestamp", "Parameter Status", ""] * 3]
    for i, name in enumerate(("PV", "SP", "OUT")):
        rows[0][4 * i] = f"{TAG}/PID1/{name}.CV"
    times = moments()
    for k in range(N):
        row: list[Any] = []
        for values in (PV, SP, OP):
            bad = values is PV and k in BAD
            row += [float(values[k]), times[k], "Bad" if bad else "Good", ""]
        rows.append(row)
    return workbook(("Report", rows), bad=BAD)


@form("Emerson DeltaV", "DeltaV Books Online, Process History View: copy the data of a chart")
def deltav_history_view() -> Export:
    head = ["Date/Time", f"{TAG}/PID1/PV.CV", f"{TAG}/PID1/SP.CV", f"{TAG}/PID1/OUT.CV", f"{TAG}/PID1/MODE.ACTUAL"]
    times = [time.replace(" AM", ".000 AM") for time in american()]
    rows = across(times, column(PV), column(SP), column(OP), MODE)
    return text(lines([head, *rows], "\t"), ending=".txt", manual=MANUAL)


@form(
    "Emerson Ovation",
    "Ovation Process Historian User Guide, Historical reviews: Point Name, Time, Value, Quality G F P B",
)
def ovation_review() -> Export:
    times = stamps("%m/%d/%Y %H:%M:%S.000")
    head = [["Ovation Process Historian", "", "", ""], ["Point review", "", "", ""]]
    rows = [["Point Name", "Date Time", "Value", "Quality"]]
    for name, k, time, value in by_tag(times):
        bad = name == "PV" and k in BAD
        rows.append([f"{TAG}_{name}.UNIT2@NET0", time, number(value), "B" if bad else "G"])
    return text(lines(head + rows), bad=BAD)


@form("Honeywell Experion", "Experion PKS Operator's Guide, Trend: copy to the clipboard; date and time in two columns")
def experion_trend() -> Export:
    head = [["Trend: 21-FIC-REFLUX", "", "", "", "", ""], ["Sample interval: 10 s", "", "", "", "", ""]]
    head += [["Date", "Time", f"{TAG}.PIDA.PV", f"{TAG}.PIDA.SP", f"{TAG}.PIDA.OP", f"{TAG}.PIDA.MODE"]]
    modes = ["CAS" if mode == "AUTO" else mode for mode in MODE]
    rows = across(stamps("%d-%b-%y"), stamps("%H:%M:%S.000"), column(PV), column(SP), column(OP), modes)
    return text(lines(head + rows, "\t"), ending=".txt", manual=MANUAL)


@form("ABB 800xA", "System 800xA Operations, Trend display: copy trend data; object:property,log as names")
def abb_trend() -> Export:
    head = ["Time", f"{TAG}:PV,Log-10s-1d", f"{TAG}:SP,Log-10s-1d", f"{TAG}:OUT,Log-10s-1d"]
    times = stamps("%d.%m.%Y %H:%M:%S,000")
    return text(lines([head, *across(times, column(PV, ","), column(SP, ","), column(OP, ","))], ";"))


@form(
    "Siemens WinCC",
    "WinCC Information System, OnlineTableControl: export; Time column and Value column of each, without tags",
)
def wincc_table_control() -> Export:
    times = stamps("%d.%m.%Y %H:%M:%S")
    head: list[str] = []
    for i in (1, 2, 3):
        head += [f"Time column {i}", f"Value column {i}"]
    rows = across(times, column(PV, ","), times, column(SP, ","), times, column(OP, ","))
    named = {"columns": {"pv": "Value column 1", "sp": "Value column 2", "op": "Value column 3"}}
    return text(lines([head, *rows], ";"), "utf-16", loop=None, answer=named)


@form(
    "Siemens WinCC",
    "WinCC Comfort/Advanced, Structure of the CSV file of a data log: VarName, TimeString, VarValue, Validity, Time_ms",
)
def wincc_data_log() -> Export:
    times = stamps("%d.%m.%Y %H:%M:%S")
    days = [number(1e6 * (m - moments()[0]).total_seconds() / 86400 + 45975.25e6, ",") for m in moments()]
    body = ['"VarName";"TimeString";"VarValue";"Validity";"Time_ms"']
    body.append(f'"$RT_ON$";"{times[0]}";0;2;{days[0]}')
    for k in range(N):
        for name, values in (("PV", PV), ("SP", SP), ("OP", OP)):
            valid = 0 if name == "PV" and k in BAD else 1
            body.append(f'"{TAG}_{name}";"{times[k]}";{number(values[k], ",")};{valid};{days[k]}')
    body.append(f'"$RT_COUNT$";{3 * N + 1};;;')
    return text("\r\n".join(body) + "\r\n", bad=BAD)


@form("Yokogawa DX2000", "DX1000/DX2000 User's Manual IM 04L42B01-01E, Appendix 3: YREC, Ch, Ch Id, Tag, Unit")
def yokogawa_dx() -> Export:
    head = [
        ["YREC"],
        ["Manual Sample Data", "Version 1.02.00"],
        ["Model", "DX2000"],
        ["Language Code", "shift-JIS"],
        ["File Status", "Complete"],
        ["Serial No.", "S5K100001"],
        ["File Header", "Reflux"],
        ["Ch", "001", "002", "003"],
        ["Ch Id", "1", "2", "3"],
        ["Tag", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"],
        ["Unit", "m3/h", "m3/h", "%"],
    ]
    rows = across(stamps("%Y/%m/%d %H:%M:%S"), column(PV), column(SP), column(OP))
    return text(lines(head + rows, "\t"), ending=".txt")


@form(
    "Yokogawa CENTUM VP",
    "CENTUM VP Operation, Trend: save to CSV; tag, comment and unit above, date and time in two columns",
)
def centum_trend() -> Export:
    head = [
        ["Trend Data", "", "", "", ""],
        ["", "", f"{TAG}.PV", f"{TAG}.SV", f"{TAG}.MV"],
        ["", "", "REFLUX", "REFLUX", "REFLUX"],
        ["Date", "Time", "M3/H", "M3/H", "%"],
    ]
    return text(lines(head + across(stamps("%Y/%m/%d"), stamps("%H:%M:%S"), column(PV), column(SP), column(OP))))


@form(
    "AVEVA Plant SCADA (Citect)",
    "Process Analyst, Exporting Pen Data: Time, Milliseconds, then pane-pen; NA where nothing was",
)
def citect_process_analyst() -> Export:
    head = ["Time", "Milliseconds", f"Pane1-{TAG}_PV", f"Pane1-{TAG}_SP", f"Pane1-{TAG}_OP"]
    times = stamps("%d/%m/%Y %H:%M:%S", step=2.5)
    parts = [str(moment.microsecond // 1000) for moment in moments(2.5)]
    rows = across(times, parts, column(PV, bad={11: "NA", 12: "NA"}), column(SP), column(OP))
    return text(lines([head, *rows], "\t"), ending=".txt", t=2.5 * K, bad=BAD)


@form(
    "Panasonic FPWIN GR7",
    "FPWIN GR7 online help, Data recording: column title, data name, comment, method, type and unit above",
)
def panasonic_recording() -> Export:
    head = [
        ["Date", "Time", "1", "2", "3"],
        ["", "", f"{TAG}_PV", f"{TAG}_SP", f"{TAG}_OP"],
        ["", "", "reflux", "reflux", "reflux"],
        ["", "", "MOMENT", "MOMENT", "MOMENT"],
        ["", "", "REAL", "REAL", "REAL"],
        ["", "", "m3/h", "m3/h", "%"],
    ]
    return text(lines(head + across(stamps("%Y-%m-%d"), stamps("%H:%M:%S"), column(PV), column(SP), column(OP))))


@form("IDEC SmartAXIS", "SmartAXIS Touch User's Manual, 4.3 Saving Data as a CSV File: facts, empty lines, label row")
def idec_data_log() -> Export:
    head = [
        ["Project Name", "Reflux", "Version 1.2.0"],
        ["File Type", "Data Log"],
        [],
        ["Channel No.", "1"],
        ["Source", "External device"],
        ["Sampling Method", "Cyclic"],
        ["Sampling condition", "10 s"],
        [],
        ["Sampling time", f"{TAG}_PV", f"{TAG}_SP", f"{TAG}_OP"],
    ]
    rows = across(stamps("%m/%d/%Y %H:%M:%S"), column(PV), column(SP), column(OP))
    return text(lines(head + rows))


@form(
    "Rockwell FactoryTalk View",
    "FactoryTalk View SE User's Guide, ODBC data logs: DateAndTime, Millitm, TagName, Val, Status, Marker",
)
def factorytalk_log() -> Export:
    times = stamps("%m/%d/%Y %H:%M:%S", step=2.5)
    parts = [str(moment.microsecond // 1000) for moment in moments(2.5)]
    rows = [["DateAndTime", "Millitm", "TagName", "Val", "Status", "Marker"]]
    for k in range(N):
        for name, values in (("PV", PV), ("SP", SP), ("OP", OP)):
            bad = name == "PV" and k in BAD
            rows.append(
                [times[k], parts[k], f"{TAG}\\{name}", number(values[k]), "E" if bad else "", "B" if k == 0 else ""]
            )
    return text(lines(rows), t=2.5 * K, bad=BAD)


@form(
    "Beckhoff TwinCAT 3 Scope",
    "TE13xx Scope View, Export to csv: facts of each channel above, a time column each in ms",
)
def twincat_scope() -> Export:
    names = [f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"]

    def twice(first: str, of: list[str]) -> list[str]:
        """Cells of a line with a name before each value, for time and signal."""
        return [cell for each in of for cell in (first, each)]

    head = [
        ["Name", "YT Scope Project"],
        ["File", "C:\\Scope\\reflux.csv"],
        ["Starttime of export", "134076024000000000", "Friday, November 14, 2025", "06:00:00.000"],
        ["Endtime of export", "134076028700000000", "Friday, November 14, 2025", "06:07:50.000"],
        [],
        twice("Name", names),
        twice("SymbolComment", ["", "", ""]),
        twice("Data-Type", ["REAL64"] * 3),
        twice("SampleTime[ms]", ["10000"] * 3),
        twice("VariableSize", ["8"] * 3),
        twice("SymbolBased", ["True"] * 3),
        twice("Offset", ["0"] * 3),
        twice("ScaleFactor", ["1"] * 3),
        twice("Unit", ["m3/h", "m3/h", "%"]),
        twice("Unit scale factor", ["1"] * 3),
        [],
    ]
    ms = [str(int(10000 * k)) for k in K]
    rows = across(ms, column(PV), ms, column(SP), ms, column(OP))
    return text(lines(head + rows + [["EOF"]], "\t"), t0=None)
