"""Exports of data bases, dashboards and scripts, and tables that people wrote themselves."""

from __future__ import annotations

import json

from .record import (
    BAD,
    MANUAL,
    MODE,
    OP,
    PV,
    SP,
    T0,
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
    number,
    stamps,
    text,
)

RFC = "%Y-%m-%dT%H:%M:%SZ"
INFLUX = "InfluxDB documentation, Annotated CSV"


@form("InfluxDB 2", f"{INFLUX}: #group, #datatype, #default; one table a series, _value, _field, _measurement")
def influx_annotated() -> Export:
    head = (
        "#group,false,false,true,true,false,false,true,true\r\n"
        "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,string\r\n"
        "#default,_result,,,,,,,\r\n"
        ",result,table,_start,_stop,_time,_value,_field,_measurement\r\n"
    )
    start, stop, times = "2025-11-14T06:00:00Z", "2025-11-14T07:00:00Z", stamps(RFC)
    body = []
    for table, (name, values) in enumerate((("op", OP), ("pv", PV), ("sp", SP))):
        body += [["", "", table, start, stop, times[k], number(values[k]), name, TAG] for k in range(N)]
    return text(head + lines(body))


@form("InfluxDB 2", f"{INFLUX}: tables of different schema, an empty line and their own annotations before each")
def influx_schemas() -> Export:
    start, stop, times = "2025-11-14T06:00:00Z", "2025-11-14T07:00:00Z", stamps(RFC)
    parts = []
    cells = {"op": column(OP), "pv": column(PV), "sp": column(SP), "mode": MODE}
    for table, (name, values) in enumerate(cells.items()):
        kind = "string" if name == "mode" else "double"
        head = (
            "#group,false,false,true,true,false,false,true,true\r\n"
            f"#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,{kind},string,string\r\n"
            "#default,_result,,,,,,,\r\n"
            ",result,table,_start,_stop,_time,_value,_field,_measurement\r\n"
        )
        parts.append(head + lines([["", "", table, start, stop, times[k], values[k], name, TAG] for k in range(N)]))
    return text("\r\n".join(parts), manual=MANUAL)


@form("InfluxDB 2", "Flux documentation, pivot(): a column a field; annotations above")
def influx_pivoted() -> Export:
    head = (
        "#group,false,false,true,true,false,true,false,false,false\r\n"
        "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,string,double,double,double\r\n"
        "#default,_result,,,,,,,,\r\n"
        ",result,table,_start,_stop,_time,_measurement,op,pv,sp\r\n"
    )
    start, stop, times = "2025-11-14T06:00:00Z", "2025-11-14T07:00:00Z", stamps(RFC)
    rows = across(
        [""] * N, [""] * N, ["0"] * N, [start] * N, [stop] * N, times, [TAG] * N, column(OP), column(PV), column(SP)
    )
    return text(head + lines(rows))


@form("InfluxDB 1", "InfluxDB 1 documentation, influx -format csv: name, time in ns, fields")
def influx_cli() -> Export:
    rows = across([TAG] * N, epoch(10**9), column(OP), column(PV), column(SP))
    return text(lines([["name", "time", "op", "pv", "sp"], *rows], end="\n"))


@form("InfluxDB 1", "InfluxDB 1 documentation, Querying data with the HTTP API: results, series, columns, values")
def influx_http() -> Export:
    values = across(stamps(RFC), OP.tolist(), PV.tolist(), SP.tolist())
    series = {"name": TAG, "columns": ["time", "op", "pv", "sp"], "values": values}
    return as_json({"results": [{"statement_id": 0, "series": [series]}]})


@form(
    "InfluxDB", "InfluxDB documentation, Line protocol: measurement,tags fields time; influx_inspect export writes it"
)
def influx_line_protocol() -> Export:
    head = "# DML\n# CONTEXT-DATABASE: plant\n"
    rows = zip(epoch(10**9), PV, SP, OP, MODE, strict=True)
    body = [f'pid,loop={TAG} pv={pv:.2f},sp={sp:.2f},op={op:.2f},mode="{mode}" {t}' for t, pv, sp, op, mode in rows]
    return text(head + "\n".join(body) + "\n", ending=".txt", manual=MANUAL)


@form(
    "TimescaleDB", "PostgreSQL documentation, psql --csv: timestamptz as 2025-11-14 06:00:00+00, a row a tag and time"
)
def timescale_csv() -> Export:
    times = stamps("%Y-%m-%d %H:%M:%S+00")
    rows = [["time", "tag", "value"]]
    rows += [[time, f"{TAG}.{name}", number(value)] for name, _, time, value in by_tag(times)]
    return text(lines(rows, end="\n"))


@form("TimescaleDB", "PostgreSQL documentation, psql, aligned output: bars between, a line below the names, (48 rows)")
def timescale_aligned() -> Export:
    body = [f" {'time':^22} | {'pv':^6} | {'sp':^6} | {'op':^6} ", f"{'-' * 24}+{'-' * 8}+{'-' * 8}+{'-' * 8}"]
    for time, pv, sp, op in zip(stamps("%Y-%m-%d %H:%M:%S+00"), PV, SP, OP, strict=True):
        body.append(f" {time} | {pv:6.2f} | {sp:6.2f} | {op:6.2f}")
    return text("\n".join([*body, f"({N} rows)", ""]), ending=".txt", loop=None)


@form(
    "Grafana", "Grafana documentation, Panel inspector: Download for Excel (sep=,), series joined by time, epoch in ms"
)
def grafana_raw() -> Export:
    head = ["Time", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"]
    rows = across(epoch(1000), column(PV), column(SP), column(OP))
    return text("sep=,\r\n" + lines([head, *rows]), "utf-8-sig")


@form("Grafana", "Grafana documentation, Panel inspector: Formatted data, values with their unit in each cell")
def grafana_formatted() -> Export:
    def quoted(cells: list[str]) -> str:
        return ",".join(f'"{cell}"' for cell in cells)

    rows = across(
        stamps(), [f"{x} m³/h" for x in column(PV)], [f"{x} m³/h" for x in column(SP)], [f"{x}%" for x in column(OP)]
    )
    head = ["Time", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"]
    return text("\n".join(map(quoted, [head, *rows])) + "\n")


@form("JSON records", "pandas documentation, DataFrame.to_json(orient='records'), date_format='iso'")
def json_records() -> Export:
    names = ["timestamp", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"]
    rows = across(stamps("%Y-%m-%dT%H:%M:%S.000Z"), PV.tolist(), SP.tolist(), OP.tolist())
    records = [dict(zip(names, row, strict=True)) for row in rows]
    for k in BAD:
        records[k][f"{TAG}.PV"] = None
    return as_json(records, bad=BAD)


@form("JSON lines", "jsonlines.org: one object a line; Node-RED, Kafka and Fluent Bit write it")
def json_lines() -> Export:
    rows = zip(stamps("%Y-%m-%dT%H:%M:%S+00:00"), PV, SP, OP, MODE, strict=True)
    body = [
        json.dumps({"time": t, "pv": float(pv), "sp": float(sp), "op": float(op), "mode": m})
        for t, pv, sp, op, m in rows
    ]
    return text("\n".join(body) + "\n", ending=".jsonl", loop=None, manual=MANUAL)


@form("JSON columns", "pandas documentation, DataFrame.to_json(): a column a key, its rows by the index in ms")
def json_columns() -> Export:
    keys = [str(t) for t in epoch(1000)]
    columns = {
        f"{TAG}.{name}": dict(zip(keys, values.tolist(), strict=True))
        for name, values in (("PV", PV), ("SP", SP), ("OP", OP))
    }
    return as_json(columns)


@form("JSON split", "pandas documentation, DataFrame.to_json(orient='split'): columns, index, data")
def json_split() -> Export:
    data = across(PV.tolist(), SP.tolist(), OP.tolist())
    return as_json({"columns": [f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"], "index": epoch(1000), "data": data})


@form("JSON arrays", "Open-Meteo and Plotly write time series so: an array a signal")
def json_arrays() -> Export:
    return as_json(
        {"time": stamps("%Y-%m-%dT%H:%M:%S"), "pv": PV.tolist(), "sp": SP.tolist(), "op": OP.tolist()}, loop=None
    )


@form(
    "SQL Server Reporting Services",
    "Microsoft Learn, HTML table that a web page sends as .xls; Excel opens it with a warning",
)
def html_as_xls() -> Export:
    rows = across(american(), column(PV, bad={11: "&nbsp;", 12: "&nbsp;"}), column(SP), column(OP))
    head = "".join(f"<th scope='col'>{name}</th>" for name in ("Timestamp", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"))
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>\r\n" for row in rows)
    page = f'<div>\r\n<table cellspacing="0" border="1">\r\n<tr>{head}</tr>\r\n{body}</table>\r\n</div>'
    return text(page, ending=".xls", bad=BAD)


@form(
    "Excel web page", "Microsoft Learn, Save as web page: title over all columns, German numbers, styles in each cell"
)
def html_german() -> Export:
    rows = across(stamps("%d.%m.%Y %H:%M:%S"), column(PV, ","), column(SP, ","), column(OP, ","))
    head = "".join(
        f"<td class=xl65>{name}</td>"
        for name in ("Zeit", f"{TAG} Istwert", f"{TAG} Sollwert", f"{TAG} Stellgr&ouml;&szlig;e")
    )
    units = "".join(f"<td>{unit}</td>" for unit in ("", "m3/h", "m3/h", "%"))
    body = "".join(
        "<tr height=20>" + "".join(f"<td align=right x:num>{cell}</td>" for cell in row) + "</tr>\n" for row in rows
    )
    page = (
        '<html xmlns:x="urn:schemas-microsoft-com:office:excel"><head><meta charset="utf-8">'
        "<style>td {mso-number-format:General;}</style><title>Trend</title></head><body>"
        f"<table><tr><td colspan=4>Trendexport Kolonne 21</td></tr><tr>{head}</tr><tr>{units}</tr>{body}</table>"
        "</body></html>"
    )
    return text(page, ending=".xls")


@form("Excel 2003 XML", "Microsoft Learn, XML Spreadsheet Reference: Workbook, Worksheet, Table, Row, Cell, Data")
def xml_spreadsheet() -> Export:
    def row(cells: list[tuple[str, str]]) -> str:
        return (
            "<Row>" + "".join(f'<Cell><Data ss:Type="{kind}">{cell}</Data></Cell>' for kind, cell in cells) + "</Row>\n"
        )

    body = row([("String", name) for name in ("Timestamp", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP")])
    for t, pv, sp, op in zip(stamps("%Y-%m-%dT%H:%M:%S.000"), PV, SP, OP, strict=True):
        body += row([("DateTime", t), ("Number", f"{pv:.2f}"), ("Number", f"{sp:.2f}"), ("Number", f"{op:.2f}")])
    page = (
        '<?xml version="1.0"?>\n<?mso-application progid="Excel.Sheet"?>\n'
        '<Workbook xmlns="urn:schemas-microsoft-com:office:spreadsheet"\n'
        ' xmlns:ss="urn:schemas-microsoft-com:office:spreadsheet">\n'
        f'<Worksheet ss:Name="Trend"><Table>\n{body}</Table></Worksheet></Workbook>\n'
    )
    return text(page, ending=".xls")


@form("Chart recorder", "JUMO PCA3000 and testo software write so: Nr, Datum, Uhrzeit, then German names and numbers")
def row_numbers() -> Export:
    head = ["Nr", "Datum", "Uhrzeit", "Sollwert", "Istwert", "Stellgröße"]
    rows = across(
        [str(k + 1) for k in range(N)],
        stamps("%d.%m.%Y"),
        stamps("%H:%M:%S"),
        column(SP, ","),
        column(PV, ","),
        column(OP, ","),
    )
    return text(lines([head, *rows], ";"), "cp1252", loop=None)


@form("pandas", "pandas documentation, DataFrame.to_csv(): the index is a first column without a name")
def pandas_index() -> Export:
    rows = across([str(k) for k in range(N)], stamps(), column(PV), column(SP), column(OP))
    return text(lines([["", "time", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"], *rows], end="\n"))


@form("Excel, United States", "a hand-made sheet: 3/4/2025 6:00:00 AM may be March or April")
def american_ambiguous() -> Export:
    t0 = T0.replace(month=3, day=4)
    rows = across(american(t0), column(PV), column(SP), column(OP))
    head = ["Time", f"{TAG}.PV", f"{TAG}.SP", f"{TAG}.OP"]
    return text(lines([head, *rows]), t0=t0, answer={"time_format": "month first"})


@form("Logger", "a hand-made file: rows without a line of names")
def no_names() -> Export:
    named = {"columns": {"time": "column 1", "sp": "column 2", "pv": "column 3", "op": "column 4"}}
    return text(lines(across(stamps(), column(SP), column(PV), column(OP)), end="\n"), loop=None, answer=named)


@form("AVEVA PI AF", "PI System Explorer, attribute paths: element\\element|attribute, with description and unit")
def long_names() -> Export:
    path = f"\\\\PISRV01\\Plant\\Unit 200\\Reflux drum D-201\\{TAG} Reflux flow to column C-21"
    head = ["Timestamp", f"{path}|Process Value (m3/h)", f"{path}|Set Point (m3/h)", f"{path}|Controller Output (%)"]
    return text(lines([head, *across(stamps(), column(PV), column(SP), column(OP))]))
