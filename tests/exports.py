"""One loop as control systems and historians export it: each form once, with its correct content.

    python tests/exports.py FOLDER     writes all of them, and truth.json: values, times and units of each
    python tests/exports.py            prints the table of bench/results/file_forms.md

The loop is FIC101: 40 samples of SP, PV and OP, 5 s apart from 2026-03-21 10:00:00 on. PV and SP are near 9700 m3/h, so
that thousands show.
"""

from __future__ import annotations

import bz2
import csv
import gzip
import io
import json
import sys
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, time, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.feather as feather
import pyarrow.parquet as pq
from openpyxl.utils.datetime import CALENDAR_MAC_1904

N, STEP = 40, 5
T0 = datetime(2026, 3, 21, 10)
K = np.arange(N)
T = K * float(STEP)
SP = np.where(K < 20, 9700.0, 9712.5)
PV = np.round(9701.25 + 9 * np.sin(K / 3), 2)
OP = np.round(45.5 + 3 * np.cos(K / 3), 2)
SIGNALS = {"SP": SP, "PV": PV, "OP": OP}


@dataclass(frozen=True)
class Export:
    """A file, and its correct content."""

    ending: str
    content: bytes
    t: np.ndarray = field(default_factory=lambda: T)
    sp: np.ndarray | None = field(default_factory=lambda: SP)
    pv: np.ndarray = field(default_factory=lambda: PV)
    op: np.ndarray | None = field(default_factory=lambda: OP)
    t0: datetime | None = T0
    units: dict[str, str] = field(default_factory=dict)
    manual: Sequence[int] = ()
    """Rows that are not in automatic."""
    loop: str | None = "FIC101"
    """Name of the loop where the columns tell it; else it has the file's."""
    settings: dict[str, Any] = field(default_factory=dict)
    """Settings of the person."""
    finding: str | None = None
    """Code of the expected finding."""


FORMS: dict[str, tuple[str, Callable[[], Export]]] = {}


def add(name: str, about: str, make: Callable[..., Export], *given: Any, **more: Any) -> None:
    """Adds a form by its name; `about` says what is special about it."""
    FORMS[name] = about, partial(make, *given, **more)


def form(about: str) -> Callable[[Callable[[], Export]], Callable[[], Export]]:
    """Adds a form by the name of the function that makes it."""

    def add_made(make: Callable[[], Export]) -> Callable[[], Export]:
        add(make.__name__, about, make)
        return make

    return add_made


def moments(at: Sequence[int] | np.ndarray = K) -> list[datetime]:
    return [T0 + timedelta(seconds=STEP * float(k)) for k in at]


def stamps(pattern: str = "%Y-%m-%d %H:%M:%S", at: Sequence[int] | np.ndarray = K) -> list[str]:
    return [moment.strftime(pattern) for moment in moments(at)]


def point(x: float) -> str:
    return f"{x:.2f}"


def comma(x: float) -> str:
    return f"{x:.2f}".replace(".", ",")


def thousands(group: str, decimal: str) -> Callable[[float], str]:
    return lambda x: f"{x:,.2f}".replace(",", "G").replace(".", decimal).replace("G", group)


def body(names: Sequence[str], first: Sequence[str], number: Callable[[float], str] = point) -> list[list[str]]:
    """Header and rows: times, then SP, PV and OP."""
    rows = zip(first, SP, PV, OP, strict=True)
    return [list(names), *([t, number(sp), number(pv), number(op)] for t, sp, pv, op in rows)]


def text(rows: Sequence[Sequence[str]], delimiter: str = ",", end: str = "\n", quoting: int = csv.QUOTE_MINIMAL) -> str:
    out = io.StringIO(newline="")
    csv.writer(out, delimiter=delimiter, lineterminator=end, quoting=quoting).writerows(rows)
    return out.getvalue()


def plain(rows: Sequence[Sequence[str]], delimiter: str = ",", encoding: str = "utf-8", **expected: Any) -> Export:
    return Export(".csv", text(rows, delimiter).encode(encoding), **expected)


def wide(sp: str, pv: str, op: str, *, loop: str | None = "FIC101", first: str = "Timestamp") -> Export:
    """A file of which the names of the columns are the point."""
    return plain(body([first, sp, pv, op], stamps()), loop=loop)


TAGS = ["FIC101.SP", "FIC101.PV", "FIC101.OP"]
HEAD = ["Timestamp", *TAGS]

# --- text


add("plain_csv", "commas, points, seconds from 0", plain, body(["t", *TAGS], [str(int(t)) for t in T]), t0=None)
add("semicolons", "semicolons and decimal commas", plain, body(HEAD, stamps(), comma), ";")
add("tabs", "tabs", plain, body(HEAD, stamps()), "\t")
add("bars", "bars", plain, body(HEAD, stamps()), "|")
add(
    "quoted",
    "every cell in quotes, lines end with CR LF",
    Export,
    ".csv",
    text(body(HEAD, stamps()), ",", "\r\n", csv.QUOTE_ALL).encode(),
)
add(
    "unicode_text",
    "UTF-16, as Excel's Unicode text",
    Export,
    ".txt",
    text(body(HEAD, stamps(), comma), "\t", "\r\n").encode("utf-16"),
)
add("byte_order_mark", "UTF-8 with a byte order mark", plain, body(HEAD, stamps()), encoding="utf-8-sig")
add(
    "windows_1252",
    "Windows-1252, with umlauts in the names",
    plain,
    body(["Zeit", "FIC101 Führungsgröße", "FIC101 Regelgröße", "FIC101 Stellgröße"], stamps()),
    ";",
    "cp1252",
)
add("gzipped", "compressed by gzip", Export, ".csv.gz", gzip.compress(text(body(HEAD, stamps())).encode()))
add("bzipped", "compressed by bzip2", Export, ".csv.bz2", bz2.compress(text(body(HEAD, stamps())).encode()))


@form("compressed by Zstandard")
def zstandard() -> Export:
    packed = pa.compress(text(body(HEAD, stamps())).encode(), "zstd", asbytes=True)
    return Export(".csv.zst", packed)


# --- numbers


add("german_thousands", "9.700,00", plain, body(HEAD, stamps(), thousands(".", ",")), ";")
add("english_thousands", "9,700.00", plain, body(HEAD, stamps(), thousands(",", ".")))
add(
    "swedish_thousands",
    "9 700,00, with a space that does not break",
    plain,
    body(HEAD, stamps(), thousands("\u00a0", ",")),
    ";",
)
add("french_thousands", "9 700,00, with a narrow space", plain, body(HEAD, stamps(), thousands("\u202f", ",")), ";")
add("swiss_thousands", "9'700.00", plain, body(HEAD, stamps(), thousands("'", ".")), ";")


@form("9.700 without decimals next to 45,50")
def whole_thousands() -> Export:
    rows = body(HEAD, stamps(), thousands(".", ","))
    for row in rows[1:]:
        row[1] = "9.700" if row[1] == "9.700,00" else row[1]
    return plain(rows, ";")


add("exponents", "9.70000E+03", plain, body(HEAD, stamps(), lambda x: f"{x:.5E}"))


# --- times


@form("Datum and Uhrzeit in two columns")
def datum_uhrzeit() -> Export:
    rows = body(["Datum", "Uhrzeit", *TAGS], stamps("%d.%m.%Y"), comma)
    return plain([rows[0], *([row[0], t, *row[1:]] for row, t in zip(rows[1:], stamps("%H:%M:%S"), strict=True))], ";")


def _two(date_name: str, time_name: str, day: str, clock: str) -> Export:
    rows = zip(stamps(day), stamps(clock), SP, PV, OP, strict=True)
    return plain([[date_name, time_name, *TAGS], *([d, t, point(a), point(b), point(c)] for d, t, a, b, c in rows)])


add(
    "date_time_am_pm",
    "Date and Time in two columns, month first, AM and PM",
    _two,
    "Date",
    "Time",
    "%m/%d/%Y",
    "%I:%M:%S %p",
)
add("datum_tid", "Datum and Tid in two columns, 10.00.05", _two, "Datum", "Tid", "%Y-%m-%d", "%H.%M.%S")
add("date_heure", "Date and Heure in two columns", _two, "Date", "Heure", "%d/%m/%Y", "%H:%M:%S")
add("fecha_hora", "Fecha and Hora in two columns", _two, "Fecha", "Hora", "%d/%m/%Y", "%H:%M:%S")
add("time_before_date", "time of day first, then the date", _two, "Time", "Date", "%H:%M:%S", "%d-%b-%Y")
add("iso_utc", "2026-03-21T10:00:00Z", plain, body(HEAD, stamps("%Y-%m-%dT%H:%M:%SZ")))


@form("2026-03-21 11:00:00+01:00")
def iso_offset() -> Export:
    hour = timedelta(hours=1)
    return plain(body(HEAD, [(m + hour).strftime("%Y-%m-%d %H:%M:%S+01:00") for m in moments()]))


add("german_dates", "21.03.2026 10:00:00", plain, body(HEAD, stamps("%d.%m.%Y %H:%M:%S")))
add("american_dates", "3/21/2026 10:00:00 AM", plain, body(HEAD, stamps("%m/%d/%Y %I:%M:%S %p")))
add("pi_dates", "21-Mar-26 10:00:00", plain, body(HEAD, stamps("%d-%b-%y %H:%M:%S")))
add(
    "german_months",
    "21-Mrz-26 10:00:00",
    plain,
    body(HEAD, [s.replace("Mar", "Mrz") for s in stamps("%d-%b-%y %H:%M:%S")]),
)
add(
    "colon_milliseconds",
    "21.03.2026 10:00:00:000, milliseconds behind a colon",
    plain,
    body(HEAD, stamps("%d.%m.%Y %H:%M:%S:000")),
)
add("epoch_seconds", "seconds since 1970", plain, body(HEAD, [str(1774087200 + int(t)) for t in T]))
add("epoch_milliseconds", "milliseconds since 1970", plain, body(HEAD, [str(1774087200000 + 1000 * int(t)) for t in T]))
add(
    "day_numbers",
    "a spreadsheet's day numbers",
    plain,
    body(HEAD, [f"{46102 + (36000 + t) / 86400:.9f}" for t in T]),
    finding="time_assumed",
)
add(
    "minutes",
    "minutes, by the unit in the header",
    plain,
    body(["t [min]", *TAGS], [f"{t / 60:.9f}" for t in T]),
    t0=None,
    units={"time": "min"},
)
add("unnamed_times", "the column of times has no name", plain, body(["", *TAGS], stamps()))
add("unknown_times", "the column of times has a name that says nothing", plain, body(["Axis", *TAGS], stamps()))


# --- heads and feet


@form("titles and facts above the names")
def titles() -> Export:
    above = [["Trend export"], ["Server", "HIST01"], ["From", "2026-03-21 10:00:00"], ["Rows", "40"], []]
    return plain([*above, *body(HEAD, stamps())])


@form("titles filled up with empty cells")
def padded_titles() -> Export:
    above = [["Trend export", "", "", ""], ["Start", "2026-03-21 10:00:00", "", ""], ["", "", "", ""]]
    return plain([*above, *body(HEAD, stamps())], ";")


@form("a row of units below the names")
def units_below() -> Export:
    rows = body(HEAD, stamps())
    return plain([rows[0], ["", "m3/h", "m3/h", "%"], *rows[1:]], units={"SP": "m3/h", "PV": "m3/h", "OP": "%"})


@form("units in brackets in the names")
def units_in_names() -> Export:
    names = ["Timestamp", "FIC101.SP [m3/h]", "FIC101.PV [m3/h]", "FIC101.OP (%)"]
    return plain(body(names, stamps()), units={"SP": "m3/h", "PV": "m3/h", "OP": "%"})


@form("names, descriptions and units in three rows")
def descriptions() -> Export:
    rows = body(HEAD, stamps())
    above = [rows[0], ["", "Reflux", "Reflux", "Reflux valve"], ["", "m3/h", "m3/h", "%"]]
    return plain([*above, *rows[1:]], units={"SP": "m3/h", "PV": "m3/h", "OP": "%"})


add("remark_below", "a remark below the rows", plain, [*body(HEAD, stamps()), [], ["End of export"]])
add(
    "padded_remark",
    "a remark below the rows, filled up with empty cells",
    plain,
    [*body(HEAD, stamps()), ["End of export", "", "", ""], ["", "", "", ""]],
    ";",
)


@form("totals below the rows")
def totals_below() -> Export:
    totals = [["Mittelwert", "9706,25", "9701,25", "45,50"], ["Anzahl", "40", "40", "40"]]
    return plain([*body(HEAD, stamps(), comma), *totals], ";")


# --- each signal at its own times


def own(k: int) -> np.ndarray:
    """Sample numbers at which the signal k is written: SP rarely, PV and OP in turns of an uneven step."""
    return (np.array([0, 10, 20, 30]), K, np.concatenate((K[:1], K[2::3])))[k]


def held(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The last value at or before each sample."""
    return values[at[np.searchsorted(at, K, side="right") - 1]]


def side_by_side(pattern: str = "%d-%b-%y %H:%M:%S") -> list[list[str]]:
    """Three pairs of time and value, the shorter ones empty at their end."""
    pairs = [(stamps(pattern, own(i)), [point(x) for x in values[own(i)]]) for i, values in enumerate(SIGNALS.values())]
    rows = []
    for k in range(N):
        row: list[str] = []
        for times, values in pairs:
            row += [times[k], values[k]] if k < len(times) else ["", ""]
        rows.append(row)
    return rows


APART = {"sp": held(SP, own(0)), "op": held(OP, own(2)), "finding": "own_times"}


@form("a column of times for each tag, all called Timestamp")
def times_for_each() -> Export:
    names = [name for tag in TAGS for name in ("Timestamp", tag)]
    return plain([names, *side_by_side()], **APART)


@form("a column of times for each tag, the tag above its times (DataLink)")
def tag_above_times() -> Export:
    names = [name for tag in TAGS for name in (tag, "")]
    return plain([names, *side_by_side()], **APART)


@form("a column of times for each tag, below it Timestamp and Value (DataLink)")
def two_lines_of_names() -> Export:
    names = [name for tag in TAGS for name in (tag, "")]
    return plain([names, ["Timestamp", "Value"] * 3, *side_by_side()], **APART)


@form("a column of times for each tag, called by the tag")
def times_called_by_tag() -> Export:
    names = [name for tag in TAGS for name in (f"{tag} Time", tag)]
    return plain([names, *side_by_side("%Y-%m-%d %H:%M:%S")], **APART)


@form("tags on alternate rows")
def alternate_rows() -> Export:
    rows, last = [HEAD], 3 * N
    for k in range(last):
        cells = ["", "", ""]
        cells[k % 3] = point([SP, PV, OP][k % 3][k // 3])
        at = (T0 + timedelta(seconds=STEP * (k // 3) + (k % 3) - 1)).strftime("%Y-%m-%d %H:%M:%S")
        rows.append([at, *cells])
    op = np.concatenate(([np.nan], OP[:-1]))
    return plain(rows, t=T + 1, t0=T0 - timedelta(seconds=1), op=op, finding="own_times")


@form("SP only where it changes")
def sp_on_change() -> Export:
    rows = body(HEAD, stamps())
    for k in range(N - 1, 0, -1):
        rows[k + 1][1] = "" if rows[k + 1][1] == rows[k][1] else rows[k + 1][1]
    return plain(rows, finding="own_times")


@form("the mode only where it changes")
def mode_on_change() -> Export:
    rows = body(HEAD, stamps())
    modes = ["MAN" if k == 0 else "AUTO" if k == 10 else "" for k in range(N)]
    return plain([[*row, mode] for row, mode in zip(rows, ["FIC101.MODE", *modes], strict=True)], manual=range(10))


@form("OP eight times as often as PV")
def op_often() -> Export:
    names = ["Timestamp", "FIC101.OP", "Timestamp", "FIC101.PV", "Timestamp", "FIC101.SP"]
    at = K[::8]
    rows = []
    for k in range(N):
        pairs = [[stamps()[k], point(OP[k])]]
        pairs += [[stamps("%Y-%m-%d %H:%M:%S", at)[k], point(x[at[k]])] if k < len(at) else ["", ""] for x in (PV, SP)]
        rows.append([cell for pair in pairs for cell in pair])
    seen = at[-1] >= K
    line = np.interp(T[seen], T[at], PV[at])
    return plain([names, *rows], t=T[seen], pv=line, op=OP[seen], sp=SP[at][(K // 8)][seen], finding="own_times")


# --- a row per tag and time


def long(names: Sequence[str], row: Callable[[str, int], Sequence[str]], by_tag: bool = False) -> list[list[str]]:
    order = [(tag, k) for tag in SIGNALS for k in K] if by_tag else [(tag, k) for k in K for tag in SIGNALS]
    return [list(names), *(list(row(tag, k)) for tag, k in order)]


@form("PI: a row per tag and time")
def pi_rows() -> Export:
    at = stamps("%d-%b-%y %H:%M:%S")
    return plain(long(["Tag", "Timestamp", "Value"], lambda tag, k: [f"FIC101.{tag}", at[k], point(SIGNALS[tag][k])]))


@form("a row per tag and time, one tag after the other")
def rows_by_tag() -> Export:
    at = stamps()
    return plain(
        long(["Point", "Time", "Value"], lambda tag, k: [f"FIC101.{tag}", at[k], point(SIGNALS[tag][k])], True)
    )


@form("Wonderware: TagName, DateTime, Value, OPCQuality")
def wonderware_rows() -> Export:
    at = stamps("%Y-%m-%d %H:%M:%S.000")
    names = ["TagName", "DateTime", "Value", "OPCQuality"]
    return plain(long(names, lambda tag, k: [f"FIC101.{tag}", at[k], point(SIGNALS[tag][k]), "192"]))


@form("WinCC: VarName, TimeString, VarValue, Validity, Time_ms, and rows that are no samples")
def wincc_rows() -> Export:
    at = stamps("%d.%m.%Y %H:%M:%S")
    rows = long(
        ["VarName", "TimeString", "VarValue", "Validity", "Time_ms"],
        lambda tag, k: [f"FIC101_{tag}", at[k], comma(SIGNALS[tag][k]), "1", f"{46102416666 + 58 * k}"],
    )
    off = ["$RT_OFF$", at[-1], "0", "2", "46102421000"]
    return Export(".csv", text([*rows, off], ";", "\r\n", csv.QUOTE_ALL).encode("utf-8"))


@form("a row per tag and time, German, with date and time in two columns")
def german_rows() -> Export:
    names = ["Messstelle", "Datum", "Uhrzeit", "Wert"]
    days, clock = stamps("%d.%m.%Y"), stamps("%H:%M:%S")
    rows = long(names, lambda tag, k: [f"FIC101.{tag}", days[k], clock[k], comma(SIGNALS[tag][k])])
    return plain(rows, ";")


@form("a row per tag and time, Spanish")
def spanish_rows() -> Export:
    at = stamps("%d/%m/%Y %H:%M:%S")
    names = ["Etiqueta", "Fecha y hora", "Valor", "Calidad"]
    return plain(long(names, lambda tag, k: [f"FIC101.{tag}", at[k], comma(SIGNALS[tag][k]), "Bueno"]), ";")


# --- names of control systems


add(
    "deltav",
    "DeltaV: FIC101/PID1/PV.CV",
    wide,
    "FIC101/PID1/SP.CV",
    "FIC101/PID1/PV.CV",
    "FIC101/PID1/OUT.CV",
    loop="FIC101/PID1",
)
add(
    "pcs7_apl",
    "PCS 7 (APL): FIC101/PID.PV_Out#Value",
    wide,
    "FIC101/PID.SP#Value",
    "FIC101/PID.PV_Out#Value",
    "FIC101/PID.MV#Value",
    loop="FIC101/PID",
)
add("pcs7_ctrl_pid", "PCS 7 (CTRL_PID): PV_IN, LMN", wide, "FIC101.SP", "FIC101.PV_IN", "FIC101.LMN")
add("abb_800xa", "800xA: FIC101.Pv.Value", wide, "FIC101.Sp.Value", "FIC101.Pv.Value", "FIC101.Out.Value")
add("abb_history", "800xA history: FIC101:PV,Log-1s", wide, "FIC101:SP,Log-1s", "FIC101:PV,Log-1s", "FIC101:OUT,Log-1s")


@form("Experion: FIC101.PIDA.PV, with MODE")
def experion() -> Export:
    rows = body(["Timestamp", "FIC101.PIDA.SP", "FIC101.PIDA.PV", "FIC101.PIDA.OP"], stamps("%m/%d/%Y %H:%M:%S"))
    modes = ["FIC101.PIDA.MODE", *("MAN" if k < 3 else "CAS" if k < 20 else "AUTO" for k in range(N))]
    rows = [[*row, mode] for row, mode in zip(rows, modes, strict=True)]
    return plain(rows, manual=range(3), loop="FIC101.PIDA")


@form("CENTUM: SV, PV, MV, MODE")
def centum() -> Export:
    rows = body(["Time", "FIC101.SV", "FIC101.PV", "FIC101.MV"], stamps("%Y/%m/%d %H:%M:%S"))
    modes = ["FIC101.MODE", *("MAN" if k < 3 else "AUT" for k in range(N))]
    return plain([[*row, mode] for row, mode in zip(rows, modes, strict=True)], manual=range(3))


add(
    "pi_paths",
    "PI with its server: \\\\HIST01\\FIC101.PV",
    wide,
    "\\\\HIST01\\FIC101.SP",
    "\\\\HIST01\\FIC101.PV",
    "\\\\HIST01\\FIC101.OP",
    loop="\\\\HIST01\\FIC101",
)
add("wonderware", "Wonderware: DateTime, FIC101.PV", wide, "FIC101.SP", "FIC101.PV", "FIC101.OP", first="DateTime")
add(
    "foxboro",
    "Foxboro: SPT, MEAS, OUT",
    wide,
    "PLANT:FIC101.SPT",
    "PLANT:FIC101.MEAS",
    "PLANT:FIC101.OUT",
    loop="PLANT:FIC101",
)
add("joined_names", "names without a separator: FIC101PV", wide, "FIC101SP", "FIC101PV", "FIC101OP")
add("signal_first", "the signal before the tag: PV_FIC101", wide, "SP_FIC101", "PV_FIC101", "OP_FIC101")
add(
    "signal_inside",
    "the signal within the name: FIC101 PV Reflux",
    wide,
    "FIC101 SP Reflux",
    "FIC101 PV Reflux",
    "FIC101 OP Reflux",
    loop="FIC101 Reflux",
)
add("cv_is_output", "CV as the output, next to PV", wide, "FIC101.SP", "FIC101.PV", "FIC101.CV")
add("cv_is_controlled", "CV as the controlled variable, next to MV", wide, "FIC101.SP", "FIC101.CV", "FIC101.MV")
add("vp_is_output", "VP as the output", wide, "SP", "PV", "VP", loop=None)
add("w_x_y", "W, X and Y of German standards", wide, "FIC101.W", "FIC101.X", "FIC101.Y")
add("r_y_u", "r, y and u of textbooks", wide, "r", "y", "u", loop=None, first="t")


# --- languages


add(
    "english",
    "English: Set Point, Process Value, Controller Output",
    wide,
    "FIC101 Set Point",
    "FIC101 Process Value",
    "FIC101 Controller Output",
    first="Date/Time",
)
add(
    "german",
    "German: Sollwert, Istwert, Stellgrad",
    wide,
    "FIC101 Sollwert",
    "FIC101 Istwert",
    "FIC101 Stellgrad",
    first="Zeitstempel",
)
add(
    "german_messwert",
    "German: Sollwert, Messwert, Stellwert",
    wide,
    "Sollwert",
    "Messwert",
    "Stellwert",
    loop=None,
    first="Datum/Zeit",
)
add(
    "swedish",
    "Swedish: Börvärde, Ärvärde, Utsignal",
    wide,
    "FIC101 Börvärde",
    "FIC101 Ärvärde",
    "FIC101 Utsignal",
    first="Tidpunkt",
)
add(
    "swedish_ascii",
    "Swedish without its letters: Borvarde, Arvarde, Styrsignal",
    wide,
    "FIC101_Borvarde",
    "FIC101_Arvarde",
    "FIC101_Styrsignal",
    first="Tid",
)
add(
    "french",
    "French: Consigne, Mesure, Sortie régulateur",
    wide,
    "FIC101 Consigne",
    "FIC101 Mesure",
    "FIC101 Sortie régulateur",
    first="Horodatage",
)
add(
    "spanish",
    "Spanish: Punto de consigna, Variable de proceso, Salida",
    wide,
    "FIC101 Punto de consigna",
    "FIC101 Variable de proceso",
    "FIC101 Salida",
    first="Fecha y hora",
)


# --- missing or bad values


add("no_sp", "no SP", plain, [[row[0], *row[2:]] for row in body(HEAD, stamps())], sp=None)
add("no_op", "no OP", plain, [row[:3] for row in body(HEAD, stamps())], op=None)


def with_bad(words: Sequence[str]) -> Export:
    rows, pv = body(HEAD, stamps()), PV.copy()
    for i, word in enumerate(words):
        rows[3 * i + 3][2], pv[3 * i + 2] = word, np.nan
    return plain(rows, pv=pv)


add(
    "bad_words",
    "Bad, No Data, I/O Timeout and others in the place of values",
    with_bad,
    ["Bad", "No Data", "I/O Timeout", "Pt Created", "#N/A", "Bad Input", "NaN", "Scan Off", "-", ""],
)
add(
    "bad_words_elsewhere",
    "words for bad values in German, Swedish, French and Spanish",
    with_bad,
    ["Ungültig", "Schlecht", "Kein Wert", "Ogiltigt", "Saknas", "Invalide", "Mauvais", "Sin datos"],
)


@form("a column of quality by numbers of OPC")
def opc_quality() -> Export:
    rows, pv = body(HEAD, stamps()), PV.copy()
    codes = ["FIC101.PV.Status", *("0" if k in (7, 8) else "192" for k in range(N))]
    pv[7:9] = np.nan
    return plain([[*row, code] for row, code in zip(rows, codes, strict=True)], pv=pv)


@form("modes in German, as words")
def german_modes() -> Export:
    rows = body(["Zeit", "FIC101 Sollwert", "FIC101 Istwert", "FIC101 Stellwert"], stamps())
    modes = ["FIC101 Betriebsart", *("Hand" if k < 4 else "Kaskade" if k < 9 else "Automatik" for k in range(N))]
    return plain([[*row, mode] for row, mode in zip(rows, modes, strict=True)], manual=range(4))


@form("modes in Swedish, as words, in a column called Modus")
def swedish_modes() -> Export:
    rows = body(["Tid", "FIC101 Börvärde", "FIC101 Ärvärde", "FIC101 Utsignal"], stamps())
    modes = ["FIC101 Modus", *("Manuellt" if k < 4 else "Automatiskt" if k < 9 else "automatisch" for k in range(N))]
    return plain([[*row, mode] for row, mode in zip(rows, modes, strict=True)], manual=range(4))


# --- Excel


def workbook(*sheets: tuple[str, Sequence[Sequence[Any]]], mac: bool = False) -> bytes:
    book = openpyxl.Workbook()
    book.remove(book.active)
    if mac:
        book.epoch = CALENDAR_MAC_1904
    for name, rows in sheets:
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append([None if cell == "" else cell for cell in row])
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


def open_document(name: str, rows: Sequence[Sequence[Any]]) -> bytes:
    """A workbook with one sheet as LibreOffice writes it, empty cells to the last column included."""
    spaces = " ".join(
        f'xmlns:{one}="urn:oasis:names:tc:opendocument:xmlns:{one}:1.0"' for one in ("office", "table", "text")
    )
    kinds = {str: ("string", ""), float: ("float", "value"), datetime: ("date", "date-value")}

    def cell(value: Any) -> str:
        kind, key = kinds[type(value)]
        text = value.isoformat() if isinstance(value, datetime) else str(value)
        held = f' office:{key}="{text}"' if key else ""
        return f'<table:table-cell office:value-type="{kind}"{held}><text:p>{text}</text:p></table:table-cell>'

    rest = '<table:table-cell table:number-columns-repeated="16000"/>'
    lines = "".join(f"<table:table-row>{''.join(map(cell, row))}{rest}</table:table-row>" for row in rows)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as whole:
        whole.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        whole.writestr("META-INF/manifest.xml", "<manifest/>")
        whole.writestr(
            "content.xml",
            f"<office:document-content {spaces}><office:body><office:spreadsheet>"
            f'<table:table table:name="{name}">{lines}</table:table>'
            "</office:spreadsheet></office:body></office:document-content>",
        )
    return out.getvalue()


def typed(names: Sequence[str] = HEAD, first: Sequence[Any] | None = None) -> list[list[Any]]:
    rows = zip(moments() if first is None else first, SP.tolist(), PV.tolist(), OP.tolist(), strict=True)
    return [list(names), *(list(row) for row in rows)]


add("excel", "Excel: dates and numbers", Export, ".xlsx", workbook(("Trend", typed())))


@form("Excel: Datum and Uhrzeit in two columns")
def excel_two_columns() -> Export:
    rows: list[list[Any]] = [["Datum", "Uhrzeit", *TAGS]]
    rows += [[row[0].date(), row[0].time(), *row[1:]] for row in typed()[1:]]
    return Export(".xlsx", workbook(("Tabelle1", rows)))


@form("Excel: titles, units, a word for a bad value and totals")
def excel_report() -> Export:
    rows = typed()
    rows[11][2], pv = "No Data", PV.copy()
    pv[10] = np.nan
    above: list[list[Any]] = [["Trend export"], [], ["From", T0], []]
    below: list[list[Any]] = [[], ["Average", 9706.25, 9701.25, 45.5]]
    sheet = [*above, rows[0], ["", "m3/h", "m3/h", "%"], *rows[1:], *below]
    return Export(".xlsx", workbook(("Report", sheet)), pv=pv, units={"SP": "m3/h", "PV": "m3/h", "OP": "%"})


@form("Excel: a title, and the tag above its signals")
def excel_tag_above() -> Export:
    rows = typed(["Time", "SP", "PV", "OP"])
    return Export(".xlsx", workbook(("Trend", [["Trend export"], [], ["", "FIC101"], *rows])))


@form("Excel: everything as German text, 9.700,00")
def excel_text() -> Export:
    rows = body(["Zeit", *TAGS], stamps("%d.%m.%Y %H:%M:%S"), thousands(".", ","))
    return Export(".xlsx", workbook(("Tabelle1", rows)))


@form("Excel: DataLink's times for each tag, an empty column between")
def excel_datalink() -> Export:
    rows: list[list[Any]] = [[cell for tag in TAGS for cell in (tag, "", "")]]
    for k in range(N):
        row: list[Any] = []
        for i, values in enumerate(SIGNALS.values()):
            at = own(i)
            row += [moments(at)[k], float(values[at[k]]), ""] if k < len(at) else ["", "", ""]
        rows.append(row)
    return Export(".xlsx", workbook(("PI", rows)), **APART)


add(
    "excel_second_sheet",
    "Excel: a note on the first sheet, the table on the second",
    Export,
    ".xlsx",
    workbook(("Read me", [["Trend of", "FIC101"], ["for", "maintenance"]]), ("Data", typed())),
)


@form("Excel: OP in cells that show per cent, 45.5 % for 0.455")
def excel_per_cent() -> Export:
    book = openpyxl.Workbook()
    sheet = book.active
    for row in typed():
        sheet.append(row if row[0] == "Timestamp" else [*row[:3], row[3] / 100])
        sheet.cell(sheet.max_row, 4).number_format = "0.0%"
        sheet.cell(sheet.max_row, 3).number_format = '0.00" %"'  # a sign that is only written
    sheet.cell(N + 9, 9).number_format = "0%"  # of a cell that holds nothing
    out = io.BytesIO()
    book.save(out)
    return Export(".xlsx", out.getvalue(), units={"OP": "%"})


add("excel_1904", "Excel: the calendar from 1904", Export, ".xlsx", workbook(("Trend", typed()), mac=True))


# --- tables


def table(names: Sequence[str] = HEAD) -> pa.Table:
    return pa.table([pa.array(moments(), pa.timestamp("ms")), SP, PV, OP], names=list(names))


@form("Parquet")
def parquet() -> Export:
    out = io.BytesIO()
    pq.write_table(table(), out)
    return Export(".parquet", out.getvalue())


@form("Parquet, a row per tag and time")
def parquet_rows() -> Export:
    out = io.BytesIO()
    values = np.column_stack(list(SIGNALS.values())).ravel()
    columns = {"ts": [m for m in moments() for _ in SIGNALS], "tag": TAGS * N, "value": values}
    pq.write_table(pa.table(columns), out)
    return Export(".parquet", out.getvalue())


@form("Parquet, dates and times of day in two columns")
def parquet_two_columns() -> Export:
    out = io.BytesIO()
    days: list[date] = [m.date() for m in moments()]
    clock: list[time] = [m.time() for m in moments()]
    pq.write_table(pa.table({"Date": days, "Time": clock, **dict(zip(TAGS, SIGNALS.values(), strict=True))}), out)
    return Export(".parquet", out.getvalue())


@form("Feather")
def feather_file() -> Export:
    out = io.BytesIO()
    feather.write_feather(table(), out)
    return Export(".feather", out.getvalue())


def guide() -> str:
    """The table of `bench/results/file_forms.md`."""
    rows = ["| form | is | file | rows are | read right | in the page |", "|---|---|---|---|---|---|"]
    for name, (about, make) in FORMS.items():
        times = {"own_times": "those of PV; SP and OP held", None: "those of the file"}
        what = (
            "PV's and OP's; PV interpolated, SP held" if name == "op_often" else times.get(make().finding, times[None])
        )
        if make().manual:
            what += "; modes held" if name == "mode_on_change" else "; modes read"
        about = about.replace("|", "\\|")
        rows.append(f"| `{name}` | {about} | {make().ending} | {what} | yes | yes |")
    return "\n".join(rows) + "\n"


def write_all(folder: Path) -> None:
    """Write every form, and `truth.json` with the correct contents."""
    folder.mkdir(parents=True, exist_ok=True)
    truth = {}
    for name, (about, make) in FORMS.items():
        export = make()
        (folder / f"{name}{export.ending}").write_bytes(export.content)
        truth[f"{name}{export.ending}"] = {
            "about": about,
            "loop": export.loop or name,
            "t0": None if export.t0 is None else export.t0.isoformat(),
            "units": export.units,
            "manual": list(export.manual),
            **{
                signal: None if (x := getattr(export, signal)) is None else [None if np.isnan(v) else v for v in x]
                for signal in ("t", "sp", "pv", "op")
            },
        }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1, ensure_ascii=False), encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        write_all(Path(sys.argv[1]))
    else:
        print(guide(), end="")
